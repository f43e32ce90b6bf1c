"""Read a recorded drive from a table with named columns, separated by commas, semicolons or blanks.

A bad row is left out and counted; a bad table is refused, in one line that names the place.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.calibration.columns import read_text_table, some_of
from turtlebot_gym.calibration.log import Log, interpolated, make_log

NAMES: dict[str, tuple[str, ...]] = {
    "time": ("time", "t", "stamp"),
    "v": ("v", "vx", "odom_v", "cmd_vel_v", "speed"),
    "omega": ("omega", "gyro", "odom_omega", "cmd_vel_omega", "yaw_rate"),
    "x": ("x", "odom_x", "odometry_x"),
    "y": ("y", "odom_y", "odometry_y"),
    "theta": ("odom_theta", "odometry_theta", "yaw", "heading", "theta"),
    "true_x": ("true_x", "px", "true_state_x", "truth_x"),
    "true_y": ("true_y", "py", "true_state_y", "truth_y"),
    "true_theta": ("true_theta", "true_state_theta", "truth_theta", "theta"),
}
"""Known column names of each quantity; the first one that a table has is used. ``theta`` is the true heading in a table
with ``px`` and ``py``, as `turtlebot-gym replay` reads, and the measured one beside ``x`` and ``y``."""
_TWIST, _MEASURED, _TRUE = ("v", "omega"), ("x", "y", "theta"), ("true_x", "true_y", "true_theta")
MOST = 0.5
"""Least share of good rows."""
FEWEST = 20
"""Fewest rows of a drive."""


def read_table(path: str | Path, *, columns: Mapping[str, str] | None = None) -> Log:
    """Read a drive from a table.

    Rows whose time or twist is not finite, or whose time does not increase, are left out. A measured or true pose that
    is not finite counts as missing. The log's remarks count both.

    Args:
        path: The file.
        columns: Column names other than those in `NAMES`, by quantity, a key of `NAMES`.

    Raises:
        OSError: If the file cannot be read.
        ValueError: If the file is not text, a column is missing or duplicated, a cell is not a number, or too few rows
            are good; the message names file and row.
    """
    table = read_text_table(path)
    chosen = _choose(path, table.names, columns or {})
    rows = table.numbers(tuple(chosen.values()), cut=True)
    part = dict(zip(chosen, rows.T, strict=True))
    time, twist = part["time"], np.stack([part[name] for name in _TWIST], axis=1)
    keep, remarks = _good(str(path), time, twist, table.lines)
    if keep.sum() < max(FEWEST, MOST * len(keep)):
        told = "; ".join(remarks) or "nothing is wrong with them"
        raise ValueError(f"{path}: only {keep.sum()} of {len(keep)} rows are good, too few to calibrate: {told}.")
    joined = np.concatenate([[False], keep[:-1]])[keep]
    measured, true = (_poses(part, names, keep) for names in (_MEASURED, _TRUE))
    if measured is not None:
        remarks += _holes(f"{path}: measured poses", measured)
        remarks += _lost(f"{path}", measured, twist[keep])
    if true is not None:
        remarks += _holes(f"{path}: true poses", true)
    return make_log(time[keep], twist[keep], measured, true, joined=joined, remarks=tuple(remarks))


def _choose(path: str | Path, found: Sequence[str], columns: Mapping[str, str]) -> dict[str, str]:
    """Return the column of each quantity in a table."""
    unknown = [name for name in columns if name not in NAMES]
    if unknown:
        raise ValueError(f"columns must name {', '.join(NAMES)}, got {', '.join(unknown)}.")
    chosen = {name: columns[name] for name in columns}
    for name, known in NAMES.items():
        there = [each for each in known if each in found]
        if name not in chosen and there:
            chosen[name] = there[0]
    lone = "theta" in found and chosen.get("theta") == "theta" and chosen.get("true_theta") == "theta"
    if lone:  # one column cannot be both
        chosen.pop("true_theta" if "x" in chosen else "theta")
    if "x" not in chosen:
        chosen.pop("theta", None)
    missing = [name for name in ("time", *_TWIST) if name not in chosen]
    for group in (_MEASURED, _TRUE):
        if any(name in chosen for name in group):
            missing += [name for name in group if name not in chosen]
    missing += [name for name, column in chosen.items() if column not in found]
    if not any(name in chosen for name in ("x", "true_x")):
        missing += ["x or true_x"]
    if missing:
        asked = ", ".join(f"{name} ({' or '.join(NAMES[name])})" if name in NAMES else name for name in missing)
        raise ValueError(f"{path}: no column for {asked}; there are {some_of(found)}.")
    return chosen


def _good(
    path: str, time: NDArray[np.float64], twist: NDArray[np.float64], lines: Sequence[int]
) -> tuple[NDArray[np.bool_], list[str]]:
    """Return which rows are good, and remarks on the others."""
    remarks = []
    finite = np.isfinite(time) & np.isfinite(twist).all(axis=1)
    if not finite.all():
        place = f"first in line {lines[_first(~finite)]}"
        remarks.append(f"{path}: {_count(~finite)} without a finite time and twist, {place}: left out")
    newest = np.maximum.accumulate(np.where(finite, time, -np.inf))
    before = np.concatenate([[-np.inf], newest[:-1]])
    back, still = finite & (time < before), finite & (time == before)
    for bad, what in ((back, "in which time runs backwards"), (still, "in which time stands still")):
        if bad.any():
            remarks.append(f"{path}: {_count(bad)} {what}, first in line {lines[_first(bad)]}: left out")
    return finite & ~back & ~still, remarks


def _first(bad: NDArray[np.bool_]) -> int:
    return int(np.flatnonzero(bad)[0])


def _count(bad: NDArray[np.bool_]) -> str:
    return f"{bad.sum()} of {len(bad)} rows"


def _poses(
    part: Mapping[str, NDArray[np.float64]], names: Sequence[str], keep: NDArray[np.bool_]
) -> NDArray[np.float64] | None:
    if names[0] not in part:
        return None
    poses = np.stack([part[name] for name in names], axis=1)[keep]
    poses[~np.isfinite(poses).all(axis=1)] = np.nan
    return poses


def _holes(what: str, poses: NDArray[np.float64]) -> list[str]:
    missing = np.isnan(poses[:, 0])
    return [f"{what} are missing in {_count(missing)}"] if missing.any() else []


def _lost(path: str, poses: NDArray[np.float64], twist: NDArray[np.float64]) -> list[str]:
    """Mark, in place, poses that stand still while the robot moves as lost: a pose that a driver repeats is no measurement."""
    same = np.concatenate([[False], (poses[1:] == poses[:-1]).all(axis=1) & (np.abs(twist[1:]).max(axis=1) > 1e-3)])
    if not same.any():
        return []
    poses[same] = np.nan
    return [f"{path}: measured poses are repeated in {_count(same)} while the robot moves: taken as not measured"]


def with_truth(log: Log, path: str | Path) -> Log:
    """Return a log with true poses from a separate table, whose clock may differ from the log's by a constant.

    Args:
        log: The drive.
        path: A table with the columns t, x, y and theta, or other names listed in `NAMES`.

    Raises:
        OSError: If the file cannot be read.
        ValueError: If a column is missing, or table and log overlap by less than a second.
    """
    table = read_text_table(path)
    names = []
    for name in ("time", "x", "y", "theta"):
        known_as = (*NAMES[name], *NAMES.get(f"true_{name}", ()))
        there = [each for each in known_as if each in table.names]
        if not there:
            raise ValueError(f"{path}: no column for {name} ({' or '.join(known_as)}); there are {some_of(table.names)}.")
        names.append(there[0])
    rows = table.numbers(names, cut=True)
    rows = rows[np.isfinite(rows).all(axis=1)]
    rows = rows[np.concatenate([[True], np.diff(np.maximum.accumulate(rows[:, 0])) > 0.0])]
    if len(rows) < FEWEST or min(rows[-1, 0], log.time[-1]) - max(rows[0, 0], log.time[0]) < 1.0:
        raise ValueError(f"{path}: the truth shares less than a second with the log, which runs from {log.time[0]:.3f} s on.")
    return log._replace(truth=interpolated(rows[:, 0], rows[:, 1:], log.time))
