"""A truth that jumps: poses of another robot, of a marker seen the wrong way round, or after a leap of the frame.

Between two jumps the truth is one piece. A piece that continues the last good one, by the wheels, is good, and what lies
between them is left out. One that does not, but moves as the wheels do, is right in a frame of its own: the drive is cut there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.drive import Drive, known
from turtlebot_gym.models.angles import wrap_all
from turtlebot_gym_lab.calibration.windows import Array, Windows, path_of, relative, rest

TOLERANCE, PER_METRE = np.array([0.05, 0.05, 0.1]), np.array([0.15, 0.15, 0.15])
"""Difference from the wheels from which the truth jumps, m, m, rad: in any case, and for each metre of motion in between."""
FASTEST = 5.0
"""Standard deviations (by their median) that a step must differ by, so that noise is no jump."""
MENTIONED = 5
"""Most jumps whose times are mentioned."""
JUDGED = 0.5
"""Motion from which a piece can be judged by itself, m."""


def cleaned(drive: Drive, wheels: Array, integrator: float) -> tuple[Drive, str]:
    """Return a drive without the truth's wrong poses, cut where its frame leaps, and a remark; nothing if it has none.

    The wheels' parameters, shape (8,), are robustly fitted.
    """
    path = path_of(drive)
    rows, motion = np.flatnonzero(known(drive.truth)), path.motion

    def off(first: NDArray[np.intp], last: NDArray[np.intp]) -> Array:
        """Return how far the truth at some rows is from where the wheels bring it from others, in tolerances."""
        windows = Windows(path.time[first], path.time[last], relative(drive.truth[first], drive.truth[last]))
        limit = TOLERANCE + PER_METRE * (motion[last] - motion[first])[:, None]
        return np.abs(rest(path, windows, wheels, integrator)) / limit

    if len(rows) < 2:
        return drive, ""
    steps = off(rows[:-1], rows[1:])
    limits = np.maximum(1.0, FASTEST * 1.4826 * np.median(steps, axis=0))
    joined = path.part[rows[1:]] == path.part[rows[:-1]]
    jumps = (steps > limits).any(axis=1) & joined
    if not jumps.any():
        return drive, ""
    truth, cuts, good = drive.true_state.copy(), drive.joined.copy(), -1
    left_out, jumped = 0.0, []
    for piece in np.split(rows, np.flatnonzero(jumps | ~joined) + 1):
        first, last = piece[[0]], piece[[-1]]
        follows = good >= 0 and path.part[good] == path.part[piece[0]]
        if follows and (off(np.array([good]), first) > limits).any():
            jumped.append(float(drive.time[piece[0]] - drive.time[0]))
            if not _moves_right(piece, motion, off):
                truth[piece] = np.nan
                left_out += float(drive.time[last[0]] - drive.time[first[0]])
                continue
            cuts[good + 1 : piece[0] + 1] = False
        elif not follows and not _moves_right(piece, motion, off):
            truth[piece] = np.nan
            continue
        good = int(piece[-1])
    if not jumped:
        return drive, ""
    times = ", ".join(f"{time:.2f}" for time in jumped[:MENTIONED]) + (", ..." if len(jumped) > MENTIONED else "")
    remark = f"the truth jumps {len(jumped)} times, at {times} s from the start; {left_out:.1f} s of it are left out"
    return replace(drive, true_state=truth, joined=cuts), remark


def _moves_right(piece: NDArray[np.intp], motion: Array, off: Callable[[NDArray[np.intp], NDArray[np.intp]], Array]) -> bool:
    """Return whether a piece is long enough to be judged, and moves as the wheels do."""
    at = motion[piece]
    if at[-1] - at[0] < JUDGED:
        return False
    last = np.searchsorted(at, at + JUDGED)
    within = last < len(piece)
    errors = off(piece[within], piece[last[within]])
    return bool((errors > 1.0).any(axis=1).mean() < 0.2)


def at_axle(drive: Drive, x: float, y: float, direction: float) -> Drive:
    """Return a drive with its truth at the point that the wheels move, from that of a marker there; m, m, rad."""
    state = drive.true_state.copy()
    heading = state[:, 2] - direction
    state[:, 0] -= x * np.cos(heading) - y * np.sin(heading)
    state[:, 1] -= x * np.sin(heading) + y * np.cos(heading)
    state[:, 2] = wrap_all(heading)
    return replace(drive, true_state=state)
