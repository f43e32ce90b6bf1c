"""A drive, recorded or simulated, as arrays."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, get_type_hints

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
    """A drive of T rows; what is not given is unknown, and unknown numbers are NaN. Slices of rows are drives, too.

    The columns that an environment knows have the names of its ``info``.
    """

    time: NDArray[np.float64]
    """Shape (T,), s."""
    true_state: Annotated[NDArray[np.float64], (5,)] = _UNKNOWN
    """True x, y, theta, v and omega, shape (T, 5); m, m, rad, m/s, rad/s. Poses of shape (T, 3) are taken, too."""
    odometry: Annotated[NDArray[np.float64], (3,)] = _UNKNOWN
    """Measured pose, shape (T, 3); m, m, rad."""
    estimate: Annotated[NDArray[np.float64], (5,)] = _UNKNOWN
    """Estimated state, shape (T, 5); m, m, rad, m/s, rad/s."""
    covariance: Annotated[NDArray[np.float64], (3, 3)] = _UNKNOWN
    """Covariance of the estimated pose, shape (T, 3, 3)."""
    reference: Annotated[NDArray[np.float64], (3,)] = _UNKNOWN
    """Waypoint to reach, shape (T, 3); m, m, rad."""
    command: Annotated[NDArray[np.float64], (2,)] = _UNKNOWN
    """Commanded speed and turning rate, shape (T, 2); m/s, rad/s."""
    twist: Annotated[NDArray[np.float64], (2,)] = _UNKNOWN
    """Speed and turning rate, measured by the wheels or commanded, shape (T, 2); m/s, rad/s. The twist of row k covers the
    interval from row k-1 to row k."""
    joined: NDArray[np.bool_] = _UNKNOWN
    """Whether a row continues the one before it, shape (T,). Rows that are far apart in time never do, nor does row 0."""
    nis: Annotated[NDArray[np.float64], ()] = _UNKNOWN
    """Normalized innovation squared of the newest measurement, shape (T,)."""
    clearance: Annotated[NDArray[np.float64], ()] = _UNKNOWN
    """Distance from the footprint to the nearest surface, shape (T,), m."""
    level: Annotated[NDArray[np.float64], ()] = _UNKNOWN
    """Level of the guard's report, shape (T,), as in ``diagnostic_msgs/DiagnosticStatus``."""
    fix: Annotated[NDArray[np.float64], ()] = _UNKNOWN
    """Whether a fix arrived at each row, 1 or 0, shape (T,)."""
    tracks: Annotated[NDArray[np.float64], (NEAREST, len(TRACK_BOUNDS[0]))] = _UNKNOWN
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
        filled: dict[str, Any] = {name: _filled(getattr(self, name), (rows, *shape)) for name, shape in _SHAPES.items()}
        filled |= {"time": time, "joined": near if self.joined is None else near & self.joined}
        for name, none in (("report", ""), ("circles", np.empty((0, 3))), ("hypotheses", np.empty((0, 4)))):
            filled[name] = getattr(self, name) or (none,) * rows
        for name, value in filled.items():
            object.__setattr__(self, name, value)

    @classmethod
    def stack(cls, rows: Iterable[Mapping[str, Any]], *, time: ArrayLike, **rest: Any) -> Drive:
        """Return the drive whose T rows hold values by the names of columns, such as infos; ``rest`` are other fields."""
        rows, columns = list(rows), {}
        for name, shape in _SHAPES.items():
            if any(name in row for row in rows):
                values = [row.get(name, np.full(shape, np.nan)) for row in rows]
                columns[name] = np.array(values, np.float64).reshape(len(rows), *shape)
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


_SHAPES: dict[str, tuple[int, ...]] = {
    name: hint.__metadata__[0]
    for name, hint in get_type_hints(Drive, include_extras=True).items()
    if hasattr(hint, "__metadata__")
}
"""Shape of a row of each column of numbers."""


def _filled(values: Any, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Return values as a column of a shape; where they are not given or lack the last components, NaN."""
    column = np.full(shape, np.nan)
    if values is None:
        return column
    values = np.asarray(values, np.float64, order="C")
    if values.shape == shape:
        return values
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
