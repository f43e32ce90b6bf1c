"""Assembly of the step: systems, their parameters, and one environment in plain Python."""

from turtlebot_gym.systems.open_ground import open_ground
from turtlebot_gym.systems.options import Options, Setup, make_parameters
from turtlebot_gym.systems.parameters import MAX_DELAY, Parameters, RoomParameters, make_room
from turtlebot_gym.systems.rooms import (
    RoomState,
    WithTerms,
    find_system,
    rooms,
    system_of,
)
from turtlebot_gym.systems.sensors import ODOMETRY, Sensor
from turtlebot_gym.systems.system import RoomParts, System
from turtlebot_gym.systems.world import Body, Course, Judgement, Outcome, Snapshot

__all__ = [
    "MAX_DELAY",
    "ODOMETRY",
    "Body",
    "Course",
    "Judgement",
    "Options",
    "Outcome",
    "Parameters",
    "RoomParameters",
    "RoomParts",
    "RoomState",
    "Sensor",
    "Setup",
    "Snapshot",
    "System",
    "WithTerms",
    "find_system",
    "make_parameters",
    "make_room",
    "open_ground",
    "rooms",
    "system_of",
]
