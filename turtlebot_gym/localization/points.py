"""A scan's beams as points in the robot's present frame.

A LiDAR measures its beams one after the other while the robot moves. The odometry since then says where each beam began, so the
points are as if the whole scan had been taken now: that removes the skew, and the age of the scan with it.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.kernel import kernel
from turtlebot_gym.models.angles import sincos, wrap
from turtlebot_gym.values import Pose

X, Y, DX, DY, LENGTH = range(5)
"""Rows of an array of points, shape (5, n): the end of a beam in the robot's frame, m, the unit vector along it, and its range,
m."""


class Timing(NamedTuple):
    """When the beams of a scan were measured, and from where on the robot.

    The times of the last beam and between two, s, 0 if all were measured at once; the position of the LiDAR in the robot's
    frame, m; and the greatest range that is a measurement, m.
    """

    last: float
    interval: float
    x: float
    y: float
    range_max: float


@kernel
def pose_of(row: Any) -> Pose:
    """Return the pose whose numbers an array begins with."""
    return Pose(float(row[0]), float(row[1]), float(row[2]))


@kernel
def remember(trail: Any, time: float, pose: Pose) -> None:
    """Put an odometry pose at the head of a trail, shape (2 or more, 4): time, x, y and heading, newest first; s, m, m, rad."""
    for at in range(len(trail) - 1, 0, -1):
        trail[at] = trail[at - 1]
    trail[0, 0], trail[0, 1], trail[0, 2], trail[0, 3] = time, pose.x, pose.y, pose.theta


@kernel
def rest(trail: Any, time: float, pose: Pose) -> None:
    """Begin a trail at rest."""
    trail[:, 0], trail[:, 1], trail[:, 2], trail[:, 3] = time, pose.x, pose.y, pose.theta


@kernel
def pose_within(trail: Any, k: int, time: float) -> Pose:
    """Return the pose at a time between rows k + 1 and k of a trail; before and after them, that of the nearer one."""
    (end, end_x, end_y, end_theta), (begin, x, y, theta) = trail[k], trail[k + 1]
    share = min(max((time - begin) / (end - begin), 0.0), 1.0) if end > begin else 1.0
    return Pose(x + share * (end_x - x), y + share * (end_y - y), theta + share * wrap(end_theta - theta))


@kernel
def to_points(ranges: Any, beams: Any, turn: int, timing: Timing, trail: Any, points: Any) -> int:
    """Write a scan's beams, at most as many as there is room for, in the order of their measurement; return their number.

    They are evenly spread over those with a measurement; the others are NaN, infinite, not positive, or beyond the range.

    ``ranges`` has shape (B,), m, ``beams`` their directions in the robot's frame, shape (2 or more, B): cosine and sine. The
    beams of scan ``turn`` + 1 lie between those of this one. A beam older than the odometry's ``trail``, see `remember`, counts
    as measured at its oldest pose. ``points`` is the output, shape (5, n), see `X`.
    """
    number, k, used, measured = len(ranges), len(trail) - 2, 0, 0
    valid = np.empty(number, np.int64)  # beams with a measurement; without a branch, which would be mispredicted
    for beam in range(number):
        valid[measured] = beam
        measured += 1 if 0.0 < float(ranges[beam]) <= timing.range_max else 0
    most = min(points.shape[1], measured)
    every = max(-(-measured // max(most, 1)), 1)
    first = (turn + every // 2) % every  # that of scan 0 in the middle of its share
    now_x, now_y = trail[0, 1], trail[0, 2]
    now_sine, now_cosine = sincos(trail[0, 3])
    for part in range(most):
        place = first + (part * measured + most - 1) // most
        if place >= measured:
            break
        beam = int(valid[place])
        length = float(ranges[beam])
        time = timing.last - timing.interval * (number - 1 - beam)
        while k > 0 and trail[k, 0] < time:
            k -= 1
        x, y, heading = pose_within(trail, k, time)
        sine, cosine = sincos(heading)
        along, aside = float(beams[0, beam]), float(beams[1, beam])
        dx, dy = cosine * along - sine * aside, sine * along + cosine * aside
        end_x = x + timing.x * cosine - timing.y * sine + length * dx - now_x
        end_y = y + timing.x * sine + timing.y * cosine + length * dy - now_y
        points[X, used], points[Y, used] = now_cosine * end_x + now_sine * end_y, now_cosine * end_y - now_sine * end_x
        points[DX, used], points[DY, used] = now_cosine * dx + now_sine * dy, now_cosine * dy - now_sine * dx
        points[LENGTH, used] = length
        used += 1
    return used


@kernel
def swept(timing: Timing, beams: int, trail: Any) -> tuple[float, float]:
    """Return the number of the odometry's intervals since the end of a scan of so many beams, and during it.

    Its beams are brought to the present pose by the odometry, with the odometry's drift since then, which they do not show.
    """
    passed = trail[0, 0] - trail[1, 0]
    per_second = 1.0 / passed if passed > 0.0 else 0.0
    return max(trail[0, 0] - timing.last, 0.0) * per_second, timing.interval * beams * per_second


def directions(angles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the cosine and sine of beams' directions, shape (2, B), as `to_points` takes them."""
    return np.stack((np.cos(angles), np.sin(angles)))
