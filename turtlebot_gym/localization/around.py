"""Starts all around a belief: where a scan fits badly, the descent from the prediction may have ended in a local minimum."""

from __future__ import annotations

from typing import Any

from turtlebot_gym.kernel import kernel, sqrt
from turtlebot_gym.localization.information import Guess
from turtlebot_gym.localization.points import LENGTH, X, Y
from turtlebot_gym.models.angles import sincos, wrap
from turtlebot_gym.rooms.field import at_cell
from turtlebot_gym.values import Belief

SIDE = 0.14
"""Distance between two starts, m."""
WIDTH = 0.2
"""Residual at which a beam's `agreement` has fallen to a half, m, for starts; the descent takes them the rest of the way."""
APART, TURNED = 0.2, 0.12
"""Distance and turn from which on two starts are different ones; m, rad."""
MOST_ALONG, MOST_TURNS = 6, 20
"""Most starts on each side of the prediction along an axis, and in heading."""


@kernel
def agreement(field: Any, frame: Any, points: Any, number: int, at: Guess, width: float) -> float:
    """Return the mean over a scan's beams of ``1 / (1 + d^2 / width^2)``: a soft share of those that fit, without a prior.

    The nearest cell's distance is enough for it; beams that end in the unknown count 0.
    """
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
        if (across >= 0.0) & (up >= 0.0) & (across < columns) & (up < rows):
            d = at_cell(field, int(up), int(across))
            total += 1.0 / (1.0 + d * d * per_square) if d == d else 0.0
    return total / max(number, 1)


@kernel
def keep(best: Any, values: Any, count: int, guess: tuple[float, ...], value: float, apart: float, turned: float) -> int:
    """Put a guess into a list of the best, best first, at most one within a distance and a turn; return the list's length.

    Args:
        best: Guesses, shape (K, n).
        values: Their values, shape (K,).
        count: Number of guesses in the list.
        guess: The guess: x, y and heading, and what else there is to be kept.
        value: Its value.
        apart: The distance, m.
        turned: The turn, rad.
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
        values[at] = values[at - 1]
        for k in range(len(guess)):
            best[at, k] = best[at - 1, k]
        at -= 1
    values[at] = value
    for k in range(len(guess)):
        best[at, k] = guess[k]
    return max(count, last + 1)


@kernel
def gain_of(number: int, q: Any) -> float:
    """Return how much log likelihood an agreement of 1 is worth: what the weights of Geman and McClure say, tempered."""
    return 0.5 * q.gate * q.gate * q.temper * number


@kernel
def starts_around(field: Any, frame: Any, points: Any, number: int, belief: Belief, q: Any, starts: Any, values: Any) -> int:
    """Write the best poses of a lattice around a belief, and return their number.

    It spans two standard deviations, at least `reach` and `swing`. The value of a pose is its tempered log likelihood less half
    its squared Mahalanobis distance from the belief.

    Args:
        field: Distances, see `rooms.field`.
        frame: Their frame.
        points: The scan, see `points.to_points`.
        number: Number of points.
        belief: The prediction.
        q: A `LocalizerTuning`.
        starts: Output, shape (K, 3).
        values: Output, shape (K,).
    """
    mean, P = belief
    var_x, var_y = P.xx + 0.25 * q.reach * q.reach, P.yy + 0.25 * q.reach * q.reach
    var_theta = P.tt + 0.25 * q.swing * q.swing
    total = 0.0
    for k in range(number):
        total += points[LENGTH, k]
    # A turn moves the end of a mean beam by the distance between two starts.
    turn = min(max(SIDE / max(total / max(number, 1), 0.5), 0.02), 0.1)
    in_x, in_y = min(int(2.0 * sqrt(var_x) / SIDE) + 1, MOST_ALONG), min(int(2.0 * sqrt(var_y) / SIDE) + 1, MOST_ALONG)
    in_turn, gain, count = min(int(2.0 * sqrt(var_theta) / turn) + 1, MOST_TURNS), gain_of(number, q), 0
    for a in range(-in_turn, in_turn + 1):
        for i in range(-in_y, in_y + 1):
            for j in range(-in_x, in_x + 1):
                dx, dy, dtheta = j * SIDE, i * SIDE, a * turn
                value = -0.5 * (dx * dx / var_x + dy * dy / var_y + dtheta * dtheta / var_theta)
                if count == len(starts) and gain + value <= values[count - 1]:
                    continue
                x, y, theta = mean.x + dx, mean.y + dy, mean.theta + dtheta
                value += gain * agreement(field, frame, points, number, Guess(x, y, theta, 0.0), WIDTH)
                count = keep(starts, values, count, (x, y, theta), value, APART, TURNED)
    return count


@kernel
def likelihood(
    field: Any, frame: Any, points: Any, number: int, at: Guess, belief: Belief, q: Any, width: float = 0.1
) -> float:
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
    fit = agreement(field, frame, points, number, at, width)
    return gain_of(number, q) * fit - 0.5 * (u * u + v * v + w * w)
