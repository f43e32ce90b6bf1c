"""Terms of an observation as a user writes them: a bumper, a speedometer, and gaps in a room."""

from turtlebot_gym import ObservationTerm
from turtlebot_gym.kernel import kernel
from turtlebot_gym.models.random import SENSOR, normals, sub_key
from turtlebot_gym.systems import Sensor


@kernel
def touch(world, p):
    return 1.0 if world.room.clearance < 0.05 else 0.0


BUMPER = ObservationTerm(
    "bumper", touch, 0.0, 1.0, topic="bumper", message="std_msgs/msg/Bool", convert=lambda message: message.data
)


@kernel
def nothing(body, key, p):
    return 0.0


@kernel
def measure_speed(body, before, key, at, p):
    noise, _ = normals(sub_key(key, SENSOR), at, 0)
    return body.true_state.v + 0.01 * noise


@kernel
def speed(world, p):
    return world.senses.speedometer


SPEEDOMETER = ObservationTerm(
    "speedometer",
    speed,
    -0.15,
    0.15,
    "m/s",
    sensor=Sensor("speedometer", nothing, measure_speed),
    topic="speed",
    message="std_msgs/msg/Float64",
    convert=lambda message: message.data,
)


@kernel
def gaps(world, p):
    return world.room.clearance, world.room.least


GAPS = ObservationTerm("gaps", gaps, (-1.0, -1.0), (2.0, 2.0), "m")


SHORT = ObservationTerm("short", touch, (0.0, 0.0), (1.0, 1.0))


@kernel
def written(world, p):
    return float(f"{world.body.true_state.v:.17g}")


WRITTEN = ObservationTerm("written", written, -1.0, 1.0)
