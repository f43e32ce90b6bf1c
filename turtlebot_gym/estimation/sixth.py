"""A state beside the pose: a scalar that a filter learns, such as a gyro's bias or the scale of ranges.

A pose has its covariance written out; a further state needs its mean, its variance and its covariance with the pose.
"""

from __future__ import annotations

from typing import NamedTuple

from turtlebot_gym.estimation.update import (
    Projection,
    Variances,
    independent,
    innovation_variance,
    inverse_of,
    of_row,
    of_x,
    update,
    wrapped,
)
from turtlebot_gym.kernel import kernel
from turtlebot_gym.models.angles import wrap
from turtlebot_gym.values import Belief, Pose


class Sixth(NamedTuple):
    """A scalar state."""

    mean: float
    variance: float
    column: Pose
    """Its covariance with each component of the robot's pose."""


NOTHING = Sixth(0.0, 0.0, Pose(0.0, 0.0, 0.0))
"""A further state that is known, and correlated with nothing."""


@kernel
def update_both(
    belief: Belief, sixth: Sixth, h: Projection, across: float, innovation: float, r: float
) -> tuple[Belief, Sixth, float]:
    """Condition as `update.update` does; the further state has the covariance ``across`` with what is measured."""
    inverse = inverse_of(innovation_variance(h.variance, r))
    posterior, nis = update(belief, h, innovation, r)
    c, s, k = sixth.column, h.column, across * inverse
    column = Pose(c.x - k * s.x, c.y - k * s.y, c.theta - k * s.theta)
    return posterior, Sixth(sixth.mean + k * innovation, max(sixth.variance - k * across, 0.0), column), nis


@kernel
def correct_both(belief: Belief, sixth: Sixth, z: Pose, R: Variances) -> tuple[Belief, Sixth, float]:
    """Condition on a pose whose errors may be correlated.

    Args:
        belief: Prior mean and covariance.
        sixth: Prior of the further state.
        z: Measured pose; m, m, rad.
        R: Variances and covariances, see `update.independent`. Without covariances the result is that of x, y and heading in
            turn, to the last bit.

    Returns:
        The posteriors, and the normalized innovation squared, without the heading if that was not measured.
    """
    prior, turn = belief.mean, wrap(z.theta - belief.mean.theta)
    a, b, c, (r_x, r_y, r_theta) = independent(R)
    belief, sixth, nis_x = update_both(belief, sixth, of_x(belief.covariance), sixth.column.x, z.x - prior.x, r_x)
    h, across, now = of_row(belief.covariance, (a, 1.0, 0.0)), a * sixth.column.x + sixth.column.y, belief.mean
    belief, sixth, nis_y = update_both(belief, sixth, h, across, a * (z.x - now.x) + (z.y - now.y), r_y)
    h, now = of_row(belief.covariance, (b, c, 1.0)), belief.mean
    across = b * sixth.column.x + c * sixth.column.y + sixth.column.theta
    off = b * (z.x - now.x) + c * (z.y - now.y) + (turn - (now.theta - prior.theta))
    belief, sixth, nis_theta = update_both(belief, sixth, h, across, off, r_theta)
    return wrapped(belief), sixth, nis_x + nis_y + nis_theta
