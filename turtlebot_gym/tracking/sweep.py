"""Scans and the odometry beneath them: where the LiDAR was when it measured a beam, and which space beams have passed."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from turtlebot_gym.kernel import kernel, sqrt
from turtlebot_gym.localization.points import pose_within
from turtlebot_gym.models.angles import PI, TWO_PI, sincos
from turtlebot_gym.values import Pose

BINS = 360  # directions in which a LiDAR is known to return something or not
PAST, EVERY = 6, 0.4  # number of scans that are remembered, and least time between two of them, s
NUMBER, LAST, INTERVAL, TURNED, FIRST, STEP, HEAD = range(7)
"""Head of a remembered scan: number of beams; time of the last one, and between two, s; turn of the odometry until then, rad;
direction of the first beam in the robot's frame, and from each to the next, rad. `HEAD` is its length."""
TURN_SHARE = 0.04  # standard deviation of the odometry's heading, as a share of its turns
LEAST_MARGIN, MARGIN = 0.15, 4.0  # how much farther than a point a beam that passed it ends, m, and in standard deviations


class Sweep(NamedTuple):
    """How the beams of a scan were measured; for its times, place and greatest range see `points.Timing`."""

    lidar: Any
    """Ranges and noise of the LiDAR, a `rooms.lidar.Lidar`."""
    number: int
    first: float
    """Direction of the first beam in the robot's frame, rad."""
    step: float
    """Angle from each beam to the next, rad; negative if clockwise."""
    last: float
    interval: float
    x: float
    y: float
    range_max: float
    tick: float = 0.0
    """Interval in which what is seen moves at once, as in a simulation, s; 0 on a robot."""


@kernel
def deviation_at(length: float, sweep: Sweep) -> float:
    """Return the standard deviation of a range, m."""
    return max(sweep.lidar.deviation, sweep.lidar.deviation_share * length)


@kernel
def bearing(x: float, y: float) -> float:
    """Return the direction of a vector, rad, to 2e-5; the same bits everywhere, unlike the function of the C library.

    References:
        Abramowitz, Stegun, *Handbook of Mathematical Functions* (1964), 4.4.49.
    """
    low, high = min(abs(x), abs(y)), max(abs(x), abs(y))
    z = low / (high if high > 0.0 else 1.0)
    s = z * z
    angle = z * (0.9998660 + s * (-0.3302995 + s * (0.1801410 + s * (-0.0851330 + s * 0.0208351))))
    angle = 0.5 * PI - angle if abs(y) > abs(x) else angle
    angle = PI - angle if x < 0.0 else angle
    return -angle if y < 0.0 else angle


@kernel
def pose_at(trail: Any, time: float) -> Pose:
    """Return the odometry's pose at a time; before and after the trail, its ends."""
    k = len(trail) - 2
    while k > 0 and trail[k, 0] < time:
        k -= 1
    return pose_within(trail, k, time)


@kernel
def time_of(beam: float, sweep: Sweep) -> float:
    """Return the time at which a beam was measured, s; beams below 0 are those of the revolution before."""
    time = sweep.last - sweep.interval * (sweep.number - 1 - beam)
    return time if sweep.tick == 0.0 else math.ceil(time / sweep.tick - 1e-9) * sweep.tick


@kernel
def end_of(beam: float, length: float, sweep: Sweep, trail: Any) -> tuple[float, float, float, float]:
    """Return where a beam of some length ends in the odometry's frame, m, and its direction there, a unit vector."""
    at = pose_at(trail, sweep.last - sweep.interval * (sweep.number - 1 - beam))
    sine, cosine = sincos(at.theta)
    aside, along = sincos(at.theta + sweep.first + sweep.step * beam)
    x, y = at.x + sweep.x * cosine - sweep.y * sine, at.y + sweep.x * sine + sweep.y * cosine
    return x + length * along, y + length * aside, along, aside


@kernel
def goes_round(number: int, step: float) -> bool:
    """Return whether beams look all around, so that the first is beside the last."""
    return abs(step) * (number + 1) >= TWO_PI


@kernel
def bin_of(beam: int, number: int) -> int:
    """Return the direction of a beam in the array of those that return something."""
    return (beam % number) * BINS // number


@kernel
def keep_scan(row: Any, ranges: Any, sweep: Sweep, trail: Any, turned: float) -> None:
    """Write a scan, of the odometry ``trail`` and the sum ``turned`` of its turns, to a row of remembered ones."""
    first = HEAD + 4 * len(trail)
    row[NUMBER], row[LAST], row[INTERVAL] = sweep.number, sweep.last, sweep.interval
    row[TURNED], row[FIRST], row[STEP] = turned, sweep.first, sweep.step
    row[HEAD:first].reshape(len(trail), 4)[:] = trail
    row[first : first + sweep.number] = ranges[: sweep.number]


@kernel
def _passed(row: Any, returns: Any, x: float, y: float, sweep: Sweep, trail: Any, turned: float) -> bool:
    """Return whether beams of a remembered scan have passed a point in the odometry's frame, and so have those beside."""
    number, first = int(row[NUMBER]), HEAD + 4 * len(trail)
    then = row[HEAD:first].reshape(len(trail), 4)
    beam, before, length = 0.5 * number, 0.0, 0.0
    for _ in range(3):
        at = pose_at(then, row[LAST] - row[INTERVAL] * (number - 1 - beam))
        sine, cosine = sincos(at.theta)
        dx, dy = x - at.x - sweep.x * cosine + sweep.y * sine, y - at.y - sweep.x * sine - sweep.y * cosine
        length = sqrt(dx * dx + dy * dy)
        ahead = (bearing(dx, dy) - at.theta - row[FIRST]) / row[STEP]
        turn = TWO_PI / abs(row[STEP])
        before, beam = beam, ahead - turn * math.floor((ahead + 0.5) / turn)
    if not abs(beam - before) < 1.0:  # a robot that turns may leave a gap between the ends of a revolution
        return False
    middle, beside = int(beam + 0.5), 1 + int(2.0 * TURN_SHARE * (turned - row[TURNED]) / abs(row[STEP]))
    far = length + max(LEAST_MARGIN, MARGIN * deviation_at(length, sweep))
    around = number  # beams from an end of a revolution to where the other end looks in the same direction
    if goes_round(number, row[STEP]) and (middle < beside or middle + beside >= number):
        turned_by = pose_at(then, row[LAST]).theta - pose_at(then, row[LAST] - row[INTERVAL] * (number - 1)).theta
        around = int(number + 0.5 - turned_by / row[STEP])
    for side in range(middle - beside, middle + beside + 1):
        near = side - around if side >= number else (side + around if side < 0 else side)
        beam_length = row[first + near] if 0 <= near < number else 0.0
        empty = beam_length == math.inf and far <= sweep.range_max and returns[bin_of(near, number)] > 0.0
        if not (empty or far <= beam_length < math.inf):
            return False
    return True


@kernel
def was_free(past: Any, returns: Any, x: float, y: float, now: float, sweep: Sweep, trail: Any, turned: float) -> bool:
    """Return whether a point in the odometry's frame was free in a remembered scan: what is there now has moved."""
    for k in range(len(past)):
        row = past[k]
        if row[NUMBER] > 0.0 and now - row[LAST] >= 0.5 * EVERY and _passed(row, returns, x, y, sweep, trail, turned):
            return True
    return False
