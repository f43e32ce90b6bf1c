"""A pose from one scan alone: the belief is only where the descent starts, so wheels and earlier scans do not count."""

from __future__ import annotations

from typing import Any

from turtlebot_gym.estimation.sixth import Sixth
from turtlebot_gym.kernel import kernel
from turtlebot_gym.localization.descent import SETTLED
from turtlebot_gym.localization.information import Guess, ScanPoints, information
from turtlebot_gym.values import Belief, Covariance, Pose, State

WEAK = 4.0
"""Information of the start, 1/m^2 and 1/rad^2: half a metre and half a radian. It keeps an endless corridor solvable."""
STEPS = 10
"""Most Gauss-Newton steps."""


@kernel
def alone(
    field: Any, frame: Any, points: Any, number: int, start: Pose, scale: float, q: Any, covariance: Any
) -> tuple[Pose, float]:
    """Return the pose that explains a scan, and the share of its beams that fit.

    Args:
        field: Distances, see `rooms.field`.
        frame: Their frame.
        points: The scan, see `points.to_points`.
        number: Number of points.
        start: Where the descent starts.
        scale: Share by which ranges are too long.
        q: A `LocalizerTuning`.
        covariance: Output, the pose's covariance with errors of the map, shape (3, 3); m^2, m, rad^2.
    """
    sight = ScanPoints(field, frame, points, number)
    x, y, theta, fits = start.x, start.y, start.theta, 0.0
    nothing = Covariance(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    belief = Belief(State(x, y, theta, 0.0, 0.0), nothing)  # weights by the beams' own variances
    sixth = Sixth(scale, 0.0, State(0.0, 0.0, 0.0, 0.0, 0.0))
    for _ in range(STEPS):
        L = information(sight, Guess(x, y, theta, scale), belief, sixth, q)
        fits = L.fits
        gx, gy, gt = L.x + WEAK * (x - start.x), L.y + WEAK * (y - start.y), L.theta + WEAK * (theta - start.theta)
        # The inverse of the symmetric 3 x 3 matrix by its cofactors.
        a, b, c, d, e, f = L.xx + WEAK, L.xy, L.xt, L.yy + WEAK, L.yt, L.tt + WEAK
        xx, xy, xt = d * f - e * e, c * e - b * f, b * e - c * d
        share = 1.0 / (a * xx + b * xy + c * xt)
        xx, xy, xt = xx * share, xy * share, xt * share
        yy, yt, tt = (a * f - c * c) * share, (b * c - a * e) * share, (a * d - b * b) * share
        covariance[0, 0], covariance[0, 1], covariance[0, 2] = xx + q.bias * q.bias, xy, xt
        covariance[1, 0], covariance[1, 1], covariance[1, 2] = xy, yy + q.bias * q.bias, yt
        covariance[2, 0], covariance[2, 1], covariance[2, 2] = xt, yt, tt + q.turn_bias * q.turn_bias
        dx, dy, turn = xx * gx + xy * gy + xt * gt, xy * gx + yy * gy + yt * gt, xt * gx + yt * gy + tt * gt
        x, y, theta = x - dx, y - dy, theta - turn
        if abs(dx) + abs(dy) + abs(turn) < SETTLED:
            break
    return Pose(x, y, theta), fits
