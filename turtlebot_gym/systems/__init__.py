"""Assembly of the step: systems, their parameters, and one environment in plain Python."""

from turtlebot_gym.systems.assembly import assemble, system_of
from turtlebot_gym.systems.open_ground import open_ground
from turtlebot_gym.systems.options import Options, Setup, make_parameters
from turtlebot_gym.systems.parameters import MAX_DELAY, Parameters, RoomParameters, make_room
from turtlebot_gym.systems.rooms import rooms
from turtlebot_gym.systems.sensors import ODOMETRY, Sensor
from turtlebot_gym.systems.system import NOWHERE, RoomParts, System
from turtlebot_gym.systems.world import Body, Course, Outcome, RoomState, Snapshot
