"""Whether a file helps: fitted to one half of a drive, it drives the other.

Dead reckoning by the file is compared with raw odometry over pieces of the half that the fit has not seen: the drift at their
ends, and whether the noise of the file says how large it is (NEES, 3 for a pose).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from turtlebot_gym.drive import Drive
from turtlebot_gym_lab.calibration.alphas import pieces_of
from turtlebot_gym_lab.calibration.windows import USUAL, Array, path_of

LENGTHS = (2.0, 5.0)
"""Lengths of the pieces along the way, m."""
NEAR = (0.1, 0.5)
"""Lengths of further pieces, m, a turn counted by `windows.LEVER`: a filter that is corrected often meets errors of these."""
OVERLAP, FEWEST = 4, 4
"""Pieces that begin in the length of one, and fewest of them that say something."""
BETTER, WORSE = 0.97, 1.1
"""Ratios of the drift by file to raw: up to the first, other wheels than the usual are evident; above the second, refused."""
DEGREES = 3.0
"""Degrees of freedom of a pose."""


class Held(NamedTuple):
    """Pieces of one length that were not fitted."""

    length: float
    """m"""
    pieces: int
    """Number of pieces."""
    raw: float
    """Root mean square of the drift of raw odometry, m ..."""
    file: float
    """... and of odometry by the file."""
    raw_nees: float
    """Mean NEES of raw odometry with the preset's noise ..."""
    usual_nees: float
    """... with the noise of the file ..."""
    nees: float
    """... and of odometry by the file."""


class Verdict(NamedTuple):
    """Result of driving each half with the fit of the other."""

    is_good: bool
    """Whether the file may be used."""
    text: str
    """One line for the user."""
    held: tuple[Held, ...] = ()
    """For each length; nothing if the drive is too short to tell."""
    is_usual: bool = False
    """Whether other wheels than the usual ones do not help, so that the file has these."""


UNTESTED = Verdict(True, "Nothing tests the wheels, so the file has the usual: drive 10 m or more, with the truth.", (), True)


def halves(drive: Drive) -> tuple[Drive, Drive]:
    """Return two halves of a drive, of as much motion."""
    motion = path_of(drive).motion
    middle = int(np.searchsorted(motion, 0.5 * motion[-1]))
    return drive[:middle], drive[middle:]


def judge(
    drive: Drive, fit: Callable[[Drive], tuple[Array, Array]], variances: Array, integrator: float
) -> tuple[Verdict, float]:
    """Return the verdict on a kind of fit, and by what its variances must be multiplied to be honest, at least 1.

    The drive has the truth of the axle's middle. ``fit`` returns wheels, shape (8,), and variances, shape (6,), of a part, or
    says by a `ValueError` that it is too short; raw odometry is judged by some variances.
    """
    first, second = halves(drive)
    try:
        fits = [fit(part) for part in (first, second)]
    except ValueError:
        return UNTESTED, 1.0
    held = []
    for length in LENGTHS:
        columns = []
        for part, (wheels, fitted) in ((second, fits[0]), (first, fits[1])):
            path = path_of(part)
            raw, file = (
                pieces_of(path, part.truth, each, integrator, length, overlap=OVERLAP, by_way=True) for each in (USUAL, wheels)
            )
            squares = ((each.off[:, :2] ** 2).sum(axis=1) for each in (raw, file))
            columns.append(np.stack([*squares, raw.nees(variances), raw.nees(fitted), file.nees(fitted)]))
        if min(column.shape[1] for column in columns) < FEWEST:
            continue
        table = np.concatenate(columns, axis=1)
        means = table.mean(axis=1).tolist()
        held.append(Held(length, table.shape[1], means[0] ** 0.5, means[1] ** 0.5, *means[2:]))
    if not held:
        return UNTESTED, 1.0
    drift = ", ".join(f"{each.file:.3f} m after {each.length:g} m instead of {each.raw:.3f} m" for each in held)
    text = f"Fitted to one half, the wheels drift in the other by {drift} raw"
    if any(each.file > WORSE * each.raw for each in held):
        why = "the wheels or the floor change during the drive, or the truth is wrong; record a longer drive, on one floor"
        return Verdict(False, f"The file makes the wheels worse. {text}: {why}.", tuple(held)), 1.0
    is_usual = all(each.file > BETTER * each.raw for each in held)
    nees = [each.usual_nees if is_usual else each.nees for each in held]
    for length in NEAR:
        sides = zip((second, first), fits, strict=True)
        near = [
            pieces_of(path_of(part), part.truth, USUAL if is_usual else wheels, integrator, length).nees(fitted)
            for part, (wheels, fitted) in sides
        ]
        nees.append(float(np.concatenate(near).mean()))
    factor = max(1.0, *(each / DEGREES for each in nees))
    text += "; no others than the usual wheels are evident, and the file has these" if is_usual else ""
    text += f"; NEES {', '.join(f'{each:.1f}' for each in nees[: len(held)])} for {DEGREES:g}"
    text += f", and the alphas are {factor:.1f} times as large for it" if factor > 1.0 else ""
    return Verdict(True, f"{text}.", tuple(held), is_usual), factor
