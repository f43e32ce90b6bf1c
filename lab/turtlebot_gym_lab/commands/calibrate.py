"""The subcommand ``calibrate``: fit a noise file to a recorded drive."""

from __future__ import annotations

import itertools
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from turtlebot_gym.files import SUFFIXES
from turtlebot_gym_agents.commands.console import FigureFile, ReportingOptions, print_tables, progress, save_figure
from turtlebot_gym_agents.outputs import OutputFile
from turtlebot_gym_lab.commands.recorded import RecordingOptions

if TYPE_CHECKING:
    from turtlebot_gym_lab.calibration import Calibration

PARTS = 3
"""Parts of a calibration: clocks and frames, the motion, the measured poses."""


@dataclass(frozen=True, kw_only=True)
class Calibrate(ReportingOptions, RecordingOptions):
    """Fit the noise model to a recorded drive, and write it as a file that --noise takes everywhere.

    With recorded truth, such as motion capture, the whole model can be fitted; without it, everything but the bias of x and y,
    from the innovations of measured poses. The report lists what the log does not determine, and the motion that would. Its
    last line says how the fit to one half of the log drives the other; a file that makes the wheels worse is not written.
    """

    log: tyro.conf.Positional[Path]
    """A bag of ROS 2 or ROS 1, laser arrays, or a table with named columns."""
    out: Annotated[Path | None, tyro.conf.arg(metavar="FILE.yaml"), OutputFile(SUFFIXES)] = None
    """Write the noise file here (FILE.yaml)."""
    truth: str = "auto"
    """auto uses the truth if the log has it, none fits to the innovations alone; otherwise a topic of the bag
    (TOPIC:PARENT.CHILD where it holds transforms, such as /tf:map.base_footprint), or a table with the columns t, x, y and
    perhaps theta."""
    odometry: str | None = None
    """Kind of odometry: "pose" measures the pose, "wheel" integrates the wheels; detected by default."""
    robot: str = "burger"
    """Robot whose speed limits a log must satisfy: a preset, such as burger, or a file of your own (FILE.yaml)."""
    integrator: str | None = None
    """euler or midpoint; by default the one that explains the motion better."""
    delay: float | None = None
    """Time by which the motion lags behind the recorded twist, s; estimated by default."""
    force: bool = False
    """Write the noise file even if it makes the wheels worse."""
    plot: FigureFile = None
    """Draw measured against fitted here."""

    def run(self) -> None:
        from turtlebot_gym import make_robot, write_parameters
        from turtlebot_gym_agents.provenance import provenance
        from turtlebot_gym_lab.calibration import calibrate
        from turtlebot_gym_lab.calibration.plausibility import check
        from turtlebot_gym_lab.calibration.windows import PARAMETERS
        from turtlebot_gym_lab.commands.calibration_report import calibration_figure, calibration_tables, comment
        from turtlebot_gym_lab.drives import read

        robot, refused = make_robot(self.robot), ""
        drive = read(self.log, **self.reading())
        check(drive, robot, str(self.log))
        parts = itertools.count(1)
        try:
            with progress(PARTS) as advance_to:
                fitted = calibrate(
                    drive,
                    kind=self.odometry,
                    use_truth=self.truth != "none",
                    integrator=self.integrator,
                    delay=self.delay,
                    progress=lambda part: advance_to(next(parts)),
                )
        except ValueError as error:
            raise ValueError(f"{self.log}: {error}") from error
        print_tables(*calibration_tables(fitted, title=self.log.name))
        wheels = {name: each for name, each in fitted.estimates.items() if name in PARAMETERS[:3]}
        lacks = [f" {name} is as usual: {each.remedy}." for name, each in wheels.items() if each.remedy]
        print(f"{fitted.verdict.text}{''.join(lacks)}")
        if self.out is not None and not (fitted.verdict.is_good or self.force):
            refused = f"{self.out} is not written: {fitted.verdict.text} Record another drive, or write it with --force."
        elif self.out is not None:
            write_parameters(fitted.noise, self.out, comment=comment(fitted, self.log.name, provenance()["version"]))
        self.report(_result_of(fitted))
        if self.plot is not None:
            save_figure(calibration_figure(fitted, title=self.log.name), self.plot)
        if refused:
            raise ValueError(refused)


def _result_of(fitted: Calibration) -> dict[str, object]:
    plain = {name: getattr(fitted, name) for name in ("kind", "has_truth", "integrator", "lengths", "remarks")}
    return plain | {
        "noise": asdict(fitted.noise),
        "likeliest": asdict(fitted.likeliest),
        "estimates": {
            name: asdict(estimate) | {"is_determined": estimate.is_determined} for name, estimate in fitted.estimates.items()
        },
        "unknown": fitted.unknown,
        "verdict": fitted.verdict._asdict() | {"held": [each._asdict() for each in fitted.verdict.held]},
        "delay": fitted.delay._asdict(),
        "truth_delay": fitted.truth_delay._asdict(),
        "frame": fitted.frame._asdict(),
    }
