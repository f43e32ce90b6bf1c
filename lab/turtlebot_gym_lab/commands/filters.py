"""The subcommands about filters: ``estimate`` and ``replay``."""

from __future__ import annotations

import itertools
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from turtlebot_gym.validation import as_int
from turtlebot_gym_agents.commands.console import FigureFile, ReportingOptions, print_tables, progress, save_figure
from turtlebot_gym_lab.commands.recorded import RecordingOptions

if TYPE_CHECKING:
    from turtlebot_gym.drive import Drive


@dataclass(frozen=True, kw_only=True)
class Estimate(ReportingOptions):
    """Compare filters with the best that any filter could do, and with their own stated uncertainty.

    All filters see the same short drives, whose commands do not depend on the estimate.
    """

    filter: tuple[str, ...] = ("matched", "gated", "mixture", "slip")
    """Filters: matched, calibrated, tutorial, gated, mixture, slip, scale, or of your own (MODULE:NAME)."""
    noise: str = "tutorial"
    """Noise: clean, tutorial, documented, wheel, rough, or a file of your own (FILE.yaml)."""
    robot: str = "burger"
    """Robot: a preset, or a file of your own (FILE.yaml). An unknown name lists the presets."""
    dt: float = 0.1
    """Control interval, s."""
    integrator: str = "euler"
    """Integrator of the motion: euler or midpoint."""
    runs: int = 2000
    """Number of drives; drive i has the seed SEED + i. The default determines an RMSE to 3 %, 20000 drives to 1 %."""
    seconds: float = 3.0
    """Length of a drive."""
    seed: int = 0
    """The first seed."""
    bias: bool = True
    """Whether odometry has the preset's bias, which no filter can detect."""
    slip: bool = True
    """Whether the wheels slip as in the preset."""
    plot: FigureFile = None
    """Draw the errors over time and the bound here."""

    def run(self) -> None:
        from turtlebot_gym_lab.commands import report
        from turtlebot_gym_lab.evaluation.estimation import estimate

        if not self.filter:
            raise ValueError("filter must name at least one.")
        options = {name: getattr(self, name) for name in ("noise", "runs", "seconds", "seed", "robot", "dt", "integrator")}
        with progress(self.runs) as advance_to:
            result = estimate(self.filter, bias=self.bias, slip=self.slip, progress=advance_to, **options)
        print_tables(report.estimation_table(result))
        self.report(asdict(result))
        if self.plot is not None:
            save_figure(report.estimation_figure(result), self.plot)


@dataclass(frozen=True, kw_only=True)
class Replay(ReportingOptions, RecordingOptions):
    """Run the filter over recorded drives with known truth.

    The filter predicts with the recorded wheel odometry, and is corrected by measured poses generated from the true ones with a
    preset's noise.
    """

    files: tyro.conf.Positional[tuple[Path, ...]]
    """Recordings with truth: bags, laser arrays, or tables with named columns."""
    filter: str = "matched"
    """Filter: matched, calibrated, tutorial, gated, mixture, slip, scale, or one of your own (MODULE:NAME)."""
    noise: str = "documented"
    """Noise of the measured poses: clean, tutorial, documented, wheel, rough, or a file of your own (FILE.yaml)."""
    integrator: str = "midpoint"
    """Integrator of the motion: euler or midpoint."""
    seed: int = 0
    """The first seed of the noise."""
    seeds: int = 20
    """Number of seeds to average over."""
    rate: float = 10.0
    """Measured poses per second."""
    plot: FigureFile = None
    """Draw the first seed here; for several files, one figure each, with the file's name appended."""

    def paths(self, name: str) -> tuple[Path, ...]:
        """Return the files that an option writes: for ``plot``, one per drive if there are several."""
        path, drives = getattr(self, name), list(dict.fromkeys(self.files))
        if name != "plot" or len(drives) < 2:
            return (path,)
        stems = [drive.stem for drive in drives]
        numbers = [f"-{at}" if stems.count(stem) > 1 else "" for at, stem in enumerate(stems)]
        return tuple(path.with_stem(f"{path.stem}-{stem}{at}") for stem, at in zip(stems, numbers, strict=True))

    def run(self) -> None:
        from turtlebot_gym_lab.commands import report
        from turtlebot_gym_lab.drives import read
        from turtlebot_gym_lab.evaluation.replay import dead_reckoning, replay_figure, replay_seeds, replayable

        if not self.files:
            raise ValueError("At least one FILE must be given.")
        as_int("seeds", self.seeds, 1)
        drives: dict[Path, Drive] = {}
        with progress(len(self.files)) as advance_to:
            for number, path in enumerate(self.files, start=1):
                drives[path] = replayable(read(path, **self.reading()))
                advance_to(number)
        for remark in (remark for drive in drives.values() for remark in drive.remarks):
            print(remark, file=sys.stderr)
        options = {"noise": self.noise, "filter": self.filter, "rate": self.rate, "integrator": self.integrator}
        results = {}
        with progress(self.seeds * len(drives)) as advance_to:
            count = itertools.count(1)
            for path, drive in drives.items():
                seeds = range(self.seed, self.seed + self.seeds)
                results[path] = replay_seeds(drive, seeds, progress=lambda: advance_to(next(count)), **options)
        names = [path.name for path in results]
        tables = {path.name if names.count(path.name) == 1 else str(path): result for path, result in results.items()}
        print_tables(report.replay_table(tables, title=f"noise {self.noise}, filter {self.filter}, mean of {self.seeds} seeds"))
        self.report({"runs": [{"file": path, **result.summary()} for path, result in results.items()]})
        if self.plot is not None:
            for (path, drive), picture in zip(drives.items(), self.paths("plot"), strict=True):
                figure = replay_figure(
                    results[path].trajectory, dead_reckoning(drive), title=f"{path.name}, noise {self.noise}, seed {self.seed}"
                )
                save_figure(figure, picture)
