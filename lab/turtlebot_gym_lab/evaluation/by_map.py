"""The truth of a drive from a map: poses of single scans, on which neither the wheels nor other scans have an influence.

The localizer's belief moves with the wheels, so between two scans its error is theirs: taken for the truth, it would hide the
noise that is to be measured. It only says where the descent of each scan starts. A scan's pose refers to the middle of its
revolution, where the wheels' errors in the beams before and after cancel.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.compiled.cache import in_machine_code
from turtlebot_gym.compiled.packing import as_tuple
from turtlebot_gym.drive import Drive
from turtlebot_gym.estimation.sixth import Sixth
from turtlebot_gym.kernel import kernel
from turtlebot_gym.localization.descent import SETTLED
from turtlebot_gym.localization.information import Guess, ScanPoints, information
from turtlebot_gym.localization.localizer import TRACKING
from turtlebot_gym.localization.points import Timing, remember, rest, to_points
from turtlebot_gym.models.angles import sincos, wrap, wrap_all
from turtlebot_gym.models.odometry import increment
from turtlebot_gym.parameters import ProcessNoise
from turtlebot_gym.values import Belief, Covariance, Pose, State
from turtlebot_gym_lab.calibration import Calibration, calibrate, detect_kind
from turtlebot_gym_lab.evaluation.localize import TRAIL, KnownPlace, RecordedCourse, beams_of, clocked, localize, recorded_of

CLEAR = 0.05
"""Largest standard deviation of a pose that is used, m and rad: a scan does not tell where along a corridor it was taken."""
WEAK = 4.0
"""Information of the start, 1/m^2 and 1/rad^2: half a metre and half a radian. It keeps an endless corridor solvable."""
STEPS = 10
"""Most Gauss-Newton steps."""


class Mapped(NamedTuple):
    """A drive whose truth comes from a map."""

    drive: Drive
    course: RecordedCourse
    """The localizer's beliefs, from which the descents started."""
    where: NDArray[np.intp]
    """Rows of the course at which the drive's rows are, shape (T,)."""


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


@in_machine_code("poses of single scans")
def _each_alone(
    time: Any,
    odometry: Any,
    rows: Any,
    at: Any,
    last: Any,
    ranges: Any,
    beams: Any,
    timing: Any,
    field: Any,
    frame: Any,
    q: Any,
    starts: Any,
    scale: Any,
    poses: Any,
    covariances: Any,
    fits: Any,
) -> None:
    """Write the pose of each scan at another row, its covariance and the share of its beams that fit."""
    trail, points = np.empty((TRAIL, 4)), np.empty((5, ranges.shape[1]))
    rest(trail, time[0], Pose(odometry[0, 0], odometry[0, 1], odometry[0, 2]))
    k = 0
    for row in range(len(odometry)):
        now = Pose(odometry[row, 0], odometry[row, 1], odometry[row, 2])
        if row > 0:
            remember(trail, time[row], now)
        while k < len(rows) and rows[k] <= row:
            when = Timing(last[k], timing.interval, timing.x, timing.y, timing.range_max)
            number = to_points(ranges[k], beams[k], 0, when, trail, points)
            start = Pose(starts[row, 0], starts[row, 1], starts[row, 2])
            pose, fits[k] = alone(field, frame, points, number, start, scale, q, covariances[k])
            measured = Pose(odometry[at[k], 0], odometry[at[k], 1], odometry[at[k], 2])
            by = increment(pose, now, measured, sincos(pose.theta - now.theta))
            poses[k, 0], poses[k, 1], poses[k, 2] = by.x, by.y, wrap(by.theta)
            k += 1


def by_map(drive: Drive, place: KnownPlace, wheels: ProcessNoise | None = None) -> Mapped:
    """Return a drive with the poses of its scans as truth, for `calibrate`.

    Args:
        drive: With odometry and scans.
        place: The map, and where in it the drive starts.
        wheels: The wheels, as far as known; a scan's beams are aligned by their motion.

    Raises:
        ValueError: If the drive has no odometry or no scans.
    """
    field, frame, tuning, first = place.field, place.frame, place.tuning, place.first
    recorded, where = recorded_of(drive)
    recorded = clocked(recorded)
    if wheels is not None:
        recorded = recorded._replace(odometry=corrected(recorded.odometry, wheels))
    course = localize(recorded, place._replace(first=int(where[first])))
    middle = recorded.last - 0.5 * recorded.interval * (recorded.ranges.shape[1] - 1)
    row = nearest(recorded.time[where], middle)
    number = len(recorded.rows)
    poses, covariances, fits = np.empty((number, 3)), np.empty((number, 3, 3)), np.empty(number)
    _each_alone(
        recorded.time,
        recorded.odometry,
        recorded.rows,
        where[row].astype(np.int64),
        recorded.last,
        recorded.ranges,
        beams_of(recorded),
        Timing(0.0, recorded.interval, *recorded.mount, recorded.range_max),
        field,
        frame,
        as_tuple(tuning),
        course.poses,
        course.scale,
        poses,
        covariances,
        fits,
    )
    tracked = course.states[recorded.rows] == TRACKING
    clear = np.diagonal(covariances, axis1=1, axis2=2).max(axis=1) < CLEAR**2
    good = (row >= first) & tracked & clear & (fits >= tuning.doubt)
    truth = np.full((len(drive), 3), np.nan)
    truth[row[good]] = poses[good]
    share = 100.0 * float(tracked.mean())
    remark = f"the truth is that of the map, by {good.sum()} of {number} scans; the localizer tracks at {share:.0f} % of them"
    return Mapped(replace(drive, true_state=truth, remarks=(*drive.remarks, remark)), course, where)


def calibrate_by_map(drive: Drive, place: KnownPlace, **options: Any) -> Calibration:
    """Calibrate wheels by a map: first roughly, then with the beams of each scan aligned by the wheels found.

    Args:
        drive: With odometry and scans.
        place: The map, and where in it the drive starts.
        **options: Those of `turtlebot_gym_lab.calibration.calibrate`.

    Raises:
        ValueError: If the drive has no wheel odometry or no scans, or the localizer tracks too few of them.
    """
    if (options.get("kind") or detect_kind(drive)) != "wheel":
        raise ValueError("by a map only wheel odometry is calibrated, and its poses look measured: if they are not, say so.")
    simpler: dict[str, Any] = options | {"integrator": options.get("integrator") or "midpoint"}
    rough = by_map(drive, place)
    wheels = calibrate(rough.drive, **simpler).likeliest.process
    return calibrate(by_map(drive, place, wheels).drive, **options)


def corrected(odometry: NDArray[np.float64], wheels: ProcessNoise) -> NDArray[np.float64]:
    """Return odometry, shape (T, 3), corrected by the scales and the veer of wheels."""
    step, heading = np.diff(odometry, axis=0), odometry[:-1, 2]
    cosine, sine = np.cos(heading), np.sin(heading)
    ahead, aside = cosine * step[:, 0] + sine * step[:, 1], cosine * step[:, 1] - sine * step[:, 0]
    turn = wheels.scale * (wheels.turn_scale * wrap_all(step[:, 2]) + wheels.veer * ahead)
    theta = odometry[0, 2] + np.concatenate([[0.0], np.cumsum(turn)])
    cosine, sine = wheels.scale * np.cos(theta[:-1]), wheels.scale * np.sin(theta[:-1])
    moves = np.stack([cosine * ahead - sine * aside, sine * ahead + cosine * aside], axis=1)
    places = odometry[0, :2] + np.concatenate([np.zeros((1, 2)), np.cumsum(moves, axis=0)])
    return np.column_stack([places, theta])


def nearest(times: NDArray[np.float64], wanted: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return the indices of the times, ascending, that are nearest to wanted ones."""
    after = np.clip(np.searchsorted(times, wanted), 1, len(times) - 1)
    return after - (wanted - times[after - 1] < times[after] - wanted)
