"""One episode as arrays: ``drive``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.drive import Drive, heading_error, known, position_error
from turtlebot_gym.estimation.consistency import nees
from turtlebot_gym.files import replacing
from turtlebot_gym_agents.evaluation.recording import record_episode
from turtlebot_gym_agents.evaluation.result import title_of
from turtlebot_gym_agents.figures import plot_drive
from turtlebot_gym_agents.front.results import Result, axes_or_new, with_legend
from turtlebot_gym_agents.ids import environment_id

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from rich.table import Table

_PARTS = {
    "true_state": ("true", ("x", "y", "theta", "v", "omega")),
    "odometry": ("odometry", ("x", "y", "theta")),
    "estimate": ("estimate", ("x", "y", "theta", "v", "omega")),
    "reference": ("reference", ("x", "y", "theta")),
    "command": ("command", ("v", "omega")),
}
"""Columns of the table: an array's prefix, and its parts."""


@dataclass(frozen=True, kw_only=True, repr=False)
class DriveResult(Result):
    """An episode, row by row.

    It prints as a table of errors and how the drive ended. Arrays by name: ``time`` (T,), ``true_state`` (T, 5), ``odometry``
    (T, 3), ``estimate`` (T, 5), ``covariance`` (T, 3, 3), ``reference`` (T, 3), ``command`` (T, 2), ``nees`` (T,), and what
    else is known. In a room ``walls`` (centre, half length and half width), ``circles`` (C, 3), ``boxes`` (B, 5) or ``cells``.
    """

    record: Drive
    """The drive with all that is known of it."""
    config: Mapping[str, Any]
    """What it depends on."""

    @property
    def arrays(self) -> dict[str, NDArray[Any]]:
        """What is known of the drive, by name; see the class."""
        drive, around = self.record, self.record.around
        names = (*_PARTS, "covariance", "twist", "nis", "clearance")
        arrays = {name: getattr(drive, name) for name in names}
        arrays = {"time": drive.time, **{name: array for name, array in arrays.items() if np.isfinite(array).any()}}
        arrays["nees"] = np.full(len(drive), np.nan)
        rows = known(drive.truth) & known(drive.estimate[:, :3]) & np.isfinite(drive.covariance).all((1, 2))
        if rows.any():
            arrays["nees"][rows] = nees(drive.estimate[rows], drive.true_state[rows], drive.covariance[rows])
        if around.room is not None:
            arrays |= {
                "walls": np.array(around.room.walls, np.float64),
                "circles": np.array(around.room.circles, np.float64).reshape(-1, 3),
                "boxes": np.array(around.room.boxes, np.float64).reshape(-1, 5),
            }
        if around.grid is not None:
            arrays |= {"cells": around.grid.cells, "cells_frame": np.array([*around.grid.origin, around.grid.resolution])}
        return arrays

    def rows(self) -> dict[str, Sequence[Any] | NDArray[Any]]:
        """Return a row per control interval, with the names that `turtlebot_gym_lab.drives.read` knows."""
        arrays = self.arrays
        columns: dict[str, Sequence[Any] | NDArray[Any]] = {"time": arrays["time"]}
        for name, (prefix, parts) in _PARTS.items():
            if name in arrays:
                columns |= {f"{prefix}_{part}": arrays[name][:, at] for at, part in enumerate(parts)}
        return columns | {name: arrays[name] for name in ("nis", "nees", "clearance") if name in arrays}

    def to_npz(self, path: str | Path) -> None:
        """Write all arrays as NumPy's file, which ``numpy.load`` reads; an existing file is replaced."""
        arrays: dict[str, Any] = self.arrays
        with replacing(Path(path)) as beside, beside.open("wb") as file:
            np.savez_compressed(file, **arrays)

    def tables(self) -> tuple[Table, ...]:
        """Return the errors of estimate and odometry."""
        from rich.table import Table

        drive = self.record
        columns = ("position mean, m", "position max, m", "heading mean, rad", "heading max, rad", "mean NEES")
        table = Table("", *columns, title=title_of(self.config), caption="NEES: 3 on average if the belief is right")
        for name, poses in (("estimate", drive.estimate), ("odometry", drive.odometry)):
            if known(poses[:, :3]).any() and drive.has_truth:
                errors = position_error(poses, drive.true_state), heading_error(poses, drive.true_state)
                cells = (f"{number(error):.3f}" for error in errors for number in (np.nanmean, np.nanmax))
                table.add_row(name, *cells, f"{np.nanmean(self['nees']):.2f}" if name == "estimate" else "")
        return (table,)

    def verdict(self) -> str:
        """Return how the drive ended."""
        drive = self.record
        steps = np.diff(drive.truth[known(drive.truth), :2], axis=0)
        way = np.hypot(steps[:, 0], steps[:, 1]).sum()
        return f"{drive.around.label}: {drive.outcome}, after {way:.2f} m."

    def content(self) -> tuple[Mapping[str, Any], Mapping[str, Any]]:
        """Return the arrays, and what the drive depends on."""
        return {"outcome": self.record.outcome, "arrays": self.arrays}, self.config

    def plot(self, axes: Axes | None = None) -> Axes:
        """Draw the drive seen from above, with walls and obstacles."""
        return with_legend(plot_drive(axes_or_new(axes), self.record))


def drive(policy: Any = "bearing", *, env: str | None = None, seed: int = 0, **options: Any) -> DriveResult:
    """Drive one episode and return it, the first one of `evaluate` with the same arguments.

    Args:
        policy: As for `evaluate`.
        env: The id of an environment of this package, or its short name, such as "rooms"; None as for `evaluate`.
        seed: Seed of the episode.
        **options: The environment's, see `turtlebot_gym.Options`, and ``allow_mismatch``.

    Raises:
        ValueError: If an argument is unknown or out of its range.
    """
    config = {"env": environment_id(env, options), "policy": policy, "seed": seed, **options}
    return DriveResult(record=record_episode(policy, env=env, seed=seed, **options), config=config)
