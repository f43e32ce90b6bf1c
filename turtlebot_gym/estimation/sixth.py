"""A state beside the pose: a scalar that a filter learns, such as a gyro's bias or the scale of ranges.

A pose has its covariance written out; a further state needs its mean, its variance and its covariance with the pose.
"""

from __future__ import annotations

from typing import NamedTuple

from turtlebot_gym.estimation.ekf import innovation
from turtlebot_gym.estimation.gate import choose, judge, restart
from turtlebot_gym.estimation.update import (
    Projection,
    Variances,
    independent,
    innovation_variance,
    inverse_of,
    of_heading,
    of_row,
    of_x,
    of_y,
    update,
    wrapped,
)
from turtlebot_gym.kernel import kernel
from turtlebot_gym.models.angles import wrap
from turtlebot_gym.parameters import FilterTuning
from turtlebot_gym.values import Belief, Pose


class Sixth(NamedTuple):
    """A scalar state."""

    mean: float
    variance: float
    column: Pose
    """Its covariance with each component of the robot's pose."""


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
def correct_both(belief: Belief, sixth: Sixth, z: Pose, R: Variances, turn: float) -> tuple[Belief, Sixth, float]:
    """Condition on a measured pose with the innovation ``turn``; return the NIS, too."""
    prior = belief.mean.theta
    belief, sixth, nis_x = update_both(belief, sixth, of_x(belief.covariance), sixth.column.x, z.x - belief.mean.x, R[0])
    belief, sixth, nis_y = update_both(belief, sixth, of_y(belief.covariance), sixth.column.y, z.y - belief.mean.y, R[1])
    turn = turn - (belief.mean.theta - prior)
    belief, sixth, nis = update_both(belief, sixth, of_heading(belief.covariance), sixth.column.theta, turn, R[2])
    return wrapped(belief), sixth, nis_x + nis_y + nis


@kernel
def correct_both_correlated(belief: Belief, sixth: Sixth, z: Pose, R: Variances) -> tuple[Belief, Sixth]:
    """Condition on a pose whose errors may be correlated, with R as in `update.independent`."""
    prior, turn = belief.mean, wrap(z.theta - belief.mean.theta)
    a, b, c, (r_x, r_y, r_theta) = independent(R)
    belief, sixth, _ = update_both(belief, sixth, of_x(belief.covariance), sixth.column.x, z.x - prior.x, r_x)
    h, across, now = of_row(belief.covariance, (a, 1.0, 0.0)), a * sixth.column.x + sixth.column.y, belief.mean
    belief, sixth, _ = update_both(belief, sixth, h, across, a * (z.x - now.x) + (z.y - now.y), r_y)
    h, now = of_row(belief.covariance, (b, c, 1.0)), belief.mean
    across = b * sixth.column.x + c * sixth.column.y + sixth.column.theta
    off = b * (z.x - now.x) + c * (z.y - now.y) + (turn - (now.theta - prior.theta))
    belief, sixth, _ = update_both(belief, sixth, h, across, off, r_theta)
    return wrapped(belief), sixth


@kernel
def settle_both(
    rejections: float,
    prior: Belief,
    sixth: Sixth,
    z: Pose,
    measured: bool,
    tuning: FilterTuning,
    dt: float,
) -> tuple[Belief, Sixth, float, float]:
    """Correct by a measured pose, unless there is none or the gate refuses it.

    A filter that starts anew keeps its further state, which then has no covariance with the pose.

    Returns:
        Belief and further state, the NIS, and the number of refusals in a row.
    """
    posterior, corrected, nis = correct_both(prior, sixth, z, tuning.R, innovation(prior.mean, z).theta)
    verdict = judge(rejections, measured, nis > tuning.kind.gate, tuning, dt)
    belief = choose(verdict, measured, prior, posterior, restart(prior, z, tuning))
    lost, takes = verdict.lost, measured & (nis <= tuning.kind.gate)
    old, new = sixth.column, corrected.column
    column = Pose(
        0.0 if lost else (new.x if takes else old.x),
        0.0 if lost else (new.y if takes else old.y),
        0.0 if lost else (new.theta if takes else old.theta),
    )
    mean, variance = (corrected.mean if takes else sixth.mean), (corrected.variance if takes else sixth.variance)
    return belief, Sixth(mean, variance, column), nis, verdict.rejections
