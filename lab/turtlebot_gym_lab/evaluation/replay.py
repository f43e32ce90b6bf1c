"""The filter on recorded drives: recorded wheel odometry, and measured poses, recorded or generated from the true ones.

Real wheels slip and drift in ways that no simulation does. A recording with motion-capture truth shows whether the filter
copes: it predicts with the recorded twist, and is corrected by the recorded poses of a sensor, such as those of AMCL, or if
there are none, a few times a second by the true pose with an odometry preset's noise.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.config import POSITIVE_OR_INFINITE, as_int, choose
from turtlebot_gym.drive import Drive, known, position_error
from turtlebot_gym.estimation.consistency import nees
from turtlebot_gym.models.random import MAX_SEED
from turtlebot_gym.models.unicycle import INTEGRATORS
from turtlebot_gym.parameters import FilterTuning, Noise, ProcessNoise
from turtlebot_gym.plotting import PURPLE, legend_below, tutorial_figure
from turtlebot_gym.presets import WHEEL, make_filter, make_noise
from turtlebot_gym.robots import Robot
from turtlebot_gym.values import Pose
from turtlebot_gym_agents.evaluation.metrics import Errors, errors
from turtlebot_gym_lab.calibration.alignment import in_one_frame
from turtlebot_gym_lab.calibration.plausibility import require_units
from turtlebot_gym_lab.evaluation.rows import RecordedRows, filtered, rolled

if TYPE_CHECKING:
    from matplotlib.figure import Figure


ANY_ROBOT = Robot(max_linear=1.0, max_angular=3.0)
"""Speed limits for unknown robots; no small robot reaches the refused multiples of them."""


def replayable(drive: Drive, *, recorded: bool = False) -> Drive:
    """Return the longest stretch of a drive whose rows continue each other and that begins and ends with a true pose.

    If its measured poses are replayed, the stretch begins with one, and the truth is in their frame.

    Raises:
        ValueError: If there is no truth, no measured pose is to be replayed, or a unit is wrong.
    """
    where = drive.around.label
    if recorded and not drive.has_odometry:
        raise ValueError(f"{where}: it holds no measured poses: name their topic or columns, or generate them from the truth.")
    has_truth = known(drive.truth)
    if has_truth.sum() < 2:
        raise ValueError(f"{where}: a replay needs the true poses; record them, or name their columns or their topic.")
    require_units(drive, ANY_ROBOT, where)
    if recorded:
        drive, _, remarks = in_one_frame(drive)
        drive = replace(drive, remarks=(*drive.remarks, *(f"{where}: {remark}" for remark in remarks)))
    begins = np.flatnonzero(~drive.joined)
    stretches = [rows[has_truth[rows]] for rows in np.split(np.arange(len(drive)), begins[1:])]
    if recorded:
        first = [np.argmax(known(drive.odometry[rows])) if len(rows) else 0 for rows in stretches]
        stretches = [rows[at:] for rows, at in zip(stretches, first, strict=True) if known(drive.odometry[rows]).any()]
    if not stretches:
        raise ValueError(f"{where}: the true and the measured poses do not overlap in time.")
    first, last = max(((rows[0], rows[-1]) for rows in stretches if rows.size), key=lambda ends: ends[1] - ends[0])
    if last - first + 1 == len(drive):
        return drive
    remark = f"{where}: only rows {first + 1} to {last + 1} of {len(drive)} are replayed, the longest stretch without a gap"
    return replace(drive[first : last + 1], remarks=(*drive.remarks, remark))


def dead_reckoning(drive: Drive, *, start: Pose | None = None, integrator: str = "midpoint") -> NDArray[np.float64]:
    """Return the poses by dead reckoning from a start, by default the first true pose, shape (T, 3)."""
    rule = choose("integrator", integrator, INTEGRATORS)
    pose = Pose(*drive.truth[0].tolist()) if start is None else start
    return rolled(np.diff(drive.time, prepend=drive.time[0]), drive.twist, pose, rule)


def _segments(truth: NDArray[np.float64], length: float) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the first and last rows of consecutive segments of a drive that have a given length along the true path."""
    rows = np.flatnonzero(known(truth))
    path = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(truth[rows, :2], axis=0).T))])
    ends = rows[np.searchsorted(path, np.arange(0.0, path[-1], length))]
    return ends[:-1], ends[1:]


def drift(
    poses: NDArray[np.float64], truth: NDArray[np.float64], first: NDArray[np.intp], last: NDArray[np.intp]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the errors of position and heading at the end of each segment, for odometry that starts at the true pose.

    Poses and truth have the shape (T, 3), and the first and last rows of segments (n,).

    Returns:
        Distances (n,), m, and signed angles (n,), rad.
    """
    turn = truth[first, 2] - poses[first, 2]
    moved = (poses[last, 0] - poses[first, 0]) + 1j * (poses[last, 1] - poses[first, 1])
    expected = (truth[last, 0] - truth[first, 0]) + 1j * (truth[last, 1] - truth[first, 1])
    angle = poses[last, 2] + turn - truth[last, 2]
    return np.abs(moved * np.exp(1j * turn) - expected), np.angle(np.exp(1j * angle))


def replay(
    drive: Drive,
    *,
    noise: str | Noise = "documented",
    filter: str | FilterTuning = "matched",
    process: ProcessNoise = WHEEL.process,
    seed: int = 0,
    rate: float = 10.0,
    integrator: str = "midpoint",
    recorded: bool = False,
) -> Drive:
    """Run the filter over a recorded drive.

    Args:
        drive: A drive with twist and truth, as from `replayable`.
        noise: A name in `turtlebot_gym.NOISES`, or a noise model; only its odometry is used, since the noise of execution is
            real.
        filter: A name in `turtlebot_gym.presets.FILTERS` (for that odometry, and for ``process``), or a tuning.
        process: Drift of the recorded wheels that the filter assumes; by default that of the preset "wheel".
        seed: Seed of the odometry's noise.
        rate: Measured poses per second; infinite for every row.
        integrator: "euler" or "midpoint".
        recorded: Whether the filter is corrected by the drive's own measured poses, as from ``replayable(recorded=True)``; then
            ``noise`` only says what the filter assumes of them, and ``seed`` counts for nothing.

    Returns:
        The drive from time 0 with the odometry used (NaN on rows without a measurement), estimate and covariance on every row.
        ``command`` is the recorded twist.

    Raises:
        ValueError: If an argument is unknown or out of its range.
    """
    POSITIVE_OR_INFINITE.check("rate", rate)
    as_int("seed", seed, 0, MAX_SEED)
    in_force = replace(make_noise(noise), process=process)
    if recorded and in_force.odometry.wheel:
        raise ValueError(f"noise must be that of measured poses, got {noise!r}: by wheels the filter is not corrected.")
    tuning, rule = make_filter(filter, in_force), choose("integrator", integrator, INTEGRATORS)
    # The twist of row k moves the robot from row k-1 to row k, so it is the command at row k-1.
    commands = np.concatenate([drive.twist[1:], drive.twist[-1:]])
    elapsed = drive.time - drive.time[0]
    ticks = np.floor(elapsed * rate + 1e-6) if math.isfinite(rate) else np.arange(elapsed.size)
    due = known(drive.odometry if recorded else drive.truth)
    if recorded:
        at = np.flatnonzero(due)
        due[at] = np.diff(ticks[at], prepend=-1.0) > 0.0
    else:
        due &= np.diff(ticks, prepend=-1.0) > 0.0
    intervals = np.diff(drive.time, prepend=drive.time[0])
    poses = drive.odometry if recorded else np.empty((0, 3))
    rows = RecordedRows(intervals, drive.truth, dead_reckoning(drive), commands, poses, due)
    result = filtered(rows, tuning, in_force.odometry, seed=seed, integrator=rule)
    return replace(
        drive,
        time=elapsed,
        odometry=np.where(result.measured[:, None], result.odometry, np.nan),
        estimate=result.estimate,
        covariance=result.covariance,
        command=commands,
        scans=tuple(seen._replace(time=seen.time - drive.time[0]) for seen in drive.scans),
    )


class Replayed(NamedTuple):
    """Results of replaying a drive with several seeds."""

    raw: Errors
    """Errors of the measured poses; arrays with a number per seed, like those of the filter."""
    wheels: Errors
    """Errors of dead reckoning from the first true pose; a single number each."""
    filter: Errors
    """Errors of the filter's estimate."""
    nees: NDArray[np.float64]
    """Mean NEES of the filter's pose, a number per seed: 3 if its covariance is right."""
    drift: float
    """Mean position error of dead reckoning over consecutive segments of 1 m, m."""
    drift_heading: float
    """Mean heading error over the same segments, rad."""
    trajectory: Drive
    """The drive with the first seed."""

    def summary(self) -> dict[str, Any]:
        """Return the means over the seeds, and the numbers of each seed."""
        means = {
            name: {key: float(np.mean(values)) for key, values in errors._asdict().items()}
            for name, errors in (("raw", self.raw), ("wheels", self.wheels), ("filter", self.filter))
        }
        per_metre = {"position": self.drift, "heading": self.drift_heading}
        seeds = {"raw": self.raw, "filter": self.filter, "nees": self.nees}
        return {"mean": means, "nees": float(np.mean(self.nees)), "wheels_per_metre": per_metre, "seeds": seeds}


def replay_seeds(
    drive: Drive, seeds: Sequence[int], *, progress: Callable[[], None] = lambda: None, **options: Any
) -> Replayed:
    """Replay a drive with several seeds.

    ``progress`` is called after each; the options are those of `replay`.
    """
    trajectories = []
    for seed in seeds:
        trajectories.append(replay(drive, seed=seed, **options))
        progress()
    truth = np.repeat(drive.truth[:, None], len(trajectories), axis=1)
    wheels = dead_reckoning(drive)
    position, heading = drift(wheels, drive.truth, *_segments(drive.truth, 1.0))
    return Replayed(
        errors(np.stack([replayed.odometry for replayed in trajectories], axis=1), truth),
        errors(wheels, drive.truth),
        errors(np.stack([replayed.estimate for replayed in trajectories], axis=1), truth),
        np.array([_mean_nees(replayed) for replayed in trajectories]),
        float(position.mean()) if position.size else np.nan,
        float(np.abs(heading).mean()) if heading.size else np.nan,
        trajectories[0],
    )


def _mean_nees(replayed: Drive) -> float:
    """Return the mean NEES of the estimated pose over the rows with a truth, and after the first row."""
    rows = known(replayed.truth)
    rows[0] = False
    if not rows.any():
        return float("nan")
    estimate, truth, covariance = (each[rows] for each in (replayed.estimate, replayed.true_state, replayed.covariance))
    return float(np.mean(nees(estimate, truth, covariance)))


def replay_figure(trajectory: Drive, wheels: NDArray[np.float64], *, title: str | None = None) -> Figure:
    """Return a figure of a replayed drive: its trajectory, pose over time, and errors, with those of dead reckoning."""
    figure = tutorial_figure(trajectory, title=title)
    panels = {axes.get_label(): axes for axes in figure.axes}
    style: dict[str, Any] = {"color": PURPLE, "linestyle": ":", "linewidth": 1.5, "label": "wheels alone"}
    panels["trajectory"].plot(wheels[:, 0], wheels[:, 1], **style)
    panels["error"].plot(trajectory.time, position_error(wheels, trajectory.true_state), **style)
    legend_below(figure, columns=8)
    return figure
