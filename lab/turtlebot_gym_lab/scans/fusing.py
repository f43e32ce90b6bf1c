"""A map that grows while the robot drives: each scan is matched with the map so far, and then averaged into it.

A cell holds the mean of its signed distances from the surfaces that beams through it have met, along these beams; the localizer
matches scans with such a field as it is. There is no closing of loops: what has drifted on a long way round stays where it is.

References:
    Curless, Levoy, "A volumetric method for building complex models from range images", SIGGRAPH (1996).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from turtlebot_gym.compiled.cache import in_machine_code
from turtlebot_gym.estimation.sixth import Sixth
from turtlebot_gym.kernel import kernel
from turtlebot_gym.localization.descent import descend
from turtlebot_gym.localization.information import Guess, ScanPoints
from turtlebot_gym.localization.points import DX, DY, LENGTH, Timing, X, Y, remember, rest, to_points
from turtlebot_gym.models.angles import sincos, wrap
from turtlebot_gym.models.odometry import increment
from turtlebot_gym.values import Belief, Covariance, Pose, State
from turtlebot_gym_lab.evaluation.localize import TRAIL

BAND = 4.0
"""Greatest distance that a cell stores, in cells ..."""
BEHIND = 2.0
"""... and how far behind a surface: walls are thin."""
MOST = 100.0
"""Number of beams after which the newest one counts as much as that many: doors move."""
APART, TURNED = 0.05, 0.1
"""Distance and turn after which a scan is averaged into the map, m and rad."""
FITS = 0.6
"""Least share of a scan's beams on known ground that must fit."""
ALREADY = 0.3
"""Least share of its beams that must be on known ground."""
AT_REST = (0.005, 0.003)
"""Standard deviations of a prediction at rest, m and rad ..."""
BY_WAY, BY_TURN = 0.1, 0.1
"""... and as a share of the way and of the turn."""


@kernel
def fuse(field: Any, weights: Any, frame: Any, points: Any, number: int, pose: Pose) -> None:
    """Average a scan into a field of signed distances.

    Args:
        field: Distances, shape (rows, columns), see `rooms.field`; NaN where no beam was yet.
        weights: Number of beams through each cell, the same shape.
        frame: Frame of the field, along the axes of the world.
        points: The scan, see `localization.points.to_points`.
        number: Number of points.
        pose: Pose of the robot.
    """
    sine, cosine = sincos(pose.theta)
    rows, columns = field.shape
    side = float(frame[4])
    step, per_cell = 0.5 * side, 1.0 / side
    for k in range(number):
        x, y, dx, dy = float(points[X, k]), float(points[Y, k]), float(points[DX, k]), float(points[DY, k])
        ux, uy = cosine * dx - sine * dy, sine * dx + cosine * dy
        end_x, end_y = pose.x + cosine * x - sine * y - frame[0], pose.y + sine * x + cosine * y - frame[1]
        last = -1
        for m in range(1 - int(float(points[LENGTH, k]) / step), int(BEHIND * side / step) + 1):
            j, i = int(np.floor((end_x + m * step * ux) * per_cell)), int(np.floor((end_y + m * step * uy) * per_cell))
            if 0 <= i < rows and 0 <= j < columns and i * columns + j != last:
                last = i * columns + j
                d = (end_x - (j + 0.5) * side) * ux + (end_y - (i + 0.5) * side) * uy
                d = min(d, BAND * side)
                w = float(weights[i, j])
                field[i, j] = d if w == 0.0 else (w * float(field[i, j]) + d) / (w + 1.0)
                weights[i, j] = min(w + 1.0, MOST)


@in_machine_code("map of a drive")
def chart(
    time: Any,
    path: Any,
    rows: Any,
    last: Any,
    ranges: Any,
    beams: Any,
    timing: Any,
    frame: Any,
    q: Any,
    known: Any,
    is_placed: bool,
    field: Any,
    weights: Any,
    poses: Any,
    fits: Any,
) -> int:
    """Write a map and the poses of its scans; return the number of scans that were averaged.

    Args:
        time: Shape (T,), s.
        path: Path by the wheels, shape (T, 3); m, m, rad.
        rows: Row at which each scan arrives, shape (S,).
        last: Time of each scan's last beam, shape (S,), s.
        ranges: Shape (S, B), m.
        beams: Shape (S, 2, B).
        timing: The LiDAR's timing and place.
        frame: Frame of the map.
        q: A `LocalizerTuning`.
        known: Map to match with, shape (rows, columns): that of an earlier round; ``field`` itself for the map so far.
        is_placed: Whether poses and shares are inputs, and scans are only averaged.
        field: Output, the same shape, NaN before.
        weights: Output, the same shape, 0 before.
        poses: Output, pose at each scan's row, shape (S, 3).
        fits: Output, share of fitting beams of those on known ground, shape (S,).
    """
    trail, points = np.empty((TRAIL, 4)), np.empty((5, ranges.shape[1]))
    pose, now = Pose(0.0, 0.0, 0.0), Pose(path[0, 0], path[0, 1], path[0, 2])
    rest(trail, time[0], now)
    way, turn, moved, turned, k, fused = 0.0, 0.0, APART, 0.0, 0, 0
    nothing, scale = State(0.0, 0.0, 0.0, 0.0, 0.0), Sixth(0.0, 0.0, Pose(0.0, 0.0, 0.0))
    for row in range(len(path)):
        if row > 0:
            before, now = now, Pose(path[row, 0], path[row, 1], path[row, 2])
            pose = increment(pose, before, now, sincos(pose.theta - before.theta))
            remember(trail, time[row], now)
            step, by = np.hypot(now.x - before.x, now.y - before.y), abs(wrap(now.theta - before.theta))
            way, turn, moved, turned = way + step, turn + by, moved + step, turned + by
        while k < len(rows) and rows[k] <= row:
            when = Timing(last[k], timing.interval, timing.x, timing.y, timing.range_max)
            number = to_points(ranges[k], beams[k], 0, when, trail, points)
            off, swerve = AT_REST[0] + BY_WAY * way, AT_REST[1] + BY_TURN * turn + 0.5 * BY_WAY * way
            P = Covariance(off * off, 0.0, 0.0, off * off, 0.0, swerve * swerve)
            prior = Belief(State(pose.x, pose.y, pose.theta, nothing.v, nothing.omega), P)
            sight = ScanPoints(known, frame, points, number)
            share, is_first = fits[k], fused == 0
            if is_placed:
                pose = Pose(poses[k, 0], poses[k, 1], poses[k, 2])
            else:
                end = descend(sight, prior, scale, Guess(pose.x, pose.y, pose.theta, 0.0), (0.0, 0.0), q)
                share = end.fits * number / max(end.used, 1.0) if end.used >= ALREADY * number else 0.0
                if share >= FITS:
                    pose, way, turn = Pose(end.at.x, end.at.y, wrap(end.at.theta)), 0.0, 0.0
                poses[k, 0], poses[k, 1], poses[k, 2], fits[k] = pose.x, pose.y, pose.theta, share
            if is_first or (share >= FITS and (moved >= APART or turned >= TURNED)):
                fuse(field, weights, frame, points, number, pose)
                moved, turned, fused = 0.0, 0.0, fused + 1
            k += 1
    return fused
