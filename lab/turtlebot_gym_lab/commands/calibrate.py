"""The command ``calibrate``: fit a noise file to a recorded drive."""

from __future__ import annotations

import itertools
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from turtlebot_gym.files import SUFFIXES
from turtlebot_gym_agents.commands.console import progress, save_figure
from turtlebot_gym_agents.outputs import FIGURE, JSON, require_outputs
from turtlebot_gym_lab.commands.recorded import TOPICS, reading
from turtlebot_gym_lab.drives.topics import Topics

if TYPE_CHECKING:
    from turtlebot_gym_lab.calibration import Calibration

PARTS = 3
"""Parts of a calibration: clocks and frames, the motion, the measured poses."""


def calibrate(
    log: tyro.conf.Positional[Path],
    *,
    truth: str = "auto",
    columns: tuple[str, ...] = (),
    topics: Topics = TOPICS,
    odometry: str | None = None,
    robot: str = "burger",
    integrator: str | None = None,
    delay: float | None = None,
    out: Path | None = None,
    json: Path | None = None,
    plot: Path | None = None,
    force: bool = False,
) -> None:
    """Fit the noise model to a recorded drive, and write it as a file that --noise takes everywhere.

    With recorded truth, such as motion capture, the whole model can be fitted; without it, everything but the bias of x and y,
    from the innovations of measured poses. The report lists what the log does not determine, and the motion that would. Its
    last line says how the fit to one half of the log drives the other; a file that makes the wheels worse is not written.

    Args:
        log: A bag of ROS 2 or ROS 1, laser arrays, or a table with named columns.
        truth: auto uses the truth if the log has it, none fits to the innovations alone; otherwise a topic of the bag
            (TOPIC:PARENT.CHILD where it holds transforms, such as /tf:map.base_footprint), or a table with the columns t, x, y
            and perhaps theta.
        columns: Names of a table's columns, as QUANTITY=COLUMN: time, v, omega, x, y, theta, true_x, true_y, true_theta.
        topics: Topics of a bag.
        odometry: Kind of odometry: "pose" measures the pose, "wheel" integrates the wheels; detected by default.
        robot: Robot whose speed limits a log must satisfy: a preset, such as burger, or a file of your own (FILE.yaml).
        integrator: euler or midpoint; by default the one that explains the motion better.
        delay: Time by which the motion lags behind the recorded twist, s; estimated by default.
        out: Write the noise file here (FILE.yaml).
        json: Write configuration and results here.
        plot: Draw measured against fitted here.
        force: Write the noise file even if it makes the wheels worse; and overwrite files that exist.
    """
    config = {name: value for name, value in locals().items() if name != "force"}
    outputs = ("--out", out, SUFFIXES), ("--json", json, JSON), ("--plot", plot, FIGURE)
    require_outputs(outputs, inputs=[log, truth, robot], force=force)
    from turtlebot_gym import make_robot, write_parameters
    from turtlebot_gym_agents.front.results import text_of
    from turtlebot_gym_agents.provenance import provenance, write_json
    from turtlebot_gym_lab import calibration
    from turtlebot_gym_lab.calibration.plausibility import check
    from turtlebot_gym_lab.calibration.windows import PARAMETERS
    from turtlebot_gym_lab.commands.calibration_report import calibration_figure, calibration_tables, comment
    from turtlebot_gym_lab.drives import read

    drive, parts = read(log, **reading(truth, columns, topics)), itertools.count(1)
    check(drive, make_robot(robot), str(log))
    given = {"kind": odometry, "use_truth": truth != "none", "integrator": integrator, "delay": delay}
    try:
        with progress(PARTS) as advance_to:
            fitted = calibration.calibrate(drive, **given, progress=lambda part: advance_to(next(parts)))
    except ValueError as error:
        raise ValueError(f"{log}: {error}") from error
    print(text_of(calibration_tables(fitted, title=log.name)))
    wheels = {name: each for name, each in fitted.estimates.items() if name in PARAMETERS[:3]}
    lacks = [f" {name} is as usual: {each.remedy}." for name, each in wheels.items() if each.remedy]
    print(f"{fitted.verdict.text}{''.join(lacks)}")
    if json is not None:
        write_json(json, _result_of(fitted), config=config)
    if plot is not None:
        save_figure(calibration_figure(fitted, title=log.name), plot)
    if out is not None and not (fitted.verdict.is_good or force):
        raise ValueError(f"{out} is not written: {fitted.verdict.text} Record another drive, or write it with --force.")
    if out is not None:
        write_parameters(fitted.noise, out, comment=comment(fitted, log.name, provenance()["version"]))


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
