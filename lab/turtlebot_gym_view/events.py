"""What happened in a drive: arrivals, contacts, worse reports of the guard, a lost estimate, fixes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.drive import Drive, position_error

ASTRAY = 0.5
"""Error of the position beyond which `turtlebot-gym evaluate` counts a robot as lost, m."""
KINDS = ("arrival", "contact", "guard", "lost", "fix")
"""Kinds of events, in the order in which those of the same row are listed."""
_ENDINGS = {"success": "arrival", "collision": "contact"}


def events_of(drive: Drive) -> list[tuple[int, str]]:
    """Return row and kind of each event of a drive, in order; the first row has none, since it has no row before it.

    An arrival is a change of the goal while the robot is within two goal radii of it. The other events begin in their row: the
    clearance falls below 0, the guard's level rises, the estimate is more than `ASTRAY` off, a fix arrives.
    """
    known = np.isfinite(drive.true_state[:, :1])
    robot = np.where(known, drive.true_state[:, :2], drive.estimate[:, :2])
    goal = drive.reference[:, :2]
    is_new = np.zeros(len(drive), np.bool_)
    is_new[1:] = (goal[1:] != goal[:-1]).any(axis=1)
    is_near = np.zeros(len(drive), np.bool_)
    is_near[1:] = np.hypot(*(goal[:-1] - robot[1:]).T) <= 2.0 * drive.around.goal_radius
    level = np.nan_to_num(drive.level)
    rises = np.zeros(len(drive), np.bool_)
    rises[1:] = level[1:] > level[:-1]
    happens = {
        "arrival": is_new & is_near,
        "contact": _begins(drive.clearance < 0.0),
        "guard": rises,
        "lost": _begins(position_error(drive.estimate, drive.true_state) > ASTRAY),
        "fix": drive.fix > 0.0,
    }
    found = [(int(row), kind) for kind in KINDS for row in np.flatnonzero(happens[kind]) if row > 0]
    return sorted(found, key=lambda event: (event[0], KINDS.index(event[1])))


def all_events_of(drive: Drive) -> list[tuple[int, str]]:
    """Return the events of a complete drive: `events_of`, and the one with which it ended."""
    events = events_of(drive)
    ending = (len(drive) - 1, _ENDINGS.get(drive.outcome.partition(" ")[0], ""))
    return events if not ending[1] or ending in events else [*events, ending]


def told_outcome(drive: Drive) -> str:
    """Return how a drive ended; of one that reached several goals and ended on the way to the next, with their number."""
    goals = sum(kind == "arrival" for _, kind in all_events_of(drive))
    ending = drive.outcome.partition(" after ")[0]
    if goals < 2 or ending in ("", "success"):
        return drive.outcome
    seconds = float(drive.time[-1] - drive.time[0])
    return f"{goals} goals in {seconds:.1f} s{'' if ending == 'time is up' else f', then {ending}'}"


def _begins(happens: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the rows at which something begins that did not happen in the row before."""
    return happens & ~np.concatenate([[False], happens[:-1]])
