"""The record of a drive that the viewer draws: a trajectory, with what was around and what was reported at each time."""

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
"""Levels of a report, as in ``diagnostic_msgs/DiagnosticStatus``; NaN where nothing was reported."""


class Seen(NamedTuple):
    """A scan, and where it was taken."""

    row: int
    """Row of the track at which it is the newest scan for the first time."""
    lidar: Pose
    """Pose of the LiDAR's frame in the world."""
    scan: Scan


class Surroundings(NamedTuple):
    """What does not change during a drive."""

    label: str
    """What tells this drive from others in the same view."""
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
    """A drive of T rows; NaN where something is not known."""

    around: Surroundings
    drive: Trajectory
    """Poses, belief, waypoint and command at each row."""
    nis: NDArray[np.float64]
    """Normalized innovation squared of the newest measurement, shape (T,)."""
    clearance: NDArray[np.float64]
    """Distance between the footprint and what is nearest, shape (T,), m."""
    level: NDArray[np.float64]
    """Level of the guard's report, shape (T,): `OK`, `WARNING` or `ERROR`."""
    report: tuple[str, ...]
    """What the guard reports at each row; empty where it is silent."""
    circles: tuple[NDArray[np.float64], ...]
    """Obstacles that walk at each row, shape (C, 3) each: x, y, radius, m. An empty one stands for those of ``around.room``."""
    scans: tuple[Seen, ...] = ()
    """The scans, in order."""
    outcome: str = ""
    """How the drive ended, in a few words."""

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
    """Return the track of a trajectory; what is not told is not known.

    Args:
        drive: The trajectory, T rows.
        around: What does not change.
        nis: Shape (T,).
        clearance: Shape (T,), m.
        reports: Level and text of the guard's report at each row.
        circles: Obstacles that walk at each row, shape (C, 3) each.
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
    """Return the pieces of a drive as one track; what does not change, and the outcome, are the last piece's.

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
    """A drive that grows: whoever records it adds pieces, and each browser reads at its own pace. Safe between threads.

    A `restart` begins another drive, such as the next episode; readers notice it by the drive's number.
    """

    def __init__(self, *pieces: Track) -> None:
        self._lock, self._pieces, self._number = Lock(), list(pieces), 0

    def add(self, piece: Track) -> None:
        """Add what came next; a piece without rows changes the outcome only."""
        with self._lock:
            self._pieces.append(piece)

    def restart(self, piece: Track) -> None:
        """Begin another drive with its first piece."""
        with self._lock:
            self._pieces, self._number = [piece], self._number + 1

    def read(self, number: int = -1, after: int = 0) -> tuple[int, Track | None, int]:
        """Return the drive's number, what a reader has not yet read of it, and how many pieces there are.

        Args:
            number: Of the drive that the reader has read from; another one is read from its start.
            after: Pieces of it that were read.

        Returns:
            The track is None where there is nothing new.
        """
        with self._lock:
            fresh = self._pieces[after if number == self._number else 0 :]
            number, pieces = self._number, len(self._pieces)
        return number, concatenate(fresh) if fresh else None, pieces
