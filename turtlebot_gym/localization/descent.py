"""The descent of a belief to where a scan fits, by Gauss-Newton steps from the prediction.

A bad fit there may be a local minimum: the descent is then also tried from starts all around the belief.

Beams speak for a pose, or against it if they pass through a surface of the map; the unknown says nothing. A beam that ends
before the surface that it should meet may have met what moves, or what is not on the map; it says little about the place,
whether that is right or wrong. A beam that goes on behind a wall cannot be explained like that.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from turtlebot_gym.estimation.update import Sixth
from turtlebot_gym.kernel import kernel, sqrt
from turtlebot_gym.localization.information import NEAR, Guess, ScanPoints, blurred, condition, information
from turtlebot_gym.localization.points import DX, DY, LENGTH, X, Y
from turtlebot_gym.localization.tuning import LocalizerTuning
from turtlebot_gym.models.angles import sincos, wrap
from turtlebot_gym.rooms.field import at_cell
from turtlebot_gym.values import Belief

LEAST_BEAMS = 5  # fewest beams on known ground that a scan needs
SETTLED = 1e-4  # sum of the changes, m and rad, at which the descent ends
STARTS = 4  # starts from which the descent is tried
BETTER_FIT, BETTER_VALUE = 0.1, 1.0
"""By how much another start's share of fitting beams and log likelihood must be better than that of the prediction."""
SIDE = 0.14  # distance between two starts, m
WIDTH = 0.2
"""Residual at which a beam's `agreement` has fallen to a half, m, for starts; the descent takes them the rest of the way."""
APART, TURNED = 0.2, 0.12  # distance and turn from which on two starts, or two hypotheses, are different ones; m, rad
MOST_ALONG, MOST_TURNS = 6, 48
"""Most starts on each side of the prediction along an axis, and in heading: a leap of odometry's heading is within."""
WIDE = 3.0  # standard deviations of the prediction's heading that starts span, where that is more than `swing`
ON_SURFACE = 0.75  # distance within which a beam is at a surface, in cells
BEGIN = 0.1  # distance from the LiDAR from which on a beam is followed, m: the robot itself may stand close to a wall
SILENT_BEAMS = 0.2
"""Share of a scan's beams that may end in the unknown without a loss: a pose of which the map knows little is not confirmed."""
AGAINST = 0.1  # share of beams that must speak against a pose to contradict it
BLIND_STEP = 4.0  # step of a beam through the unknown, in cells


class Descent(NamedTuple):
    """Result of a descent."""

    belief: Belief
    scale: Sixth
    at: Guess
    nis: float
    freedom: float
    fits: float
    used: float
    agrees: float
    """Share of beams that agree, see `agreeing`."""


@kernel
def distance_at(field: Any, frame: Any, x: float, y: float) -> float:
    """Return the distance of the cell at a point, m; NaN in the unknown and beside the map."""
    rows, columns = field.shape
    dx, dy, per_cell = x - float(frame[0]), y - float(frame[1]), 1.0 / float(frame[4])
    across = (dx * float(frame[2]) + dy * float(frame[3])) * per_cell
    up = (dy * float(frame[2]) - dx * float(frame[3])) * per_cell
    inside = (across >= 0.0) & (up >= 0.0) & (across < columns) & (up < rows)
    return at_cell(field, int(up), int(across)) if inside else float("nan")


@kernel
def verdict(sight: ScanPoints, at: Guess, q: LocalizerTuning) -> tuple[float, float, float]:
    """Return the shares of a scan's beams that speak for a pose, against it, and not at all.

    For it are ends near a surface, against it beams through a surface, and `short` of those that end short.
    """
    field, frame, points, number = sight
    sine, cosine = sincos(at.theta)
    side, fit, against, silent = float(frame[4]), 0.0, 0.0, 0.0
    for k in range(number):
        length, dx, dy = float(points[LENGTH, k]), float(points[DX, k]), float(points[DY, k])
        end_x, end_y = float(points[X, k]), float(points[Y, k])
        x, y = at.x + cosine * end_x - sine * end_y, at.y + sine * end_x + cosine * end_y
        ux, uy = cosine * dx - sine * dy, sine * dx + cosine * dy
        deviation = max(q.deviation, q.deviation_share * length)
        near = max(NEAR, q.gate * sqrt(deviation * deviation + q.grain * q.grain))
        d = distance_at(field, frame, x, y)
        if d == d and abs(d) < near:
            fit += 1.0
            continue
        passes, back = False, length - BEGIN
        while back > near and not passes:
            before = distance_at(field, frame, x - back * ux, y - back * uy)
            passes = before < ON_SURFACE * side
            back -= max(before - 0.5 * side, side) if before == before else BLIND_STEP * side
        against += 1.0 if passes else (q.short if d == d else 0.0)
        silent += 0.0 if passes or d == d else 1.0
    return fit / max(number, 1), against / max(number, 1), silent / max(number, 1)


@kernel
def agreeing(sight: ScanPoints, at: Guess, q: LocalizerTuning) -> float:
    """Return the share of the beams that speak for a pose among those that speak; too many silent ones count as against it."""
    fit, against, silent = verdict(sight, at, q)
    return fit / max(fit + against + max(silent - SILENT_BEAMS, 0.0), 1e-9)


@kernel
def descend(
    sight: ScanPoints, prior: Belief, scale: Sixth, at: Guess, bias: tuple[float, float], q: LocalizerTuning, drift: float = 0.0
) -> Descent:
    """Return the belief conditioned on a scan, linearized anew at each step from a start on; unchanged with too few beams.

    ``bias`` has the variances of the scan's position and heading by errors of the map, m^2 and rad^2; ``drift`` is that of
    `information`, rad^2.
    """
    end = Descent(prior, scale, at, 0.0, 0.0, 0.0, 0.0, 0.0)
    for step in range(int(q.iterations)):
        is_wide = step < q.wide_steps
        L = information(sight, end.at, prior if is_wide else end.belief, scale if is_wide else end.scale, q, drift)
        if L.used < LEAST_BEAMS:
            return Descent(prior, scale, at, 0.0, 0.0, 0.0, L.used, 0.0)
        belief, sixth, nis, freedom = condition(prior, scale, end.at, blurred(L, bias[0], bias[1]))
        to, was = Guess(belief.mean.x, belief.mean.y, belief.mean.theta, sixth.mean), end.at
        end = Descent(belief, sixth, to, nis, freedom, L.fits, L.used, L.fits)
        change = abs(to.x - was.x) + abs(to.y - was.y) + abs(to.theta - was.theta) + abs(to.scale - was.scale)
        if change < SETTLED and (step >= q.wide_steps or q.wide_steps >= q.iterations):
            break
    return end


@kernel
def widened(belief: Belief, position: float, heading: float) -> Belief:
    """Return a belief with further variances of position and heading, m^2 and rad^2."""
    P = belief.covariance
    return belief._replace(covariance=P._replace(xx=P.xx + position, yy=P.yy + position, tt=P.tt + heading))


@kernel
def agreement(sight: ScanPoints, at: Guess, width: float, unknown: float = 0.0) -> float:
    """Return the mean over a scan's beams of ``1 / (1 + d^2 / width^2)``: a soft share of those that fit, without a prior.

    The nearest cell's distance, m, is enough for it. A beam that ends in the unknown counts ``unknown``.
    """
    field, frame, points, number = sight
    rows, columns = field.shape
    per_cell, per_square, dx, dy = 1.0 / frame[4], 1.0 / (width * width), at.x - frame[0], at.y - frame[1]
    sine, cosine = sincos(at.theta)
    size = per_cell / (1.0 + at.scale)
    forward, left = (cosine * frame[2] + sine * frame[3]) * size, (sine * frame[2] - cosine * frame[3]) * size
    column, row = (dx * frame[2] + dy * frame[3]) * per_cell, (dy * frame[2] - dx * frame[3]) * per_cell
    total = 0.0
    for k in range(number):
        across = column + forward * points[X, k] - left * points[Y, k]
        up = row + left * points[X, k] + forward * points[Y, k]
        inside = (across >= 0.0) & (up >= 0.0) & (across < columns) & (up < rows)
        d = at_cell(field, int(up), int(across)) if inside else float("nan")
        total += 1.0 / (1.0 + d * d * per_square) if d == d else unknown
    return total / max(number, 1)


@kernel
def keep(best: Any, values: Any, count: int, guess: tuple[float, ...], value: float, apart: float, turned: float) -> int:
    """Put a guess into a list of the best, best first, at most one within a distance and a turn; return the list's length.

    A guess is x, y, heading, and further numbers to keep with them; ``best`` has shape (K, n), ``values`` shape (K,), and
    ``count`` of their rows are in use.
    """
    last = count
    for k in range(count):
        dx, dy = best[k, 0] - guess[0], best[k, 1] - guess[1]
        if dx * dx + dy * dy < apart * apart and abs(wrap(best[k, 2] - guess[2])) < turned:
            if values[k] >= value:
                return count
            last = k
            break
    if last == len(best):
        if value <= values[last - 1]:
            return count
        last -= 1
    at = last
    while at > 0 and values[at - 1] < value:
        values[at], best[at] = values[at - 1], best[at - 1]
        at -= 1
    values[at] = value
    for k in range(len(guess)):
        best[at, k] = guess[k]
    return max(count, last + 1)


@kernel
def gain_of(number: int, q: LocalizerTuning) -> float:
    """Return how much log likelihood an agreement of 1 is worth: what the weights of Geman and McClure say, tempered."""
    return 0.5 * q.gate * q.gate * q.temper * number


@kernel
def _starts_around(sight: ScanPoints, belief: Belief, q: LocalizerTuning, starts: Any, values: Any) -> int:
    """Write the best poses of a lattice around a belief, shape (K, 3), and their values; return their number.

    It spans two standard deviations, at least `reach` and `swing`. The value of a pose is its tempered log likelihood less half
    its squared Mahalanobis distance from the belief.
    """
    mean, P = belief
    var_x, var_y = P.xx + 0.25 * q.reach * q.reach, P.yy + 0.25 * q.reach * q.reach
    var_theta = P.tt + 0.25 * q.swing * q.swing
    total = 0.0
    for k in range(sight.number):
        total += sight.points[LENGTH, k]
    # A turn moves the end of a mean beam by the distance between two starts.
    turn = min(max(SIDE / max(total / max(sight.number, 1), 0.5), 0.02), 0.1)
    in_x, in_y = min(int(2.0 * sqrt(var_x) / SIDE) + 1, MOST_ALONG), min(int(2.0 * sqrt(var_y) / SIDE) + 1, MOST_ALONG)
    widest = max(2.0 * sqrt(var_theta), WIDE * sqrt(P.tt))
    in_turn, gain, count = min(int(widest / turn) + 1, MOST_TURNS), gain_of(sight.number, q), 0
    for a in range(-in_turn, in_turn + 1):
        for i in range(-in_y, in_y + 1):
            for j in range(-in_x, in_x + 1):
                dx, dy, dtheta = j * SIDE, i * SIDE, a * turn
                value = -0.5 * (dx * dx / var_x + dy * dy / var_y + dtheta * dtheta / var_theta)
                if count == len(starts) and gain + value <= values[count - 1]:
                    continue
                x, y, theta = mean.x + dx, mean.y + dy, mean.theta + dtheta
                value += gain * agreement(sight, Guess(x, y, theta, 0.0), WIDTH)
                count = keep(starts, values, count, (x, y, theta), value, APART, TURNED)
    return count


@kernel
def likelihood(sight: ScanPoints, at: Guess, belief: Belief, q: LocalizerTuning, width: float = 0.1) -> float:
    """Return the value of a descended guess: its tempered log likelihood less half its squared Mahalanobis distance."""
    mean, P = belief
    a, b, c = at.x - mean.x, at.y - mean.y, at.theta - mean.theta
    # The distance by Cholesky factors of the pose's 3 x 3 covariance.
    l11 = sqrt(max(P.xx, 1e-18))
    l21, l31 = P.xy / l11, P.xt / l11
    l22 = sqrt(max(P.yy - l21 * l21, 1e-18))
    l32 = (P.yt - l31 * l21) / l22
    l33 = sqrt(max(P.tt - l31 * l31 - l32 * l32, 1e-18))
    u = a / l11
    v = (b - l21 * u) / l22
    w = (c - l31 * u - l32 * v) / l33
    return gain_of(sight.number, q) * agreement(sight, at, width) - 0.5 * (u * u + v * v + w * w)


@kernel
def best_descent(
    sight: ScanPoints, now: Belief, scale: Sixth, bias: tuple[float, float], q: LocalizerTuning, drift: float
) -> Descent:
    """Return the descent from the prediction, or if that is in doubt, a better one from a start around it; see `descend`."""
    wide = widened(now, 0.25 * q.reach * q.reach, 0.25 * q.swing * q.swing)
    start = Guess(now.mean.x, now.mean.y, now.mean.theta, scale.mean)
    best, value, least = Descent(now, scale, start, 0.0, 0.0, 0.0, 0.0, 0.0), -1e300, -1.0
    starts, values, count, k = np.empty((STARTS, 3)), np.empty(STARTS), 0, -1
    while k < count:  # a single call of the descent: code for a second one would take long to compile
        if k >= 0:
            start = Guess(starts[k, 0], starts[k, 1], starts[k, 2], scale.mean)
        end = descend(sight, now if k < 0 else wide, scale, start, bias, q, drift)
        if q.short < 1.0 and 1.0 - end.fits > q.suspicion:  # else nearly all beams fit, or the others count as much
            end = end._replace(agrees=max(agreeing(sight, end.at, q), end.fits))
        in_doubt = k >= 0 or end.agrees < q.doubt or end.nis > q.gate * q.gate * end.freedom
        if k < 0:
            best = end
        if q.doubt == 0.0 or sight.number < LEAST_BEAMS or not in_doubt:
            break
        worth = likelihood(sight, end.at, wide, q) if end.freedom > 0.0 else -1e300
        if k < 0:
            least = end.agrees + BETTER_FIT if end.agrees < q.doubt else q.doubt
            if q.short < 1.0 and verdict(sight, end.at, q)[1] < AGAINST:  # the map says nothing against the prediction
                least = max(least, q.doubt)
            value = worth + BETTER_VALUE
            count = _starts_around(sight, now, q, starts, values)
        elif end.agrees > least and worth > value:
            best, value = end, worth
        k += 1
    return best
