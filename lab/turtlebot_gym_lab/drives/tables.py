"""A table with named columns as a drive: text, separated by commas, semicolons, tabs or blanks, or arrays of an ``.npz``."""

from __future__ import annotations

import warnings
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.drive import Drive, RoomData, known
from turtlebot_gym.files import read_arrays

_STATE = ("x", "y", "theta", "v", "omega")
NAMES: dict[str, tuple[str, ...]] = {
    "time": ("time", "t", "stamp"),
    "v": ("v", "vx", "odom_v", "twist_v", "cmd_vel_v", "speed"),
    "omega": ("omega", "gyro", "odom_omega", "twist_omega", "cmd_vel_omega", "yaw_rate"),
    "x": ("x", "odom_x", "odometry_x"),
    "y": ("y", "odom_y", "odometry_y"),
    "theta": ("odom_theta", "odometry_theta", "yaw", "heading", "theta"),
    "true_x": ("true_x", "px", "true_state_x", "truth_x"),
    "true_y": ("true_y", "py", "true_state_y", "truth_y"),
    "true_theta": ("true_theta", "true_state_theta", "truth_theta", "theta"),
}
"""Known column names of each quantity; the first one that a table has is used. ``theta`` is the true heading in a table with
``px`` and ``py``, and the measured one beside ``x`` and ``y``. Truth without a heading is taken, too."""
_TWIST, _MEASURED, _TRUE = ("v", "omega"), ("x", "y", "theta"), ("true_x", "true_y", "true_theta")
_MORE = {
    "estimate": tuple(f"estimate_{name}" for name in _STATE),
    "reference": tuple(f"reference_{name}" for name in _STATE[:3]),
    "command": ("cmd_vel_v", "cmd_vel_omega"),
}
"""Columns of a drive of this package that are read as they are."""

Columns = dict[str, NDArray[np.float64]]


def read_table(path: Path, *, columns: Mapping[str, str], label: str) -> Drive:
    """Read a table; see `reading.read`."""
    table, remarks = _open(path)
    chosen = _choose(path, table, columns)
    time, twist = table[chosen["time"]], _together(table, [chosen[name] for name in _TWIST])
    good = np.isfinite(time) & known(twist)
    good &= increasing(np.where(good, time, np.nan))
    if good.sum() < 2:
        raise ValueError(f"{path}: only {good.sum()} of {len(good)} rows are good; a drive has at least two.")
    if not good.all():
        why = "have no finite time and twist, or a time that does not increase"
        remarks.append(f"{path}: {(~good).sum()} of {len(good)} rows {why}, first row {np.argmin(good) + 1}: left out")
    poses: dict[str, Any] = {"command": twist}
    for column, names in (("odometry", _MEASURED), ("true_state", _TRUE)):
        if names[0] in chosen:
            poses[column] = _together(table, [chosen[name] for name in names if name in chosen])
            poses[column][~known(poses[column])] = np.nan
    if "odometry" in poses:
        z = poses["odometry"]
        repeated = np.concatenate([[False], (z[1:] == z[:-1]).all(axis=1) & (np.abs(twist[1:]).max(axis=1) > 1e-3)])
        z[repeated] = np.nan
        if repeated.any():
            why = "measured poses are repeated while the robot moves: taken as not measured"
            remarks.append(f"{path}: {repeated.sum()} of {len(z)} {why}")
    poses |= {name: _together(table, names) for name, names in _MORE.items() if set(names) <= set(table)}
    return Drive(
        time=time[good],
        twist=twist[good],
        **{name: values[good] for name, values in poses.items()},
        joined=np.diff(np.flatnonzero(good), prepend=-2) == 1,
        around=RoomData(label),
        remarks=tuple(remarks),
    )


def read_poses(path: Path) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Read a table of true poses, and return their times (n,), s, and the poses (n, 3).

    Raises:
        OSError: If the file cannot be read.
        ValueError: If a column is missing.
    """
    table, _ = _open(path)
    found = {name: next((c for c in (*NAMES[name], *NAMES.get(f"true_{name}", ())) if c in table), None) for name in NAMES}
    names = [found[name] for name in ("time", *_MEASURED)]
    if None in names[:3]:
        raise ValueError(f"{path}: true poses need columns for time, x and y; there are {_some_of(table)}.")
    time, poses = table[str(names[0])], np.full((len(next(iter(table.values()))), 3), np.nan)
    for at, name in enumerate(names[1:]):
        poses[:, at] = table[name] if name else np.nan
    good = increasing(time) & np.isfinite(poses[:, :2]).all(axis=1)
    return time[good], poses[good]


def increasing(time: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return whether each time is later than all before it, shape (T,); false where it is not finite."""
    finite = np.isfinite(time)
    newest = np.maximum.accumulate(np.where(finite, time, -np.inf))
    return finite & (time > np.concatenate([[-np.inf], newest[:-1]]))


def _open(path: Path) -> tuple[Columns, list[str]]:
    """Return the columns of a table by name, and a remark on lines that were left out."""
    if path.is_file() and zipfile.is_zipfile(path):
        return _arrays(path), []
    try:
        lines = [line for line in path.read_text("utf-8-sig").splitlines() if line.strip()]
    except UnicodeDecodeError:
        lines = ["\0"]
    if not lines or "\0" in lines[0]:
        raise ValueError(f"{path}: it is no text with named columns, and no .npz.")
    header = lines[0].lstrip("#").strip()
    mark = next((mark for mark in ",;\t" if mark in header), None)
    names = [name.strip().strip('"') for name in header.split(mark)]
    if len(set(names)) < len(names):
        raise ValueError(f"{path}: a column is there more than once: {_some_of(names)}.")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        rows = np.genfromtxt(lines[1:], delimiter=mark, invalid_raise=False, ndmin=2)
    if rows.size and rows.shape[1] != len(names):
        raise ValueError(f"{path}: its rows have {rows.shape[1]} cells instead of {len(names)}.")
    remarks = [f"{path}: {' '.join(str(warning.message).split())[:300]}" for warning in caught if rows.size]
    return dict(zip(names, rows.reshape(-1, len(names)).T, strict=True)), remarks


def _arrays(path: Path) -> Columns:
    """Return the arrays of an ``.npz`` file: each is a column, or several if its rows are states, poses or twists."""
    columns: Columns = {}
    for name, array in read_arrays(path).items():
        values = np.asarray(array, np.float64)
        if values.ndim == 1:
            columns[name] = values
        elif values.ndim == 2:
            parts = _STATE[3:] if values.shape[1] == 2 else _STATE
            columns |= {f"{name}_{part}": column for part, column in zip(parts, values.T, strict=False)}
    if len({len(column) for column in columns.values()}) != 1:
        raise ValueError(f"{path}: its columns must be equally long.")
    return columns


def _together(table: Columns, names: Any) -> NDArray[np.float64]:
    return np.stack([table[name] for name in names], axis=1)


def _some_of(names: Any, most: int = 12) -> str:
    """Return names for a message: the first few, and how many more there are."""
    names = list(names)
    return ", ".join(map(repr, names[:most])) + (f" and {len(names) - most} more" if len(names) > most else "")


def _choose(path: Path, table: Columns, columns: Mapping[str, str]) -> dict[str, str]:
    """Return the column of each quantity in a table."""
    if unknown := [name for name in columns if name not in NAMES]:
        raise ValueError(f"columns must name {', '.join(NAMES)}, got {', '.join(unknown)}.")
    chosen = dict(columns)
    for name, known_as in NAMES.items():
        matches = [column for column in known_as if column in table and column not in columns.values()]
        if name not in chosen and matches:
            chosen[name] = matches[0]
    if chosen.get("theta") == "theta" == chosen.get("true_theta"):  # one column cannot be both
        chosen.pop("true_theta" if "x" in chosen else "theta")
    for position, heading in (("x", "theta"), ("true_x", "true_theta")):
        if position not in chosen:
            chosen.pop(heading, None)
    missing = [name for name in ("time", *_TWIST) if name not in chosen]
    for group in (_MEASURED, _TRUE[:2]):
        if any(name in chosen for name in group):
            missing += [name for name in group if name not in chosen]
    missing += [name for name, column in chosen.items() if column not in table]
    missing += [] if "x" in chosen or "true_x" in chosen else ["x or true_x"]
    if missing:
        wanted = ", ".join(f"{name} ({' or '.join(NAMES[name])})" if name in NAMES else name for name in missing)
        raise ValueError(f"{path}: no column for {wanted}; there are {_some_of(table)}.")
    return chosen
