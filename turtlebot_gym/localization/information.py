"""What a scan says about a pose: its Fisher information in a distance field, and a belief conditioned on it.

The residual of a beam is the signed distance d of its end from the nearest surface of the map, with the Jacobian
``J = (gx, gy, g x r, -(g u) rho)`` for x, y, heading and the scale of the ranges: g is the field's gradient, r the end as seen
from the robot, u the beam's direction, rho its range. Its variance is ``R = (g u)^2 sigma(rho)^2 + grain^2``. The information
``sum w J'J / R`` is singular along a corridor without ends, and nothing here inverts it.

References:
    Censi, "On achievable accuracy for range-finder localization", ICRA (2007): the information of a scan.
    Thrun, Burgard, Fox, *Probabilistic Robotics* (2005), section 6.4: the likelihood field.
    Bierman, *Factorization Methods for Discrete Sequential Estimation* (1977): sequential scalar measurements.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from turtlebot_gym.estimation.update import Projection, Sixth, of_row, update_both
from turtlebot_gym.kernel import kernel
from turtlebot_gym.localization.points import DX, DY, LENGTH, X, Y
from turtlebot_gym.localization.tuning import LocalizerTuning
from turtlebot_gym.models.angles import sincos
from turtlebot_gym.rooms.field import sample
from turtlebot_gym.values import Belief, Covariance, Pose

FLAT = 0.5
"""Square of the gradient below which an end within a surface is about as far from its other side ..."""
BACK = 2.0
"""... and how far before it along the beam, in cells, the side is in sight that the beam has met: in a wall of two cells the
field is flat. Without it, ranges that are too long would inform less than those that are too short."""
NEAR = 0.15  # distance from a surface up to which a beam fits, m, whatever the belief
LEAST_PIVOT = 1e-10
"""Share of a diagonal entry below which a pivot is rounding: there is no information in its direction."""
BLOCK = 32
"""Beams that are worked on at a time, in loops that LLVM vectorizes, on numbers in one array at offsets that it knows."""
_TO_X, _TO_Y, _LENGTH, _UX, _UY, _KNOWN, _D, _GX, _GY, _ALONG, _BEYOND, _GT, _GS, _WEIGHT, _FITS = range(0, 15 * BLOCK, BLOCK)
ROOM = 15 * BLOCK


class ScanPoints(NamedTuple):
    """A map as distances and their frame, see `rooms.field`, and the points of the scan that is sought in it."""

    field: Any
    frame: Any
    points: Any
    number: int


class Guess(NamedTuple):
    """A pose, m and rad, not wrapped, and the share by which ranges are too long."""

    x: float
    y: float
    theta: float
    scale: float


class Information(NamedTuple):
    """Information of a scan at a guess: the symmetric 4 x 4 matrix, row by row from the diagonal on, and the gradient of half
    the sum of squared residuals, which points away from the best guess; 1/m^2, 1/m."""

    xx: float
    xy: float
    xt: float
    xs: float
    yy: float
    yt: float
    ys: float
    tt: float
    ts: float
    ss: float
    x: float
    y: float
    theta: float
    scale: float
    fits: float
    """Share of all beams that end near a surface; what lies in the unknown does not fit."""
    used: float
    """Number of beams that end where the map is known."""


@kernel
def _look_back(room: Any, k: int, field: Any, frame: Any, at: Guess, q: LocalizerTuning) -> None:
    """Measure the residual from the side that the beam has met, where the end is nearer to the other side of a wall."""
    ux, uy, d, side = float(room[_UX + k]), float(room[_UY + k]), float(room[_D + k]), float(frame[4])
    to_x, to_y, back = float(room[_TO_X + k]), float(room[_TO_Y + k]), BACK * side
    ahead, before, bx, by = sample(field, frame, at.x + to_x - back * ux, at.y + to_y - back * uy)
    towards = bx * ux + by * uy
    if ahead and towards < -q.thin:
        room[_D + k], room[_GX + k], room[_GY + k], room[_ALONG + k] = before + back * towards, bx, by, towards
    elif d > 0.0:
        room[_D + k], room[_ALONG + k] = -d - side, -float(room[_ALONG + k])
        room[_GX + k], room[_GY + k] = -float(room[_GX + k]), -float(room[_GY + k])


@kernel
def _rate(room: Any, k: int, P: Covariance, sixth: Sixth, q: LocalizerTuning, drift: float) -> None:
    """Write the derivatives of a beam's residual by heading and scale, its weight, and whether it fits; 0 in the unknown."""
    known, d, gx, gy = room[_KNOWN + k] != 0.0, float(room[_D + k]), float(room[_GX + k]), float(room[_GY + k])
    along, length, c, wide = float(room[_ALONG + k]), float(room[_LENGTH + k]), sixth.column, q.gate * q.gate
    deviation = max(q.deviation, q.deviation_share * length)
    gt, gs = gy * float(room[_TO_X + k]) - gx * float(room[_TO_Y + k]), -along * length
    R = along * along * deviation * deviation + q.grain * q.grain + gt * gt * drift
    S = (
        R
        + gx * gx * P.xx
        + gy * gy * P.yy
        + gt * gt * P.tt
        + gs * gs * sixth.variance
        + 2.0 * (gx * gy * P.xy + gx * gt * P.xt + gy * gt * P.yt + gs * (gx * c.x + gy * c.y + gt * c.theta))
    )
    weight = 1.0 / (1.0 + d * d / (max(S, R) * wide))
    room[_GT + k], room[_GS + k], room[_WEIGHT + k] = gt, gs, weight * weight / R if known else 0.0
    room[_FITS + k] = 1.0 if known & (d * d < max(NEAR * NEAR, wide * R)) else 0.0


@kernel
def information(
    sight: ScanPoints, at: Guess, belief: Belief, sixth: Sixth, q: LocalizerTuning, drift: float = 0.0
) -> Information:
    """Return the information of a scan at a guess, with the weights of Geman and McClure.

    Their width is that of the innovation by the prior ``belief`` and ``sixth``, so that a wide belief forgives large residuals.
    ``drift`` is the variance of the heading by the wheels since the first beam was measured, rad^2: older beams say less.
    """
    field, frame, points, number = sight
    sine, cosine = sincos(at.theta)
    stretch = 1.0 / (1.0 + at.scale) - 1.0
    room = np.empty(ROOM)
    xx = xy = xt = xs = yy = yt = ys = tt = ts = ss = x = y = theta = scale = fits = used = 0.0
    for first in range(0, number, BLOCK):
        some = min(number - first, BLOCK)
        for k in range(some):
            length, dx, dy = float(points[LENGTH, first + k]), float(points[DX, first + k]), float(points[DY, first + k])
            end_x = float(points[X, first + k]) + length * stretch * dx
            end_y = float(points[Y, first + k]) + length * stretch * dy
            to_x, to_y = cosine * end_x - sine * end_y, sine * end_x + cosine * end_y
            ux, uy = cosine * dx - sine * dy, sine * dx + cosine * dy
            known, d, gx, gy = sample(field, frame, at.x + to_x, at.y + to_y)
            d, gx, gy = d if known else 0.0, gx if known else 0.0, gy if known else 0.0
            along, is_inside = gx * ux + gy * uy, (d < 0.0) & (gx * gx + gy * gy < FLAT) & (q.thin <= 1.0)
            room[_TO_X + k], room[_TO_Y + k], room[_LENGTH + k], room[_UX + k], room[_UY + k] = to_x, to_y, length, ux, uy
            room[_KNOWN + k], room[_D + k], room[_GX + k], room[_GY + k] = 1.0 if known else 0.0, d, gx, gy
            room[_ALONG + k], room[_BEYOND + k] = along, 1.0 if (along > q.thin) | is_inside else 0.0
        for k in range(some):
            if room[_BEYOND + k] != 0.0:
                _look_back(room, k, field, frame, at, q)
        for k in range(some):
            _rate(room, k, belief.covariance, sixth, q, drift * (number - 1 - first - k) / number)
        for k in range(some):
            gx, gy, gt, gs = float(room[_GX + k]), float(room[_GY + k]), float(room[_GT + k]), float(room[_GS + k])
            weight, d = float(room[_WEIGHT + k]), float(room[_D + k])
            fits, used = fits + float(room[_FITS + k]), used + float(room[_KNOWN + k])
            wx, wy, wt, ws = weight * gx, weight * gy, weight * gt, weight * gs
            xx, xy, xt, xs = xx + wx * gx, xy + wx * gy, xt + wx * gt, xs + wx * gs
            yy, yt, ys = yy + wy * gy, yt + wy * gt, ys + wy * gs
            tt, ts, ss = tt + wt * gt, ts + wt * gs, ss + ws * gs
            x, y, theta, scale = x + wx * d, y + wy * d, theta + wt * d, scale + ws * d
    return Information(xx, xy, xt, xs, yy, yt, ys, tt, ts, ss, x, y, theta, scale, fits / max(number, 1), used)


@kernel
def _minus(L: Information, v: tuple[float, float, float, float], by: float, gradient: float) -> Information:
    """Return ``L - v v' by``, with the gradient reduced by ``v by`` times one of its entries."""
    a, b, c, d = v
    i, j, k, m = a * by, b * by, c * by, d * by
    matrix = (i * a, i * b, i * c, i * d, j * b, j * c, j * d, k * c, k * d, m * d)
    less = (*matrix, i * gradient, j * gradient, k * gradient, m * gradient, 0.0, 0.0)
    return Information(*[entry - change for entry, change in zip(L, less, strict=True)])


@kernel
def blurred(L: Information, position: float, heading: float) -> Information:
    """Return the information of a scan whose pose has a further error, common to all its beams, of some variances, m^2, rad^2.

    ``(L^-1 + C)^-1`` with a diagonal C, by the Sherman-Morrison formula, one entry after the other, without inverting L.
    """
    L = _minus(L, (L.xx, L.xy, L.xt, L.xs), position / (1.0 + position * L.xx), L.x)
    L = _minus(L, (L.xy, L.yy, L.yt, L.ys), position / (1.0 + position * L.yy), L.y)
    return _minus(L, (L.xt, L.yt, L.tt, L.ts), heading / (1.0 + heading * L.tt), L.theta)


@kernel
def _absorb(
    belief: Belief, sixth: Sixth, at: Guess, row: tuple[float, float, float, float], pivot: float, gradient: float, least: float
) -> tuple[Belief, Sixth, float]:
    """Condition on ``row (state - at) = -gradient / pivot``, of variance 1 / pivot, unless the pivot is below ``least``."""
    if not pivot > least:
        return belief, sixth, 0.0
    x, y, t, s = row
    mean, c = belief.mean, sixth.column
    h = of_row(belief.covariance, (x, y, t))
    across = x * c.x + y * c.y + t * c.theta + s * sixth.variance
    p = h.column
    column = Pose(p.x + s * c.x, p.y + s * c.y, p.theta + s * c.theta)
    variance = x * column.x + y * column.y + t * column.theta + s * across
    off = x * (mean.x - at.x) + y * (mean.y - at.y) + t * (mean.theta - at.theta) + s * (sixth.mean - at.scale)
    return update_both(belief, sixth, Projection(column, max(variance, 0.0)), across, -gradient / pivot - off, 1.0 / pivot)


@kernel
def condition(belief: Belief, sixth: Sixth, at: Guess, L: Information) -> tuple[Belief, Sixth, float, float]:
    """Condition a belief, and the scale of the ranges, on the information of a scan that was linearized at a guess.

    The factors ``L = U' D U`` with a unit upper triangular U make of it up to four scalar measurements with the rows of U and
    the variances 1 / D, for the only update equation of the package. A pivot of zero says nothing.

    Returns:
        The posteriors, whose heading is not wrapped; the normalized innovation squared, and its degrees of freedom.
    """
    nis, freedom = 0.0, 0.0
    xx, xy, xt, xs, yy, yt, ys, tt, ts, ss, gx, gy, gt, gs, _, _ = L
    inverse = 1.0 / xx if xx > 0.0 else 0.0
    y, t, s = xy * inverse, xt * inverse, xs * inverse
    belief, sixth, part = _absorb(belief, sixth, at, (1.0, y, t, s), xx, gx, 0.0)
    nis, freedom = nis + part, freedom + (1.0 if xx > 0.0 else 0.0)
    least_y, least_t, least_s = LEAST_PIVOT * yy, LEAST_PIVOT * tt, LEAST_PIVOT * ss
    yy, yt, ys, tt, ts, ss = yy - y * xy, yt - y * xt, ys - y * xs, tt - t * xt, ts - t * xs, ss - s * xs
    gy, gt, gs = gy - y * gx, gt - t * gx, gs - s * gx

    inverse = 1.0 / yy if yy > least_y else 0.0
    t, s = yt * inverse, ys * inverse
    belief, sixth, part = _absorb(belief, sixth, at, (0.0, 1.0, t, s), yy, gy, least_y)
    nis, freedom = nis + part, freedom + (1.0 if yy > least_y else 0.0)
    tt, ts, ss, gt, gs = tt - t * yt, ts - t * ys, ss - s * ys, gt - t * gy, gs - s * gy

    inverse = 1.0 / tt if tt > least_t else 0.0
    s = ts * inverse
    belief, sixth, part = _absorb(belief, sixth, at, (0.0, 0.0, 1.0, s), tt, gt, least_t)
    nis, freedom = nis + part, freedom + (1.0 if tt > least_t else 0.0)
    belief, sixth, part = _absorb(belief, sixth, at, (0.0, 0.0, 0.0, 1.0), ss - s * ts, gs - s * gt, least_s)
    return belief, sixth, nis + part, freedom
