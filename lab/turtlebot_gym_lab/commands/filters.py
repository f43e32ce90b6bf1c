"""The subcommand ``replay``."""

from __future__ import annotations

import itertools
import math
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from turtlebot_gym.config import as_int, choose
from turtlebot_gym_agents.commands.console import FigureFile, ReportingOptions, print_tables, progress, save_figure
from turtlebot_gym_lab.commands.recorded import RecordingOptions

if TYPE_CHECKING:
    from turtlebot_gym.drive import Drive
    from turtlebot_gym_lab.commands.replayed import ReplayResult


@dataclass(frozen=True, kw_only=True)
class Replay(ReportingOptions, RecordingOptions):
    """Run the filter over recorded drives with known truth.

    The filter predicts with the recorded wheel odometry, and is corrected by the recorded poses of a sensor, such as AMCL's; if
    there are none, by poses generated from the true ones with a preset's noise.
    """

    files: tyro.conf.Positional[tuple[Path, ...]]
    """Recordings with truth: bags, laser arrays, or tables with named columns."""
    filter: str = "matched"
    """Filter: matched, calibrated, tutorial, gated, or one of your own (MODULE:NAME)."""
    measured: str = "auto"
    """Measured poses: recorded, generated (from the true ones), or auto: recorded if there are any, such as those on
    /amcl_pose, /pose or /pose_fix of a bag (or another topic by --topics.fix), and generated otherwise."""
    noise: str = "documented"
    """Noise of the measured poses: clean, tutorial, documented, wheel, rough, or a file of your own (FILE.yaml); of recorded
    ones, what the filter assumes."""
    integrator: str = "midpoint"
    """Integrator of the motion: euler or midpoint."""
    seed: int = 0
    """The first seed of the noise of generated poses."""
    seeds: int | None = None
    """Number of seeds of generated poses to average over; 20 by default."""
    rate: float | None = None
    """Measured poses per second, at most; by default 10 of generated ones, and all recorded ones."""
    plot: FigureFile = None
    """Draw the first seed here; for several files, one figure each, with the file's name appended."""

    def _read(self, path: Path) -> tuple[Drive, str]:
        """Return a drive to be replayed, and where its measured poses come from: a topic, "recorded" or "generated"."""
        from turtlebot_gym_lab.calibration.calibrate import detect_kind
        from turtlebot_gym_lab.calibration.estimates import POSE
        from turtlebot_gym_lab.commands.replayed import GENERATED
        from turtlebot_gym_lab.drives import read
        from turtlebot_gym_lab.drives.reading import pose_sensors
        from turtlebot_gym_lab.evaluation.replay import replayable

        if self.measured == GENERATED:
            if self.topics.fix:
                raise ValueError(
                    "--topics.fix names recorded poses, and --measured generated takes none: leave one of them out."
                )
            return replayable(read(path, **self.reading())), GENERATED
        found = pose_sensors(path, truth=self.truth)
        fix = self.topics.fix or (found[0] if len(found) == 1 else "")
        drive = read(path, **replace(self, topics=replace(self.topics, fix=fix)).reading())
        if len(found) > 1 and not self.topics.fix:
            remark = f"{path}: {', '.join(found)} state poses: --topics.fix says which of them corrects the filter"
            drive = replace(drive, remarks=(*drive.remarks, remark))
        if fix or self.measured == "recorded" or detect_kind(drive) == POSE:
            return replayable(drive, recorded=True), fix or "recorded"
        return replayable(drive), GENERATED

    def paths(self, name: str) -> tuple[Path, ...]:
        """Return the files that an option writes: for ``plot``, one per drive if there are several."""
        path, drives = getattr(self, name), list(dict.fromkeys(self.files))
        if name != "plot" or len(drives) < 2:
            return (path,)
        stems = [drive.stem for drive in drives]
        numbers = [f"-{at}" if stems.count(stem) > 1 else "" for at, stem in enumerate(stems)]
        return tuple(path.with_stem(f"{path.stem}-{stem}{at}") for stem, at in zip(stems, numbers, strict=True))

    def run(self) -> None:
        from turtlebot_gym_lab.evaluation.replay import dead_reckoning, replay_figure

        result = self.result()
        print_tables(*result.tables())
        print(result.verdict())
        self.report(result.content()[0])
        if self.plot is not None:
            for (path, drive), picture in zip(result.drives.items(), self.paths("plot"), strict=True):
                title = f"{path.name}, noise {self.noise}, seed {self.seed}"
                save_figure(replay_figure(result.results[path].trajectory, dead_reckoning(drive), title=title), picture)

    def result(self) -> ReplayResult:
        """Return the result; what was wrong in the recordings is told on standard error."""
        from turtlebot_gym_agents.front.results import name_of
        from turtlebot_gym_lab.commands.replayed import GENERATED, ReplayResult
        from turtlebot_gym_lab.evaluation.replay import replay_seeds

        if not self.files:
            raise ValueError("At least one FILE must be given.")
        choose("measured", self.measured, dict.fromkeys(("auto", "recorded", "generated")))
        number = as_int("seeds", 20 if self.seeds is None else self.seeds, 1)
        drives: dict[Path, Drive] = {}
        sensors: dict[Path, str] = {}
        with progress(len(self.files)) as advance_to:
            for at, path in enumerate(self.files, start=1):
                drives[path], sensors[path] = self._read(path)
                advance_to(at)
        if (self.seed or self.seeds is not None) and GENERATED not in sensors.values():
            raise ValueError(
                "seeds are of generated poses, and the poses are recorded: leave them out, or --measured generated."
            )
        for remark in (remark for drive in drives.values() for remark in drive.remarks):
            print(remark, file=sys.stderr)
        results = {}
        seeds = {path: range(self.seed, self.seed + (number if sensors[path] == GENERATED else 1)) for path in drives}
        with progress(sum(map(len, seeds.values()))) as advance_to:
            count = itertools.count(1)
            for path, drive in drives.items():
                recorded = sensors[path] != GENERATED
                results[path] = replay_seeds(
                    drive,
                    seeds[path],
                    progress=lambda: advance_to(next(count)),
                    noise=self.noise,
                    filter=self.filter,
                    rate=self.rate if self.rate is not None else math.inf if recorded else 10.0,
                    integrator=self.integrator,
                    recorded=recorded,
                )
        title = f"noise {name_of(self.noise)}, filter {name_of(self.filter)}"
        title += f", mean of {number} seeds" if GENERATED in sensors.values() else ""
        about = {"noise": name_of(self.noise), "config": self.settings()}
        return ReplayResult(results=results, drives=drives, sensors=sensors, title=title, **about)
