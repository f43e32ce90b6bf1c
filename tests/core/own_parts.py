"""Filters, systems and terms of a user's own, which tests name as "own_parts:NAME"."""

import numpy as np
from textbook import Textbook

from turtlebot_gym import ObservationTerm
from turtlebot_gym.kernel import kernel
from turtlebot_gym.models.random import SENSOR, normals, sub_key
from turtlebot_gym.rewards import RewardTerm
from turtlebot_gym.systems import Body, Sensor, system_of
from turtlebot_gym.values import State


class Extended(Textbook):
    """The package's filter, written with matrices, and a state more that nothing touches."""

    def __init__(self, tuning):
        super().__init__([0.0, 0.0, 0.0, 0.0, 0.0, 7.0], np.diag([*tuning.R, 0.0, 0.0, 0.5]), tuning)

    def predict(self, twist, dt):
        self.dt = dt
        super().predict(twist)


class Small(Extended):
    def __init__(self, tuning):
        self.x, self.P = [0.0], [[1.0]]


@kernel
def slide(body, command, key, at, p):
    """A sledge that moves sideways as well: nothing that a unicycle can do."""
    s = body.true_state
    truth = State(s.x + command.v * p.dt, s.y + command.omega * p.dt, s.theta, command.v, command.omega)
    return Body(truth, command, body.asked, body.wheels, False)


@kernel
def spin(before, after, judgement, p):
    """Minus the squared change of the turning rate, rad^2/s^2."""
    change = after.body.command.omega - before.body.command.omega
    return -change * change


SPIN = RewardTerm("spin", spin, 1.0)


def system_with_spin(p):
    return system_of(p).with_rewards(SPIN)


def sledge(p):
    return system_of(p)._replace(move=slide)


NUMBER = 3


# Terms of observations: a bumper, a speedometer, gaps in a room, and what cannot be.


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
