"""A sixth state beside the five of the robot: a scalar that a filter learns, such as the scale of a twist or a gyro's bias.

Five states have their covariance written out; a sixth needs its mean, its variance and its covariance with the five.
"""

from __future__ import annotations

from typing import NamedTuple

from turtlebot_gym.estimation.ekf import wrapped
from turtlebot_gym.estimation.update import (
    Projection,
    Variances,
    innovation_variance,
    inverse_of,
    of_heading,
    of_x,
    of_y,
    update,
)
from turtlebot_gym.kernel import kernel
from turtlebot_gym.models.unicycle import motion
from turtlebot_gym.values import Belief, Pose, State


class Sixth(NamedTuple):
    """A scalar state."""

    mean: float
    variance: float
    column: State
    """Its covariance with each component of the robot's state."""


@kernel
def moved_column(sixth: Sixth, mean: State, dt: float, middle: float) -> Pose:
    """Return the covariance of a constant sixth state with the pose after an interval."""
    c, by = sixth.column, motion(mean.theta, mean.v, mean.omega, dt, middle)
    x = c.x + by.x_theta * c.theta + by.x_v * c.v + by.x_omega * c.omega
    y = c.y + by.y_theta * c.theta + by.y_v * c.v + by.y_omega * c.omega
    return Pose(x, y, c.theta + dt * c.omega)


@kernel
def update_both(
    belief: Belief, sixth: Sixth, h: Projection, across: float, innovation: float, r: float
) -> tuple[Belief, Sixth, float]:
    """Condition as `update.update` does; the sixth state has the covariance ``across``."""
    inverse = inverse_of(innovation_variance(h, r))
    posterior, nis = update(belief, h, innovation, r)
    c, s, k = sixth.column, h.column, across * inverse
    column = State(c.x - k * s.x, c.y - k * s.y, c.theta - k * s.theta, c.v - k * s.v, c.omega - k * s.omega)
    return posterior, Sixth(sixth.mean + k * innovation, max(sixth.variance - k * across, 0.0), column), nis


@kernel
def correct_both(belief: Belief, sixth: Sixth, z: Pose, R: Variances, turn: float) -> tuple[Belief, Sixth, float]:
    """Condition on a measured pose with the innovation ``turn``; return the NIS, too."""
    prior = belief.mean.theta
    belief, sixth, nis_x = update_both(belief, sixth, of_x(belief.covariance), sixth.column.x, z.x - belief.mean.x, R[0])
    belief, sixth, nis_y = update_both(belief, sixth, of_y(belief.covariance), sixth.column.y, z.y - belief.mean.y, R[1])
    turn = turn - (belief.mean.theta - prior)
    belief, sixth, nis = update_both(belief, sixth, of_heading(belief.covariance), sixth.column.theta, turn, R[2])
    return wrapped(belief), sixth, nis_x + nis_y + nis
