"""Parts of a drive that a person has measured, and their steps by odometry."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.calibration.calibrate import detect_kind
from turtlebot_gym.calibration.estimates import WHEELS
from turtlebot_gym.drives import Drive, known
from turtlebot_gym.models.angles import wrap_all
from turtlebot_gym.validation import POSITIVE, typed

Array = NDArray[np.float64]

TAPE, PROTRACTOR = 0.0025, math.radians(1.0)
"""Usual standard deviations of a measured place, m, and heading, rad."""
COLUMNS = ("log", "start", "end", "distance", "x", "y", "turns")
"""Columns of a table of measurements."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Leg:
    """A part of a drive, and what was measured of it; NaN for what was not."""

    drive: Drive
    """The part, with wheel odometry or twists."""
    distance: float = math.nan
    """Straight from its start to its end, m."""
    x: float = math.nan
    """Place of its end in the frame of its start: ahead, m ..."""
    y: float = math.nan
    """... and to the left, m."""
    turn: float = math.nan
    """Turn in all, to the left, rad."""
    place_deviation: Annotated[float, POSITIVE] = TAPE
    """Standard deviation of a measured distance, x or y, m."""
    heading_deviation: Annotated[float, POSITIVE] = PROTRACTOR
    """Standard deviation of a measured turn, and of the frame of x and y, rad."""

    def __post_init__(self) -> None:
        typed(self, "")
        if not np.isfinite(self.measured).any():
            raise ValueError("distance, x, y or turn must be measured, got none of them.")

    @property
    def measured(self) -> Array:
        """Distance, x, y and turn, shape (4,)."""
        return np.array([self.distance, self.x, self.y, self.turn])


class Steps(NamedTuple):
    """The n steps of a drive by its wheels."""

    dt: Array
    """Shape (n,), s."""
    ahead: Array
    """Distance of each step by odometry, shape (n,), m."""
    turn: Array
    """Shape (n,), rad."""


def steps_of(drive: Drive) -> Steps:
    """Return the steps of a drive by its wheels: of its odometry, if the poses are the wheels', and of its twists otherwise."""
    if drive.has_odometry and detect_kind(drive) == WHEELS:
        rows = np.flatnonzero(known(drive.odometry))
        time, at = np.unique(drive.time[rows], return_index=True)
        poses = drive.odometry[rows[at]]
        step = np.diff(poses, axis=0)
        turn = wrap_all(step[:, 2])
        middle = poses[:-1, 2] + 0.5 * turn
        return Steps(np.diff(time), np.cos(middle) * step[:, 0] + np.sin(middle) * step[:, 1], turn)
    dt, (v, omega) = np.diff(drive.time), np.nan_to_num(drive.twist[1:]).T
    return Steps(dt, v * dt, omega * dt)


def leg_of(drive: Drive, *, turns: float = math.nan, loop: bool = False, **measured: float) -> Leg:
    """Return a leg as a person states it.

    Args:
        drive: The part of a drive.
        turns: Turns in all, to the side to which odometry turns.
        loop: Whether it ends where it began, with the same heading; unless ``turns`` is given, after the whole number of turns
            that is next to odometry's.
        **measured: Other fields of `Leg`.

    Raises:
        ValueError: If nothing is measured, or the part has fewer than two rows.
    """
    if len(drive) < 2:
        raise ValueError("a part of a drive needs two rows, got fewer.")
    if loop:
        measured |= {"x": 0.0, "y": 0.0}
    turn = float(steps_of(drive).turn.sum())
    if math.isfinite(turns) or loop:
        count = math.copysign(turns, turn) if math.isfinite(turns) else round(turn / (2.0 * math.pi))
        measured["turn"] = 2.0 * math.pi * count
    return Leg(drive=drive, **measured)


def read_legs(path: Path, log: Drive, read: Callable[[Path], Drive], **deviations: float) -> list[Leg]:
    """Return the legs of a table of measurements with some of `COLUMNS`; empty cells are not measured.

    Args:
        path: The table, with commas.
        log: The drive of rows without ``log``.
        read: Reads another log, a file beside the table.
        **deviations: Standard deviations, see `Leg`.

    Raises:
        ValueError: If the table is not as described; the message names file and line.
    """
    legs, drives = [], {"": log}
    with path.open(encoding="utf-8-sig", newline="") as file:
        rows = csv.DictReader(file, skipinitialspace=True)
        if not rows.fieldnames or not set(rows.fieldnames) <= set(COLUMNS):
            raise ValueError(f"{path}: the columns must be some of {', '.join(COLUMNS)}, got {rows.fieldnames}.")
        for row in rows:
            try:
                name = row.pop("log", "") or ""
                numbers = {key: float(cell) for key, cell in row.items() if cell}
                drive = drives[name] = drives[name] if name in drives else read(path.parent / name)
                since = drive.time - drive.time[0]
                first, last = np.searchsorted(since, [numbers.pop("start", 0.0), numbers.pop("end", math.inf)])
                legs.append(leg_of(drive[first : last + 1], **numbers, **deviations))  # pyright: ignore[reportArgumentType]
            except (TypeError, ValueError) as error:
                raise ValueError(f"{path}, line {rows.line_num}: {error}") from error
    return legs
