"""A table with named columns as a drive: text, separated by commas, semicolons, tabs or blanks, or the arrays of an ``.npz``.

A bad row is left out and counted; a bad table is refused, in one line that names the place.
"""

from __future__ import annotations

import zipfile
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.drive import Drive, RoomData, known
from turtlebot_gym.files import LARGEST_LOG, read_arrays, read_text
from turtlebot_gym_lab.drives.clocks import MISSING, continued, increasing, strays

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
_MORE = (
    ("estimate", tuple(f"estimate_{name}" for name in _STATE)),
    ("reference", tuple(f"reference_{name}" for name in _STATE[:3])),
    ("command", ("command_v", "command_omega")),
    ("command", ("cmd_vel_v", "cmd_vel_omega")),
)
"""Columns of the recorder's snapshots, or of a drive's own arrays, that are read as they are."""
LARGEST = 1e15
"""Greatest number in a table; time since 1970 in seconds, or by mistake in nanoseconds, is smaller."""
MOST = 0.5
"""Least share of good rows between the first and the last one."""
_BINARY = "the file is binary; a table with named columns, as text or .npz, is needed."


class _Table(NamedTuple):
    """A table whose cells are not numbers yet."""

    names: Sequence[str]
    """Column names from left to right, without duplicates."""
    numbers: Callable[[Sequence[str]], NDArray[np.float64]]
    """Returns some columns as numbers, shape (T, n); NaN for empty cells."""
    lines: Sequence[int]
    """Line number of each row in the file, from 1."""


def is_table(path: Path) -> bool:
    """Return whether a file may be a table: text, or arrays; a file that cannot be opened is for the reader to refuse."""
    if not path.is_file() or zipfile.is_zipfile(path):
        return True
    with path.open("rb") as file:
        return b"\0" not in file.read(4096)


def read_table(path: Path, *, columns: Mapping[str, str], label: str) -> Drive:
    """Read a table; see `reading.read`."""
    table = _open(path)
    chosen = _choose(path, table.names, columns)
    rows = table.numbers(tuple(chosen.values()))
    rows[~(np.abs(rows) <= LARGEST)] = np.nan
    part = dict(zip(chosen, rows.T, strict=True))
    time, twist = part["time"], np.stack([part[name] for name in _TWIST], axis=1)
    is_stray = strays(time)
    time, is_set, remarks = continued(np.where(is_stray, np.nan, time), str(path))
    keep, left_out = _good(path, time, twist, is_stray, table.lines)
    remarks += left_out
    span = np.ptp(np.flatnonzero(keep)) + 1 if keep.any() else len(keep)
    if keep.sum() < max(2, MOST * span):
        why = "; ".join(remarks) or "nothing is wrong with them"
        raise ValueError(f"{path}: only {keep.sum()} of {len(keep)} rows are good; a drive has at least two: {why}.")
    measured, true = (_poses(part, names, keep) for names in (_MEASURED, _TRUE))
    if measured is not None:
        remarks += _holes(f"{path}: measured poses", measured)
        remarks += _lost(path, measured, twist[keep])
    if true is not None:
        remarks += _holes(f"{path}: true poses", true)
    more = {name: table.numbers(names)[keep] for name, names in _MORE if all(column in table.names for column in names)}
    poses: dict[str, Any] = {"command": twist[keep], "odometry": measured, "true_state": true} | more
    return Drive(
        time=time[keep],
        twist=twist[keep],
        **poses,
        joined=_joined(time, keep, is_stray) & ~is_set[keep],
        around=RoomData(label),
        remarks=tuple(remarks),
    )


def read_poses(path: Path) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Read a table of true poses, and return their times (n,), s, and the poses (n, 3).

    Raises:
        OSError: If the file cannot be read.
        ValueError: If a column is missing.
    """
    table = _open(path)
    names = []
    for name in ("time", *_MEASURED):
        known_as = (*NAMES[name], *NAMES.get(f"true_{name}", ()))
        matches = [column for column in known_as if column in table.names]
        if not matches and name != "theta":
            raise ValueError(f"{path}: no column for {name} ({' or '.join(known_as)}); there are {_some_of(table.names)}.")
        names += matches[:1]
    rows = table.numbers(names)
    rows = rows[(np.abs(rows) <= LARGEST).all(axis=1)]
    rows = rows[~strays(rows[:, 0])]
    rows = rows[np.concatenate([[True], np.diff(np.maximum.accumulate(rows[:, 0])) > 0.0])[: len(rows)]]
    poses = np.full((len(rows), 3), np.nan)
    poses[:, : rows.shape[1] - 1] = rows[:, 1:]
    return rows[:, 0].copy(), poses


def _open(path: Path) -> _Table:
    if zipfile.is_zipfile(path):
        return _arrays(path)
    try:
        text = read_text(path, most=LARGEST_LOG)
    except UnicodeDecodeError:
        raise ValueError(f"{path}: {_BINARY}") from None
    if "\0" in text:
        raise ValueError(f"{path}: {_BINARY}")
    rows = text.splitlines()
    lines = [number for number, line in enumerate(rows, start=1) if line and not line.isspace()]
    if not lines:
        raise ValueError(f"{path}: the file is empty.")
    header = rows[lines.pop(0) - 1].lstrip("#").strip()
    mark = next((mark for mark in ",;\t" if mark in header), None)
    names = _cells(header, mark)
    twice = sorted(name for name, number in Counter(names).items() if name and number > 1)
    if twice:
        raise ValueError(f"{path}: column {_some_of(twice)} is there more than once; rename one of them.")

    def numbers(wanted: Sequence[str]) -> NDArray[np.float64]:
        places = [names.index(name) for name in wanted]
        parsed = []
        for line in lines:
            cells = _cells(rows[line - 1], mark)
            try:
                if len(cells) != len(names):
                    raise ValueError(f"{len(cells)} cells instead of {len(names)}")
                parsed.append([float(cells[place] or "nan") for place in places])
            except ValueError as error:
                if line == lines[-1] and len(cells) <= len(names) and parsed:
                    parsed.append([np.nan] * len(places))  # cut short, as by a recording that broke off
                    break
                raise ValueError(f"{path}: line {line}: {error!s:.300}.") from None
        return np.array(parsed, np.float64).reshape(-1, len(places))

    return _Table(names, numbers, lines)


def _cells(line: str, mark: str | None) -> tuple[str, ...]:
    return tuple(cell.strip().strip('"') for cell in line.split(mark))


def _arrays(path: Path) -> _Table:
    """Return the arrays of an ``.npz`` file: each is a column, or several if its rows are states, poses or twists."""
    columns: dict[str, NDArray[np.float64]] = {}
    for name, array in read_arrays(path).items():
        try:
            values = np.asarray(array, np.float64)
        except (ValueError, TypeError) as error:
            raise ValueError(f"{path}: array {name!r}: {' '.join(str(error).split())}.") from error
        parts = _STATE[3:] if values.shape[1:] == (2,) else _STATE
        if values.ndim == 1:
            columns[name] = values
        elif values.ndim == 2:
            columns |= {f"{name}_{part}": column for part, column in zip(parts, values.T, strict=False)}
    sizes = {len(column) for column in columns.values()}
    if len(sizes) != 1:
        raise ValueError(f"{path}: its columns must be equally long, got lengths {sorted(sizes)}.")
    return _Table(
        tuple(columns), lambda wanted: np.stack([columns[name] for name in wanted], axis=1), range(1, 1 + next(iter(sizes)))
    )


def _some_of(names: Sequence[str], most: int = 12) -> str:
    """Return names for a message: the first few, and how many more there are."""
    first = ", ".join(map(repr, names[:most]))
    return first + (f" and {len(names) - most} more" if len(names) > most else "")


def _choose(path: Path, names: Sequence[str], columns: Mapping[str, str]) -> dict[str, str]:
    """Return the column of each quantity in a table."""
    unknown = [name for name in columns if name not in NAMES]
    if unknown:
        raise ValueError(f"columns must name {', '.join(NAMES)}, got {', '.join(unknown)}.")
    chosen = dict(columns)
    for name, known_as in NAMES.items():
        matches = [column for column in known_as if column in names and column not in columns.values()]
        if name not in chosen and matches:
            chosen[name] = matches[0]
    lone = "theta" in names and chosen.get("theta") == "theta" and chosen.get("true_theta") == "theta"
    if lone:  # one column cannot be both
        chosen.pop("true_theta" if "x" in chosen else "theta")
    for position, heading in (("x", "theta"), ("true_x", "true_theta")):
        if position not in chosen:
            chosen.pop(heading, None)
    missing = [name for name in ("time", *_TWIST) if name not in chosen]
    for group in (_MEASURED, _TRUE[:2]):
        if any(name in chosen for name in group):
            missing += [name for name in group if name not in chosen]
    missing += [name for name, column in chosen.items() if column not in names]
    if not any(name in chosen for name in ("x", "true_x")):
        missing += ["x or true_x"]
    if missing:
        wanted = ", ".join(f"{name} ({' or '.join(NAMES[name])})" if name in NAMES else name for name in missing)
        raise ValueError(f"{path}: no column for {wanted}; there are {_some_of(names)}.")
    return chosen


def _good(
    path: Path,
    time: NDArray[np.float64],
    twist: NDArray[np.float64],
    is_stray: NDArray[np.bool_],
    lines: Sequence[int],
) -> tuple[NDArray[np.bool_], list[str]]:
    """Return which rows are good, and remarks on the others."""
    finite = np.isfinite(time) & known(twist)
    late = finite & ~increasing(np.where(finite, time, np.nan))
    remarks = [
        f"{path}: {bad.sum()} of {len(bad)} rows {reason}, first in line {lines[int(np.argmax(bad))]}: left out"
        for bad, reason in (
            (is_stray, "whose time is far from those around"),
            (~finite & ~is_stray, "without a finite time and twist"),
            (late, "whose time does not increase"),
        )
        if bad.any()
    ]
    return finite & ~late, remarks


def _joined(time: NDArray[np.float64], keep: NDArray[np.bool_], is_stray: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which of the kept rows continue the kept row before: nothing lies between, or strays that took no time."""
    rows = np.flatnonzero(keep)
    steps = np.diff(time[rows], prepend=np.nan)
    left_out = np.cumsum(~keep & ~is_stray)[rows]
    passed = np.diff(rows, prepend=-1) > 1
    joined = np.diff(left_out, prepend=-1) == 0
    return joined & ~(passed & (steps > MISSING * np.nanmedian(steps)))


def _poses(
    part: Mapping[str, NDArray[np.float64]], names: Sequence[str], keep: NDArray[np.bool_]
) -> NDArray[np.float64] | None:
    if names[0] not in part:
        return None
    poses = np.stack([part[name] for name in names if name in part], axis=1)[keep]
    poses[~known(poses)] = np.nan
    return poses


def _holes(what: str, poses: NDArray[np.float64]) -> list[str]:
    missing = np.isnan(poses[:, 0])
    return [f"{what} are missing in {missing.sum()} of {len(missing)} rows"] if missing.any() else []


def _lost(path: Path, poses: NDArray[np.float64], twist: NDArray[np.float64]) -> list[str]:
    """Mark, in place, poses that stand still while the robot moves as lost: a pose that a driver repeats is no measurement."""
    same = np.concatenate([[False], (poses[1:] == poses[:-1]).all(axis=1) & (np.abs(twist[1:]).max(axis=1) > 1e-3)])
    if not same.any():
        return []
    poses[same] = np.nan
    return [
        f"{path}: measured poses are repeated in {same.sum()} of {len(same)} rows while the robot moves: taken as not measured"
    ]
