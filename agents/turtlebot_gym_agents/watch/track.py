"""The record of a drive for the viewer: a trajectory with its surroundings and the guard's reports."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain
from threading import Lock
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.rooms.grid import GridMap
from turtlebot_gym.rooms.scan import Obstacles, Scan
from turtlebot_gym.trajectory import Trajectory
from turtlebot_gym.values import Pose

OK, WARNING, ERROR = 0.0, 1.0, 2.0
"""Levels of a report, as in ``diagnostic_msgs/DiagnosticStatus``; NaN without a report."""


class Seen(NamedTuple):
    """A scan with its pose."""

    row: int
    """First row of the track at which it is the newest scan."""
    lidar: Pose
    """Pose of the LiDAR's frame in the world."""
    scan: Scan


class Surroundings(NamedTuple):
    """Constant data of a drive."""

    label: str
    """Label that distinguishes this drive from others in the same view."""
    room: Obstacles | None = None
    """Walls and obstacles; None on open ground."""
    grid: GridMap | None = None
    """A map of cells; None for none."""
    robot_radius: float = 0.105
    """Radius of the robot's footprint, m."""
    goal_radius: float = 0.2
    """Distance at which a waypoint counts as reached, m."""
    nis_degrees: int = 3
    """Degrees of freedom of the NIS: 3 for a measured pose, 2 for a position."""


class Track(NamedTuple):
    """A drive of T rows; unknown values are NaN."""

    around: Surroundings
    drive: Trajectory
    """Poses, belief, waypoint and command at each row."""
    nis: NDArray[np.float64]
    """Normalized innovation squared of the newest measurement, shape (T,)."""
    clearance: NDArray[np.float64]
    """Distance from the footprint to the nearest surface, shape (T,), m."""
    level: NDArray[np.float64]
    """Level of the guard's report, shape (T,): `OK`, `WARNING` or `ERROR`."""
    report: tuple[str, ...]
    """The guard's report at each row; empty if there is none."""
    circles: tuple[NDArray[np.float64], ...]
    """Walkers at each row, shape (C, 3) each: x, y, radius, m. An empty array stands for those of ``around.room``."""
    scans: tuple[Seen, ...] = ()
    """The scans, in order."""
    outcome: str = ""
    """Short description of how the drive ended."""

    @property
    def rows(self) -> int:
        """Number of rows, T."""
        return len(self.drive.time)


def of_trajectory(
    drive: Trajectory,
    around: Surroundings,
    *,
    nis: NDArray[np.float64] | None = None,
    clearance: NDArray[np.float64] | None = None,
    reports: Sequence[tuple[float, str]] | None = None,
    circles: Sequence[NDArray[np.float64]] | None = None,
    scans: Sequence[Seen] = (),
    outcome: str = "",
) -> Track:
    """Return the track of a trajectory; omitted data are unknown.

    Args:
        drive: The trajectory, T rows.
        around: Constant data of the drive.
        nis: Shape (T,).
        clearance: Shape (T,), m.
        reports: Level and text of the guard's report at each row.
        circles: Walkers at each row, shape (C, 3) each.
        scans: The scans, in order.
        outcome: How the drive ended.
    """
    rows = len(drive.time)
    unknown = np.full(rows, np.nan)
    return Track(
        around=around,
        drive=drive,
        nis=unknown if nis is None else np.asarray(nis, np.float64),
        clearance=unknown if clearance is None else np.asarray(clearance, np.float64),
        level=unknown if reports is None else np.array([level for level, _ in reports], np.float64),
        report=("",) * rows if reports is None else tuple(text for _, text in reports),
        circles=(np.empty((0, 3)),) * rows if circles is None else tuple(circles),
        scans=tuple(scans),
        outcome=outcome,
    )


def concatenate(pieces: Sequence[Track]) -> Track:
    """Return the pieces of a drive as one track; constant data and the outcome are those of the last piece.

    Raises:
        ValueError: If there are none.
    """
    if not pieces:
        raise ValueError("pieces must hold at least one track, got none.")
    scans, rows = [], 0
    for piece in pieces:
        scans += [seen._replace(row=seen.row + rows) for seen in piece.scans]
        rows += piece.rows
    return Track(
        around=pieces[-1].around,
        drive=Trajectory(*(np.concatenate(parts) for parts in zip(*(piece.drive for piece in pieces), strict=True))),
        nis=np.concatenate([piece.nis for piece in pieces]),
        clearance=np.concatenate([piece.clearance for piece in pieces]),
        level=np.concatenate([piece.level for piece in pieces]),
        report=tuple(chain.from_iterable(piece.report for piece in pieces)),
        circles=tuple(chain.from_iterable(piece.circles for piece in pieces)),
        scans=tuple(scans),
        outcome=pieces[-1].outcome,
    )


class Growing:
    """A drive that grows: the recorder adds pieces, and each browser reads at its own pace. Thread-safe.

    A `restart` begins another drive, such as the next episode; readers notice it by the drive's number.
    """

    def __init__(self, *pieces: Track) -> None:
        self._lock, self._pieces, self._number = Lock(), list(pieces), 0

    def add(self, piece: Track) -> None:
        """Add the next piece; a piece without rows changes only the outcome."""
        with self._lock:
            self._pieces.append(piece)

    def restart(self, piece: Track) -> None:
        """Begin another drive with its first piece."""
        with self._lock:
            self._pieces, self._number = [piece], self._number + 1

    def read(self, number: int = -1, after: int = 0) -> tuple[int, Track | None, int]:
        """Return the drive's number, the part that a reader has not yet read, and the number of pieces.

        Args:
            number: Number of the drive that the reader has read; another drive is read from its start.
            after: Number of pieces already read.

        Returns:
            The track is None if there is nothing new.
        """
        with self._lock:
            fresh = self._pieces[after if number == self._number else 0 :]
            number, pieces = self._number, len(self._pieces)
        return number, concatenate(fresh) if fresh else None, pieces
