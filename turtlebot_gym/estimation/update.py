"""Condition a belief on one scalar measurement of any sensor: the only update equation of the package.

A pose whose errors are correlated, a position along a corridor, say, that is known across it, is three such measurements. A
filter may also learn a scalar beside the pose, such as a gyro's bias or the scale of ranges.

References:
    Bierman, *Factorization Methods for Discrete Sequential Estimation* (1977): scalar measurements in turn, made independent.
"""

from __future__ import annotations

from typing import NamedTuple

from turtlebot_gym.kernel import algebra, kernel
from turtlebot_gym.models.angles import wrap
from turtlebot_gym.values import Belief, Covariance, Pose

Variances = tuple[float, ...]


class Projection(NamedTuple):
    """Projection of a covariance on a scalar measurement ``h x``."""

    column: Pose
    """``P h'``: its covariance with each component of the pose."""
    variance: float
    """``h P h'``."""


@algebra
def of_row(P: Covariance, row: tuple[float, float, float]) -> Projection:
    """Project on a weighted sum of x, y and heading, ``h = row``."""
    i, j, k = row
    column = Pose(i * P.xx + j * P.xy + k * P.xt, i * P.xy + j * P.yy + k * P.yt, i * P.xt + j * P.yt + k * P.tt)
    return Projection(column, i * column.x + j * column.y + k * column.theta)


LEAST_VARIANCE, LEAST_SHARE = 1e-12, 1e-12  # of a measurement, m^2 or rad^2; and as a share of what it is compared with


@kernel
def innovation_variance(variance: float, r: float) -> float:
    """Return S, the variance of a scalar measurement's innovation: ``h P h' + r``.

    The noise counts as at least `LEAST_VARIANCE`, and as `LEAST_SHARE` of ``h P h'``. A measurement a million times more
    accurate than the belief would leave nothing of the covariance but rounding, and gains would grow without limit.
    """
    return variance + max(r, max(LEAST_VARIANCE, LEAST_SHARE * variance))


@kernel
def inverse_of(S: float) -> float:
    """Return 1 / S, or 0 for S = 0: a component that is already known and measured without noise."""
    some = S > 1e-300  # the inverse of a smaller number may be infinite
    return 1.0 / (S if some else 1.0) if some else 0.0


@algebra
def absorb(belief: Belief, column: Pose, gain: float, inverse: float) -> Belief:
    """Update a belief by a scalar measurement: ``mean + gain column``, and ``P - inverse column column'``.

    ``column`` is the covariance of the measured quantity with each component of the pose, ``inverse`` is 1 / S for a
    measurement that is certainly accepted. The posterior's heading is not wrapped yet.
    """
    (mean, P), (x, y, t) = belief, column
    i, j, k = x * inverse, y * inverse, t * inverse
    xx, yy, tt = max(P.xx - i * x, 0.0), max(P.yy - j * y, 0.0), max(P.tt - k * t, 0.0)
    covariance = Covariance(xx, P.xy - i * y, P.xt - i * t, yy, P.yt - j * t, tt, P.vv, P.ww)
    return Belief(mean._replace(x=mean.x + gain * x, y=mean.y + gain * y, theta=mean.theta + gain * t), covariance)


@kernel
def update(belief: Belief, h: Projection, innovation: float, r: float) -> tuple[Belief, float]:
    """Condition a belief on one scalar measurement of any sensor, projected on by ``h``, with the variance ``r``.

    Returns:
        The posterior, whose heading is not wrapped yet, and the normalized innovation squared ``innovation^2 / (h P h' + r)``.
    """
    inverse = inverse_of(innovation_variance(h.variance, r))
    gain = innovation * inverse
    return absorb(belief, h.column, gain, inverse), gain * innovation


class Sixth(NamedTuple):
    """A scalar state."""

    mean: float
    variance: float
    column: Pose
    """Its covariance with each component of the robot's pose."""


NOTHING = Sixth(0.0, 0.0, Pose(0.0, 0.0, 0.0))
"""A further state that is known, and correlated with nothing."""


@algebra
def update_both(
    belief: Belief, sixth: Sixth, h: Projection, across: float, innovation: float, r: float
) -> tuple[Belief, Sixth, float]:
    """Condition as `update` does; the further state has the covariance ``across`` with what is measured."""
    inverse = inverse_of(innovation_variance(h.variance, r))
    posterior, nis = update(belief, h, innovation, r)
    c, s, k = sixth.column, h.column, across * inverse
    column = Pose(c.x - k * s.x, c.y - k * s.y, c.theta - k * s.theta)
    return posterior, Sixth(sixth.mean + k * innovation, max(sixth.variance - k * across, 0.0), column), nis


@kernel
def wrapped(belief: Belief) -> Belief:
    """Return a belief with its heading wrapped."""
    return belief._replace(mean=belief.mean._replace(theta=wrap(belief.mean.theta)))


@algebra
def independent(R: Variances) -> tuple[float, float, float, tuple[float, float, float]]:
    """Return the independent measurements of a pose whose errors are correlated.

    The covariance is factored as ``R = L D L'`` with a unit lower triangular L. The rows of ``L^-1`` are the measurements, with
    the variances D. Without correlations they are x, y and heading. See `interface.Filter.fix` for R.

    Returns:
        The factors a, b and c of the measurements x, ``y + a x`` and ``heading + b x + c y``; 1, rad/m, rad/m; and their
        variances, m^2, m^2, rad^2.
    """
    xx, yy, tt, xy, xt, yt = R
    to_x = inverse_of(xx)
    y_by_x, t_by_x = xy * to_x, xt * to_x
    rest = max(yy - y_by_x * xy, 0.0)
    cross = yt - t_by_x * xy
    t_by_y = cross * inverse_of(rest)
    return -y_by_x, t_by_y * y_by_x - t_by_x, -t_by_y, (xx, rest, max(tt - t_by_x * xt - t_by_y * cross, 0.0))


@algebra
def correct_both(belief: Belief, sixth: Sixth, z: Pose, R: Variances) -> tuple[Belief, Sixth, float]:
    """Condition on a measured pose whose errors may be correlated, see `interface.Filter.fix` for R.

    Returns:
        The posteriors, and the normalized innovation squared, without the heading if that was not measured.
    """
    prior, turn = belief.mean, wrap(z.theta - belief.mean.theta)
    a, b, c, (r_x, r_y, r_theta) = independent(R)
    belief, sixth, nis_x = update_both(
        belief, sixth, of_row(belief.covariance, (1.0, 0.0, 0.0)), sixth.column.x, z.x - prior.x, r_x
    )
    h, across, now = of_row(belief.covariance, (a, 1.0, 0.0)), a * sixth.column.x + sixth.column.y, belief.mean
    belief, sixth, nis_y = update_both(belief, sixth, h, across, a * (z.x - now.x) + (z.y - now.y), r_y)
    h, now = of_row(belief.covariance, (b, c, 1.0)), belief.mean
    across = b * sixth.column.x + c * sixth.column.y + sixth.column.theta
    off = b * (z.x - now.x) + c * (z.y - now.y) + (turn - (now.theta - prior.theta))
    belief, sixth, nis_theta = update_both(belief, sixth, h, across, off, r_theta)
    return wrapped(belief), sixth, nis_x + nis_y + nis_theta
