"""Whole relative poses of a drive: what the wheels make of a window, and what the truth shows of it.

A window lasts until the wheels have moved by a length, whatever the speed and the rate of the rows. Between its ends the twist
is added up, so neither the rate nor noise of single rows counts as evidence, and a pose that is wrong spoils only the windows
that begin or end there. The wheels' clock may be late: the twist of a window is that of an earlier or a later time.

References:
    Censi, Franchi, Marchionni, Oriolo, "Simultaneous calibration of odometry and sensor parameters for mobile robots", *IEEE
        Transactions on Robotics* 29 (2013): wheels and the pose of a sensor from its relative poses.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.drive import Drive, known
from turtlebot_gym.models.angles import wrap_all

Array = NDArray[np.float64]

PARAMETERS = ("scale", "turn_scale", "veer", "drift", "marker_x", "marker_y", "marker_theta", "delay")
"""Parameters of wheels, in the order of their arrays: those of `ProcessNoise`; the drift of the recorded turning rate, rad/s;
the pose on the robot of what is tracked, m, m, rad; the time by which the motion lags behind the twist, s."""
USUAL = np.array([1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
"""Their values for wheels as assumed, a truth of the middle of the axle, and one clock."""
LEVER = 0.25
"""Distance as which a turn by 1 rad counts, m."""
LENGTHS, MANY = (0.1, 0.5), 40
"""Least and greatest length of a window, m, and number of windows of a drive that is too short for the greatest."""
OVERLAP = 8
"""Windows that begin in the length of one."""

TOO_SHORT = "the truth shows too little motion to fit to: drive 10 m or more, and record the truth of it."
"""Refusal of a drive that has too few windows or pieces."""


class Path(NamedTuple):
    """What the recorded twists of T rows add up to."""

    time: Array
    """Shape (T,), s."""
    way: Array
    """Signed way up to each row, shape (T,), m."""
    turn: Array
    """Turn up to each row, shape (T,), rad."""
    part: NDArray[np.intp]
    """Number of the part of the drive in which a row is, shape (T,): rows that do not continue one another are in others."""

    @property
    def motion(self) -> Array:
        """Length of all motion up to each row, ahead and back, shape (T,), m; a turn counts by `LEVER`."""
        steps = np.abs(np.diff(self.way)) + LEVER * np.abs(np.diff(self.turn))
        return np.concatenate([[0.0], np.cumsum(steps)])


class Windows(NamedTuple):
    """The n windows of a drive, in the order of their beginnings."""

    begin: Array
    """Shape (n,), s."""
    end: Array
    """Shape (n,), s."""
    moved: Array
    """Pose of what is tracked at the end, in its frame at the beginning, shape (n, 3); m, m, rad."""

    def chosen(self, which: NDArray[np.bool_]) -> Windows:
        """Return some of the windows."""
        return Windows(*(column[which] for column in self))


def path_of(drive: Drive) -> Path:
    """Return what the recorded twists of a drive add up to."""
    steps = np.where(drive.joined[1:, None], np.nan_to_num(drive.twist[1:]), 0.0) * np.diff(drive.time)[:, None]
    way, turn = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)]).T
    return Path(drive.time, way, turn, np.cumsum(~drive.joined, dtype=np.intp))


def relative(first: Array, last: Array) -> Array:
    """Return poses in the frames of others, shape (n, 3)."""
    x, y = (last - first)[:, :2].T
    sine, cosine = np.sin(first[:, 2]), np.cos(first[:, 2])
    return np.column_stack([cosine * x + sine * y, cosine * y - sine * x, wrap_all(last[:, 2] - first[:, 2])])


def length_for(path: Path) -> float:
    """Return the length of windows for a drive: half a metre, or less if it is short, m."""
    return float(np.clip(path.motion[-1] / MANY, *LENGTHS))


def windows_of(path: Path, poses: Array, length: float, *, overlap: int = OVERLAP, by_way: bool = False) -> Windows:
    """Return the windows of a drive.

    A length, m, counts turns too, unless `by_way`; as many windows as ``overlap`` begin in it. Unknown poses are NaN.
    """
    rows = np.flatnonzero(known(poses))
    motion = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(path.way)))]) if by_way else path.motion
    at = motion[rows]
    if len(rows) < 2 or at[-1] - at[0] < length:
        return Windows(np.zeros(0), np.zeros(0), np.zeros((0, 3)))
    first = np.unique(np.searchsorted(at, np.arange(at[0], at[-1] - length, length / overlap)))
    last = np.searchsorted(at, at[first] + length)
    within = last < len(rows)
    first, last = rows[first[within]], rows[last[within]]
    joined = path.part[first] == path.part[last]
    first, last = first[joined], last[joined]
    return Windows(path.time[first], path.time[last], relative(poses[first], poses[last]))


def driven(path: Path, wheels: Array, times: Array, integrator: float = 0.5) -> Array:
    """Return where wheels are at some times, from their pose at the first row, shape (n, 3).

    Parameters have the shape (8,), and times, s, are by the clock of the twist.
    """
    scale, turn_scale, veer, drift = wheels[:4]
    turned = scale * (turn_scale * path.turn + veer * path.way) - drift * (path.time - path.time[0])
    steps, turns = scale * np.diff(path.way), np.diff(turned)
    places = np.concatenate([[0.0], np.cumsum(steps * np.exp(1j * (turned[:-1] + integrator * turns)))])
    row = np.clip(np.searchsorted(path.time, times, side="right") - 1, 0, len(path.time) - 2)
    share = np.clip((times - path.time[row]) / (path.time[row + 1] - path.time[row]), 0.0, 1.0)
    heading = turned[row] + share * turns[row]
    place = places[row] + share * steps[row] * np.exp(1j * (turned[row] + integrator * share * turns[row]))
    return np.column_stack([place.real, place.imag, heading])


def predicted(path: Path, windows: Windows, wheels: Array, integrator: float = 0.5) -> Array:
    """Return how what is tracked moves in each window, by the wheels, shape (n, 3); the turn is not wrapped."""
    x, y, direction, delay = wheels[4:]
    ends = driven(path, wheels, np.concatenate([windows.begin, windows.end]) - delay, integrator)
    first, last = np.split(ends, 2)
    turn = last[:, 2] - first[:, 2]
    step = (last[:, 0] - first[:, 0] + 1j * (last[:, 1] - first[:, 1])) * np.exp(-1j * first[:, 2])
    step = (step + complex(x, y) * (np.exp(1j * turn) - 1.0)) * np.exp(-1j * direction)
    return np.column_stack([step.real, step.imag, turn])


def rest(path: Path, windows: Windows, wheels: Array, integrator: float = 0.5) -> Array:
    """Return what wheels leave unexplained of each window, shape (n, 3); ahead and left of the beginning, m, and rad."""
    off = windows.moved - predicted(path, windows, wheels, integrator)
    off[:, 2] = wrap_all(off[:, 2])
    return off
