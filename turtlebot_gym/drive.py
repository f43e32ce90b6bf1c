"""A drive, recorded or simulated, as arrays."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from turtlebot_gym.observations import NEAREST, TRACK_BOUNDS
from turtlebot_gym.values import Pose

if TYPE_CHECKING:
    from turtlebot_gym.rooms.grid import GridMap
    from turtlebot_gym.rooms.scan import Obstacles, Scan

GAP = 5.0
"""Ratio to the usual interval at which a gap interrupts a drive."""
_UNKNOWN: Any = None
_SHAPES: dict[str, tuple[int, ...]] = {
    "true_state": (5,),
    "odometry": (3,),
    "estimate": (5,),
    "covariance": (3, 3),
    "reference": (3,),
    "command": (2,),
    "twist": (2,),
    "nis": (),
    "clearance": (),
    "level": (),
    "gyro": (),
    "fix": (),
    "tracks": (NEAREST, len(TRACK_BOUNDS[0])),
}
_LISTS = ("report", "circles", "hypotheses")


class Seen(NamedTuple):
    """A scan with its pose."""

    row: int
    """First row of the drive at which it is the newest scan."""
    lidar: Pose
    """Pose of the LiDAR's frame in the world when it was complete."""
    scan: Scan
    time: float = float("nan")
    """When its first beam was measured, by the clock of the drive, s; NaN if unknown."""
    mount: Pose = Pose(0.0, 0.0, 0.0)
    """Pose of the LiDAR's frame on the robot."""


class RoomData(NamedTuple):
    """What stays the same during a drive."""

    label: str = ""
    """Label that distinguishes this drive from others."""
    room: Obstacles | None = None
    """Walls and obstacles; None on open ground."""
    grid: GridMap | None = None
    """A map of cells; None for none."""
    chart: GridMap | None = None
    """The map of a localizer, where it is another than `grid`: of a drawn room; None for none."""
    robot_radius: float = 0.105
    """Radius of the robot's footprint, m."""
    goal_radius: float = 0.2
    """Distance at which a waypoint counts as reached, m."""
    nis_degrees: int = 3
    """Degrees of freedom of the NIS: 3 for a measured pose, 2 for a position."""


NOWHERE = RoomData()
"""Open ground, without a label."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Drive:
    """A drive of T rows; what is not given is unknown, and unknown numbers are NaN.

    The columns that an environment knows have the names of its ``info``. Slices of rows are drives, too.
    """

    time: NDArray[np.float64]
    """Shape (T,), s."""
    true_state: NDArray[np.float64] = _UNKNOWN
    """True x, y, theta, v and omega, shape (T, 5); m, m, rad, m/s, rad/s. Poses of shape (T, 3) are taken, too."""
    odometry: NDArray[np.float64] = _UNKNOWN
    """Measured pose, shape (T, 3); m, m, rad."""
    estimate: NDArray[np.float64] = _UNKNOWN
    """Estimated state, shape (T, 5); m, m, rad, m/s, rad/s."""
    covariance: NDArray[np.float64] = _UNKNOWN
    """Covariance of the estimated pose, shape (T, 3, 3)."""
    reference: NDArray[np.float64] = _UNKNOWN
    """Waypoint to reach, shape (T, 3); m, m, rad."""
    command: NDArray[np.float64] = _UNKNOWN
    """Commanded speed and turning rate, shape (T, 2); m/s, rad/s."""
    twist: NDArray[np.float64] = _UNKNOWN
    """Speed and turning rate, measured by the wheels or commanded, shape (T, 2); m/s, rad/s. The twist of row k covers the
    interval from row k-1 to row k."""
    joined: NDArray[np.bool_] = _UNKNOWN
    """Whether a row continues the one before it, shape (T,). Rows that are far apart in time never do, nor does row 0."""
    nis: NDArray[np.float64] = _UNKNOWN
    """Normalized innovation squared of the newest measurement, shape (T,)."""
    clearance: NDArray[np.float64] = _UNKNOWN
    """Distance from the footprint to the nearest surface, shape (T,), m."""
    level: NDArray[np.float64] = _UNKNOWN
    """Level of the guard's report, shape (T,), as in ``diagnostic_msgs/DiagnosticStatus``."""
    gyro: NDArray[np.float64] = _UNKNOWN
    """Turning rate measured by a gyro at each row, shape (T,), rad/s."""
    fix: NDArray[np.float64] = _UNKNOWN
    """Whether a fix arrived at each row, 1 or 0, shape (T,)."""
    tracks: NDArray[np.float64] = _UNKNOWN
    """The nearest tracks that the robot observes, shape (T, 5, 8); m, m/s; see `turtlebot_gym.observations.TRACKS`."""
    report: tuple[str, ...] = ()
    """The guard's report at each row."""
    circles: tuple[NDArray[np.float64], ...] = ()
    """Walkers at each row, shape (C, 3) each: x, y, radius, m. An empty array stands for the circles of ``around.room``."""
    hypotheses: tuple[NDArray[np.float64], ...] = ()
    """Where else a localizer takes the robot to be at each row, shape (H, 4) each, H at most 16: x, y, heading, weight; m, m,
    rad, share. Nothing while it does not doubt its belief."""
    scans: tuple[Seen, ...] = ()
    """The scans, in order."""
    around: RoomData = NOWHERE
    outcome: str = ""
    """How the drive ended."""
    remarks: tuple[str, ...] = ()
    """Problems found in the recording, and how each was handled."""

    def __post_init__(self) -> None:
        time = np.asarray(self.time, np.float64)
        rows, steps = len(time), np.diff(time)
        near = np.zeros(rows, np.bool_)
        near[1:] = steps <= GAP * np.median(steps) if rows > 1 else True
        filled: dict[str, Any] = {"time": time, "joined": near if self.joined is None else near & self.joined}
        for name, shape in _SHAPES.items():
            filled[name] = _filled(getattr(self, name), (rows, *shape))
        filled["report"] = self.report or ("",) * rows
        filled["circles"] = self.circles or (np.empty((0, 3)),) * rows
        filled["hypotheses"] = self.hypotheses or (np.empty((0, 4)),) * rows
        for name, value in filled.items():
            object.__setattr__(self, name, value)

    @classmethod
    def stack(cls, rows: Iterable[Mapping[str, Any]], *, time: ArrayLike, **rest: Any) -> Drive:
        """Return the drive whose T rows hold values by the names of columns, such as the infos of an episode.

        Other names are ignored. ``time`` has shape (T,), s; ``rest`` are other fields.
        """
        rows = list(rows)
        columns = {
            name: np.array([row.get(name, np.full(shape, np.nan)) for row in rows], np.float64).reshape(len(rows), *shape)
            for name, shape in _SHAPES.items()
            if any(name in row for row in rows)
        }
        return cls(time=np.asarray(time, np.float64), **columns, **rest)

    def __len__(self) -> int:
        return len(self.time)

    def __getitem__(self, rows: slice) -> Drive:
        first, last, _ = rows.indices(len(self))
        columns = {name: getattr(self, name)[first:last] for name in ("time", "joined", *_LISTS, *_SHAPES)}
        scans = tuple(seen._replace(row=seen.row - first) for seen in self.scans if first <= seen.row < last)
        return replace(self, scans=scans, **columns)

    @property
    def truth(self) -> NDArray[np.float64]:
        """True poses, shape (T, 3); m, m, rad."""
        return self.true_state[:, :3]

    @property
    def poses(self) -> NDArray[np.float64]:
        """The best known poses, shape (T, 3); m, m, rad: the truth, else the estimate, else odometry."""
        states = np.where(np.isfinite(self.truth), self.truth, self.estimate[:, :3])
        return np.where(np.isfinite(states), states, self.odometry)

    @property
    def period(self) -> float:
        """The usual interval between rows, s."""
        return float(np.median(np.diff(self.time)))

    @property
    def has_odometry(self) -> bool:
        """Whether poses were measured."""
        return int(known(self.odometry).sum()) >= 2

    @property
    def has_truth(self) -> bool:
        """Whether true poses are known."""
        return int(known(self.truth).sum()) >= 2


def _filled(values: Any, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Return values as a column of a shape; where they are not given or lack the last components, NaN."""
    values = None if values is None else np.asarray(values, np.float64, order="C")
    if values is not None and values.shape == shape:
        return values
    column = np.full(shape, np.nan)
    if values is not None:
        column[:, : values.shape[1]] = values
    return column


def known(poses: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return whether each pose or twist of shape (T, n) is known, shape (T,)."""
    return np.asarray(np.isfinite(poses).all(axis=1))


def position_error(pose: ArrayLike, truth: ArrayLike) -> NDArray[np.float64]:
    """Return the distance between the positions of poses or states, shape (..., 3) or (..., 5), m."""
    pose, truth = np.asarray(pose), np.asarray(truth)
    return np.hypot(pose[..., 0] - truth[..., 0], pose[..., 1] - truth[..., 1])


def heading_error(pose: ArrayLike, truth: ArrayLike) -> NDArray[np.float64]:
    """Return the size of the wrapped difference of the headings of poses or states, rad, in [0, pi]."""
    turn = np.asarray(pose)[..., 2] - np.asarray(truth)[..., 2]
    return np.abs(np.arctan2(np.sin(turn), np.cos(turn)))  # keeps NaN, which the scalar `wrap` does not
