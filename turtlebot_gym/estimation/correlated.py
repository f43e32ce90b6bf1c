"""Condition a belief on a measured pose whose errors are correlated: a position along a corridor, say, that is known across it.

The covariance is factored as ``R = L D L'`` with a unit lower triangular L. The rows of ``L^-1`` then are three scalar
measurements with independent errors of the variances D, for the only update equation of the package, as the localizer makes
them of a scan's information. Without correlations they are x, y and heading.

References:
    Bierman, *Factorization Methods for Discrete Sequential Estimation* (1977): measurements made independent.
"""

from __future__ import annotations

from typing import NamedTuple

from turtlebot_gym.estimation.update import Variances, innovation_variance, inverse_of, of_row, of_x, update, wrapped
from turtlebot_gym.kernel import kernel
from turtlebot_gym.models.angles import wrap
from turtlebot_gym.values import Belief, Pose


class Independent(NamedTuple):
    """Independent measurements: x, ``y + a x`` and ``heading + b x + c y``."""

    a: float
    b: float
    """rad/m"""
    c: float
    """rad/m"""
    variances: tuple[float, float, float]
    """m^2, m^2, rad^2"""


@kernel
def independent(R: Variances) -> Independent:
    """Return the independent measurements of a pose.

    Args:
        R: Variances of x, y and heading, and covariances of x and y, of x and heading, of y and heading; m^2 and rad^2. An
            infinite variance means that the heading was not measured; its covariances are 0.
    """
    xx, yy, tt, xy, xt, yt = R
    to_x = inverse_of(xx)
    y_by_x, t_by_x = xy * to_x, xt * to_x
    rest = max(yy - y_by_x * xy, 0.0)
    cross = yt - t_by_x * xy
    t_by_y = cross * inverse_of(rest)
    return Independent(-y_by_x, t_by_y * y_by_x - t_by_x, -t_by_y, (xx, rest, max(tt - t_by_x * xt - t_by_y * cross, 0.0)))


@kernel
def correct_correlated(belief: Belief, z: Pose, R: Variances) -> tuple[Belief, float, float]:
    """Condition the belief on a pose whose errors may be correlated, with R as in `independent`.

    Returns:
        What `ekf.correct_pose` returns, to the last bit the same without correlations.
    """
    prior, turn = belief.mean, wrap(z.theta - belief.mean.theta)
    a, b, c, (r_x, r_y, r_theta) = independent(R)
    h = of_x(belief.covariance)
    belief, nis_x = update(belief, h, z.x - prior.x, r_x)
    precision = inverse_of(innovation_variance(h, r_x))
    h, now = of_row(belief.covariance, (a, 1.0, 0.0)), belief.mean
    belief, nis_y = update(belief, h, a * (z.x - now.x) + (z.y - now.y), r_y)
    precision = precision * inverse_of(innovation_variance(h, r_y))
    h, now = of_row(belief.covariance, (b, c, 1.0)), belief.mean
    off = b * (z.x - now.x) + c * (z.y - now.y) + (turn - (now.theta - prior.theta))
    belief, nis_theta = update(belief, h, off, r_theta)
    inverse = inverse_of(innovation_variance(h, r_theta))
    return wrapped(belief), nis_x + nis_y + nis_theta, precision * (inverse if inverse > 0.0 else 1.0)
