"""A truth that jumps: poses of another robot, of a marker seen the wrong way round, or after a leap of the frame.

Between two jumps the truth is one piece, right in a frame of its own: the drive is cut there. A piece in which the robot hardly
moves is left out.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

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
"""Motion from which a piece is kept, m."""


def cleaned(drive: Drive, wheels: Array, integrator: float) -> tuple[Drive, str]:
    """Return a drive without the truth's wrong poses, cut where its frame leaps, and a remark; nothing if it has none.

    Args:
        drive: The drive.
        wheels: The wheels' parameters, shape (8,), robustly fitted.
        integrator: The integrator, a value of `models.unicycle.Integrator`.
    """
    path = path_of(drive)
    rows, motion = np.flatnonzero(known(drive.truth)), path.motion

    if len(rows) < 2:
        return drive, ""
    windows = Windows(path.time[rows[:-1]], path.time[rows[1:]], relative(drive.truth[rows[:-1]], drive.truth[rows[1:]]))
    limit = TOLERANCE + PER_METRE * np.diff(motion[rows])[:, None]
    steps = np.abs(rest(path, windows, wheels, integrator)) / limit
    limits = np.maximum(1.0, FASTEST * 1.4826 * np.median(steps, axis=0))
    joined = path.part[rows[1:]] == path.part[rows[:-1]]
    jumps = (steps > limits).any(axis=1) & joined
    if not jumps.any():
        return drive, ""
    truth, cuts, left_out = drive.true_state.copy(), drive.joined.copy(), 0.0
    for piece in np.split(rows, np.flatnonzero(jumps | ~joined) + 1):
        cuts[piece[0]] = False
        if motion[piece[-1]] - motion[piece[0]] < JUDGED:
            truth[piece] = np.nan
            left_out += float(drive.time[piece[-1]] - drive.time[piece[0]])
    found = drive.time[rows[1:]][jumps] - drive.time[0]
    times = ", ".join(f"{time:.2f}" for time in found[:MENTIONED]) + (", ..." if len(found) > MENTIONED else "")
    remark = f"the truth jumps {len(found)} times, at {times} s from the start; {left_out:.1f} s of it are left out"
    return replace(drive, true_state=truth, joined=cuts), remark


def at_axle(drive: Drive, x: float, y: float, direction: float) -> Drive:
    """Return a drive with its truth at the point that the wheels move, from that of a marker there; m, m, rad."""
    state = drive.true_state.copy()
    heading = state[:, 2] - direction
    state[:, 0] -= x * np.cos(heading) - y * np.sin(heading)
    state[:, 1] -= x * np.sin(heading) + y * np.cos(heading)
    state[:, 2] = wrap_all(heading)
    return replace(drive, true_state=state)
