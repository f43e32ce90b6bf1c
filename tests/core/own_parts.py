"""Filters, systems and failures of a user's own, which tests name as "own_parts:NAME"."""

import numpy as np
from textbook import Textbook

from turtlebot_gym.kernel import kernel
from turtlebot_gym.rewards import RewardTerm
from turtlebot_gym.systems import Body, system_of
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


nothing = 3
