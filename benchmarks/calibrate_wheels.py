"""Fit the drift of wheel odometry, the alphas of `turtlebot_gym.ProcessNoise`, to recorded drives with known truth.

From every row, wheel odometry is integrated from the true pose for 0.5, 1 and 2 m, and its errors of position and heading are
compared with those predicted by noise on speed and turning rate:

    E[position error^2] = sum over rows of (var_v + var_omega L^2) dt^2,    E[heading error^2] = sum of var_omega dt^2,

with L the distance from the row's motion to the end of the segment, and var_v, var_omega the variances of the execution. The
alphas maximize the likelihood of the errors under a Gaussian model (isotropic in position), with equal weight for each drive
and length. This is not the likelihood of whole poses: real wheels slip sideways in turns, which noise on a unicycle's twist
could only mimic by being inflated.

`turtlebot-gym calibrate`, which fits that likelihood to one drive, is no substitute here: from these two recordings, which are
slow and hardly turn on the spot, it determines no alpha, and two intervals of the second one lie above the preset
(`calibration_recorded.json`).

    python benchmarks/calibrate_wheels.py ../shared/data/wifibot1.txt ../shared/data/wifibot2.txt
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import tyro
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table
from scipy.optimize import minimize

from turtlebot_gym.drives import Drive, read
from turtlebot_gym.parameters import REFERENCE_PERIOD
from turtlebot_gym_agents.evaluation.replay import dead_reckoning, drift, replayable

LENGTHS = (0.5, 1.0, 2.0)
"""Lengths of the segments, m."""
RESOLUTION = 1e-7
"""Least variance of an error: that of the truth, a third of a millimetre and of a milliradian, squared."""
STARTS = ((1e-3, 1e-3, 1e-3, 1e-3), (1e-2, 1e-4, 1e-2, 1e-3), (1e-4, 1e-4, 1e-4, 1e-4))
"""Alphas at which the search starts."""


class Segments(NamedTuple):
    """Errors at the ends of a drive's n segments, and the variances that each alpha predicts at the value 1."""

    position: NDArray[np.float64]
    """Squared errors, shape (n,), m^2."""
    heading: NDArray[np.float64]
    """rad^2"""
    to_position: NDArray[np.float64]
    """Shape (n, 4)."""
    to_heading: NDArray[np.float64]

    def likelihood(self, alphas: NDArray[np.float64]) -> float:
        """Return minus the mean log-likelihood of the errors."""
        position, heading = self.to_position @ alphas + RESOLUTION, self.to_heading @ alphas + RESOLUTION
        two_dimensions = np.log(position) + self.position / position
        return float(np.mean(two_dimensions + 0.5 * (np.log(heading) + self.heading / heading)))


def collect(drive: Drive, length: float) -> Segments:
    """Return the segments that begin at each row at which the robot moves."""
    wheels = dead_reckoning(drive)
    path = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(drive.truth[:, :2], axis=0).T))])
    first = np.flatnonzero((np.diff(path, prepend=-1.0) > 0.0) & (path + length <= path[-1]))
    last = np.searchsorted(path, path[first] + length)
    position, heading = drift(wheels, drive.truth, first, last)
    middle = 0.5 * (wheels[1:, :2] + wheels[:-1, :2])
    # A variance of 1 on the twist becomes 0.1 s / dt, that is 0.1 s dt on a row's motion.
    shares = REFERENCE_PERIOD * np.diff(drive.time)[:, None] * drive.twist[1:] ** 2
    to_position, to_heading = np.zeros((len(first), 4)), np.zeros((len(first), 4))
    for at, (i, j) in enumerate(zip(first, last, strict=True)):
        lever = ((wheels[j, :2] - middle[i:j]) ** 2).sum(axis=1)
        to_heading[at, 2:] = shares[i:j].sum(axis=0)
        to_position[at] = np.concatenate([to_heading[at, 2:], lever @ shares[i:j]])
    return Segments(position**2, heading**2, to_position, to_heading)


def fit(drives: list[list[Segments]]) -> NDArray[np.float64]:
    """Return the maximum-likelihood alphas, shape (4,)."""

    def cost(logarithms: NDArray[np.float64]) -> float:
        return sum(segments.likelihood(np.exp(logarithms)) for drive in drives for segments in drive)

    options = {"maxiter": 10_000, "maxfev": 10_000, "xatol": 1e-4, "fatol": 1e-8}
    searches = [minimize(cost, np.log(start), method="Nelder-Mead", options=options) for start in STARTS]
    return np.exp(min(searches, key=lambda search: search.fun).x)


@dataclass(frozen=True)
class Config:
    """Fit the drift of wheel odometry to recorded drives."""

    files: tyro.conf.Positional[tuple[Path, ...]]
    """Recordings, as for `turtlebot-gym replay`."""


def main() -> None:
    """Fit, and print the alphas and how well they predict the drift."""
    files = tyro.cli(Config, description=__doc__).files
    drives = [[collect(replayable(read(path)), length) for length in LENGTHS] for path in files]
    alphas = fit(drives)
    table = Table(
        "drive", "segments, m", "position error, m", "as fitted", "heading error, rad", "as fitted", title="root mean squares"
    )
    for path, drive in zip(files, drives, strict=True):
        for length, figures in zip(LENGTHS, drive, strict=True):
            squares = (figures.position, figures.to_position @ alphas, figures.heading, figures.to_heading @ alphas)
            table.add_row(path.name, f"{length:g}", *(f"{np.sqrt(np.mean(square)):.4f}" for square in squares))
    console = Console(width=120)
    console.print(table)
    console.print(", ".join(f"alpha{at}={alpha:.2g}" for at, alpha in enumerate(alphas, start=1)), highlight=False)


if __name__ == "__main__":
    main()
