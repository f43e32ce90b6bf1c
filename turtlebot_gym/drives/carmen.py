"""Logs of CARMEN, as text and as arrays.

The odometry is a pose that the wheels add up; a row's twist is the arc from the pose before it, so that rows may be left out
without loss.

References:
    CARMEN, *Logger and Playback*, carmen.sourceforge.net/logger_playback.html: the messages.
"""

from __future__ import annotations

import math
import zipfile
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.beams import beams_of
from turtlebot_gym.drives.alignment import interpolated
from turtlebot_gym.drives.clocks import continued, increasing
from turtlebot_gym.drives.drive import Drive, RoomData, Seen
from turtlebot_gym.drives.tables import LARGEST, first_lines
from turtlebot_gym.files import LARGEST_LOG, read_arrays, read_text
from turtlebot_gym.models.angles import wrap_all
from turtlebot_gym.models.odometry import increment
from turtlebot_gym.rooms.scan import Scan
from turtlebot_gym.values import ORIGIN, Pose

SICK = 80.0
"""Range from which a reading means that nothing returned, m."""
ON_THE_ROBOT = 0.01
"""Greatest change of the laser's pose relative to the odometry's, m and rad, for it to be the mount."""
SPARSE = 0.4
"""Least interval between rows as a share of one that 99 in 100 do not exceed: stamps that scatter are no gaps."""
_WORDS = ("ODOM", "FLASER", "RLASER", "ROBOTLASER1", "TRUEPOS", "PARAM", "SYNC", "RAWLASER1")


class _Line(NamedTuple):
    """What a line of a log states."""

    time: float
    odometry: tuple[float, float, float]
    laser: tuple[float, float, float] | None = None
    """The laser's pose, or the robot's that a mapper has corrected."""
    true: tuple[float, float, float] | None = None
    scan: Scan | None = None


def is_carmen(path: Path) -> bool:
    """Return whether a file is a CARMEN log: the first line that is not a comment begins with a message's name."""
    lines = first_lines(path)
    return any(line.startswith("# CARMEN") for line in lines) or any(
        line.split(maxsplit=1)[0] in _WORDS for line in lines if line.strip() and line[0] != "#"
    )


def read_carmen(path: Path, *, label: str) -> Drive:
    """Read a CARMEN log; see `reading.read`."""
    lines: list[_Line] = []
    broken, first = 0, 0
    for number, text in enumerate(read_text(path, most=LARGEST_LOG, errors="replace").splitlines(), start=1):
        words = text.split()
        try:
            lines += _parsed(words)
        except (ValueError, IndexError):
            broken, first = broken + 1, first or number
    remarks = [f"{path}: {broken} lines cannot be read, first line {first}: left out"] if broken else []
    scans = [line for line in lines if line.laser]
    lasers = [(Pose(*line.odometry), Pose(*line.laser)) for line in scans if line.laser]
    places = np.array([increment(ORIGIN, at, laser, _sincos(-at.theta)) for at, laser in lasers]).reshape(-1, 3)
    mount = ORIGIN
    if len(places) and (np.abs(places - np.median(places, axis=0)) < ON_THE_ROBOT).mean() > 0.99:
        mount = Pose(*np.median(places, axis=0).tolist())
    elif scans and not any(line.true for line in lines):
        lines = [line._replace(true=line.laser) for line in lines]
        remarks.append(f"{path}: a mapper has corrected its poses: they are taken for the truth")
    return _of_poses(path, lines, mount=mount, label=label, remarks=remarks)


def is_carmen_arrays(path: Path) -> bool:
    """Return whether an ``.npz`` file holds a CARMEN log: odometry, and ranges in centimetres."""
    if not (path.is_file() and zipfile.is_zipfile(path)):
        return False
    with zipfile.ZipFile(path) as file:
        return {"time.npy", "odometry.npy", "ranges_cm.npy"} <= set(file.namelist())


def read_carmen_arrays(path: Path, *, label: str) -> Drive:
    """Read the arrays of a CARMEN log; see `reading.read`."""
    file = read_arrays(path)
    try:
        time, odometry, ranges = (file[name] for name in ("time", "odometry", "ranges_cm"))
        rows = np.asarray(file["reference_row"], np.intp) if "reference_row" in file else np.zeros(0, np.intp)
        true = np.asarray(file["reference"], np.float64) if len(rows) else np.zeros((0, 3))
        shapes = odometry.shape == (len(time), 3) and ranges.ndim == 2 and len(ranges) == len(time) > 1
        good = (np.abs(time) <= LARGEST) & (np.abs(odometry) <= LARGEST).all(axis=1) if shapes else np.zeros(0, np.bool_)
        if not (shapes and ranges.shape[1] and true.shape == (len(rows), 3) and ((rows >= 0) & (rows < len(time))).all()):
            raise ValueError("its arrays time, odometry, ranges_cm, reference_row and reference do not fit each other")
    except (ValueError, KeyError, TypeError) as error:
        raise ValueError(f"{path}: {' '.join(str(error).split())}.") from error
    references = {row: (x, y, theta) for row, (x, y, theta) in zip(rows.tolist(), true.tolist(), strict=True)}
    lines = [
        _Line(float(time[row]), (x, y, theta), true=references.get(row), scan=_sick(ranges[row].astype(np.float32) / 100.0))
        for row, (x, y, theta) in enumerate(odometry.tolist())
        if good[row]
    ]
    bad = int((~good).sum())
    remarks = [f"{path}: {bad} of {len(good)} rows are not finite: left out"] if bad else []
    return _of_poses(path, lines, mount=ORIGIN, label=label, remarks=remarks)


def _parsed(words: list[str]) -> Iterable[_Line]:
    """Yield what a line states, if it states the odometry. A message's time is that of its sender, else the logger's."""
    if not words or words[0] not in ("ODOM", "FLASER", "ROBOTLASER1", "TRUEPOS"):
        return
    sent, logged = float(words[-3]), float(words[-1])
    time = sent if sent > 0.0 else logged
    if not abs(time) <= LARGEST:
        raise ValueError("a time is not finite")
    if words[0] == "ODOM":
        yield _Line(time, _three(words, 1))
        return
    if words[0] == "TRUEPOS":
        yield _Line(time, _three(words, 4), true=_three(words, 1))
        return
    if words[0] == "FLASER":
        number = int(words[1])
        yield _Line(time, _three(words, 5 + number), _three(words, 2 + number), scan=_sick(_floats(words[2 : 2 + number])))
        return
    first, increment, longest, number = float(words[2]), float(words[4]), float(words[5]), int(words[8])
    scan = _scan(_floats(words[9 : 9 + number]), first, increment, longest)
    yield _Line(time, _three(words, len(words) - 11), _three(words, len(words) - 14), scan=scan)


def _floats(words: list[str]) -> NDArray[np.float32]:
    return np.clip([float(word) for word in words], -LARGEST, LARGEST).astype(np.float32)


def _three(words: list[str], at: int) -> tuple[float, float, float]:
    x, y, theta = (float(word) for word in words[at : at + 3])
    if not max(abs(x), abs(y), abs(theta)) <= LARGEST or math.isnan(x + y + theta):
        raise ValueError("a pose is not finite")
    return x, y, theta


def _sick(ranges: NDArray[np.float32]) -> Scan:
    """Return a scan of half a turn, one or two beams to a degree."""
    if not len(ranges):
        raise ValueError("a scan has no ranges")
    return _scan(ranges, -0.5 * math.pi, math.radians(round(360.0 / len(ranges)) / 2.0), SICK)


def _scan(ranges: NDArray[np.float32], first: float, increment: float, longest: float) -> Scan:
    below = float(np.nextafter(np.float32(longest), np.float32(0.0)))
    return Scan(
        beams_of(ranges, first=first, increment=increment, range_min=0.0, range_max=below).ranges,
        first,
        increment,
        0.0,
        longest,
    )


def _of_poses(path: Path, lines: list[_Line], *, mount: Pose, label: str, remarks: list[str]) -> Drive:
    """Return a drive whose rows are poses that the wheels add up, with truth and scans by the same clock.

    Args:
        path: The file.
        lines: What it states, in the order of the recording.
        mount: Pose of the laser on the robot.
        label: Label of the drive.
        remarks: What was noticed so far.
    """
    times, is_set, notes = continued(np.array([line.time for line in lines]), str(path))
    resets = np.cumsum(is_set)
    wheels = [at for at, line in enumerate(lines) if line.scan is None and line.laser is None]
    # The lines of a laser and of the wheels are written in the order of their arrival, each with stamps in order.
    rows = np.array(wheels if len(wheels) > 1 else range(len(lines)), np.intp)
    keep = increasing(times[rows])
    if not keep.all():
        notes.append(f"{path}: {(~keep).sum()} of {len(keep)} rows have a time that does not increase: left out")
    true = [at for at, line in enumerate(lines) if line.true]
    rows = rows[keep]
    rows = rows[_spaced(times[rows], np.isin(times[rows], times[true]))]
    if len(rows) < 2:
        raise ValueError(f"{path}: a drive needs two rows with odometry (ODOM, FLASER or ROBOTLASER1), got {len(rows)}.")
    time, poses = times[rows], np.array([lines[row].odometry for row in rows])
    scans = [(at, lines[at]) for at in range(len(lines)) if lines[at].scan]
    first = np.searchsorted(time, times[[at for at, _ in scans]]).tolist()
    seen = []
    for (at, line), row in zip(scans, first, strict=True):
        if line.scan and row < len(rows):
            robot = Pose(*line.odometry)
            lidar = increment(robot, ORIGIN, mount, _sincos(robot.theta))
            seen.append(Seen(row, lidar, line.scan, float(times[at] - time[0]), mount, robot))
    return Drive(
        time=time - time[0],
        twist=(twist := _twist(time, poses)),
        command=twist,
        odometry=poses,
        true_state=_truth(times[true], np.array([lines[at].true for at in true]).reshape(-1, 3), time),
        joined=np.diff(resets[rows], prepend=resets[rows[0]]) == 0,
        scans=tuple(seen),
        around=RoomData(label),
        remarks=(*remarks, *notes),
    )


def _sincos(angle: float) -> tuple[float, float]:
    """Return sine and cosine of any angle: `models.angles.sincos` holds for less than 1e5 rad, which a log may exceed."""
    return math.sin(angle), math.cos(angle)


def _spaced(time: NDArray[np.float64], wanted: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Return the rows that are not much nearer to each other than others are, and those that are wanted."""
    if len(time) < 2:
        return np.arange(len(time))
    least, last, kept = SPARSE * float(np.percentile(np.diff(time), 99)), -math.inf, []
    for row, (at, is_wanted) in enumerate(zip(time.tolist(), wanted.tolist(), strict=True)):
        if kept and is_wanted and at - last < least and not wanted[kept[-1]]:
            kept.pop()
            last = time[kept[-1]] if kept else -math.inf
        if is_wanted or at - last >= least:
            kept.append(row)
            last = at
    return np.array(kept, np.intp)


def _twist(time: NDArray[np.float64], poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return speed and turning rate on the arc from the pose before each pose, shape (T, 2)."""
    turn = wrap_all(np.diff(poses[:, 2]))
    middle = poses[:-1, 2] + 0.5 * turn
    chord = np.diff(poses[:, 0]) * np.cos(middle) + np.diff(poses[:, 1]) * np.sin(middle)
    arcs = np.stack([chord / np.sinc(0.5 * turn / np.pi), turn], axis=1) / np.diff(time)[:, None]
    return np.concatenate([np.zeros((1, 2)), arcs])


def _truth(time: NDArray[np.float64], poses: NDArray[np.float64], wanted: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return true poses at the times of rows, shape (T, 3): those of the same time, or interpolated if few have one."""
    truth = np.full((len(wanted), 3), np.nan)
    same = np.isin(time, wanted)
    if same.sum() >= 0.5 * len(time):
        truth[np.searchsorted(wanted, time[same])] = poses[same]
    else:
        order = increasing(time)
        truth = interpolated(time[order], poses[order], wanted)
    return truth
