"""The command ``replay``: run a filter over recordings."""

from __future__ import annotations

import itertools
import math
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tyro

from turtlebot_gym.config import as_int, choose
from turtlebot_gym_agents.commands.console import progress, save_figure
from turtlebot_gym_agents.flags import Text
from turtlebot_gym_agents.outputs import FIGURE, JSON, require_outputs
from turtlebot_gym_lab.commands.recorded import TOPICS, reading
from turtlebot_gym_lab.drives.topics import Topics

if TYPE_CHECKING:
    from turtlebot_gym.drive import Drive

GENERATED = "generated"
"""Where measured poses come from if they are not recorded."""


def replay(
    *files: tyro.conf.Positional[Path],
    filter: Text = "matched",
    measured: str = "auto",
    noise: Text = "documented",
    integrator: str = "midpoint",
    seed: int = 0,
    seeds: int | None = None,
    rate: float | None = None,
    truth: str = "auto",
    columns: tuple[str, ...] = (),
    topics: Topics = TOPICS,
    json: Path | None = None,
    plot: Path | None = None,
    force: bool = False,
) -> Any:
    """Run the filter over recorded drives with known truth.

    The filter predicts with the recorded wheel odometry, and is corrected by the recorded poses of a sensor, such as AMCL's; if
    there are none, by poses generated from the true ones with a preset's noise.

    Args:
        files: Recordings with truth: bags, laser arrays, or tables with named columns.
        filter: Filter: matched, calibrated, tutorial, gated, or one of your own (MODULE:NAME).
        measured: Measured poses: recorded, generated (from the true ones), or auto: recorded if there are any, such as those on
            /amcl_pose, /pose or /pose_fix of a bag (or another topic by --topics.fix), and generated otherwise.
        noise: Noise of the measured poses: clean, tutorial, documented, wheel, rough, or a file of your own (FILE.yaml); of
            recorded ones, what the filter assumes.
        integrator: Integrator of the motion: euler or midpoint.
        seed: The first seed of the noise of generated poses.
        seeds: Number of seeds of generated poses to average over; 20 by default.
        rate: Measured poses per second, at most; by default 10 of generated ones, and all recorded ones.
        truth: auto uses the truth if a recording has it; otherwise a topic of the bag (TOPIC:PARENT.CHILD where it holds
            transforms, such as /tf:map.base_footprint), or a table with the columns t, x, y and perhaps theta.
        columns: Names of a table's columns, as QUANTITY=COLUMN: time, v, omega, x, y, theta, true_x, true_y, true_theta.
        topics: Topics of a bag.
        json: Write configuration and results here.
        plot: Draw the first seed here; for several files, one figure each, with the file's name appended.
        force: Overwrite files that exist.

    Returns:
        A `ReplayResult`: the errors and the NEES of each recording.
    """
    config = {name: value for name, value in locals().items() if name != "force"}
    from turtlebot_gym_agents.front.results import name_of
    from turtlebot_gym_lab.commands.replayed import ReplayResult
    from turtlebot_gym_lab.evaluation.replay import dead_reckoning, replay_figure, replay_seeds

    paths = list(dict.fromkeys(map(Path, files)))
    pictures = pictures_of(plot, paths)
    outputs = [("--json", json, JSON), *(("--plot", picture, FIGURE) for picture in pictures)]
    require_outputs(outputs, inputs=[*paths, truth, noise], force=force)
    if not paths:
        raise ValueError("At least one FILE must be given.")
    choose("measured", measured, dict.fromkeys(("auto", "recorded", GENERATED)))
    number = as_int("seeds", 20 if seeds is None else seeds, 1)
    given: dict[str, Any] = {"columns": columns, "topics": topics, "truth": truth}
    drives, sensors = {}, {}
    with progress(len(paths)) as advance_to:
        for at, path in enumerate(paths, start=1):
            drives[path], sensors[path] = _read(path, measured, **given)
            advance_to(at)
    if (seed or seeds is not None) and GENERATED not in sensors.values():
        raise ValueError("seeds are of generated poses, and the poses are recorded: leave them out, or --measured generated.")
    for remark in (remark for drive in drives.values() for remark in drive.remarks):
        print(remark, file=sys.stderr)
    results, count = {}, itertools.count(1)
    drawn = {path: range(seed, seed + (number if sensors[path] == GENERATED else 1)) for path in drives}
    with progress(sum(map(len, drawn.values()))) as advance_to:
        for path, drive in drives.items():
            recorded = sensors[path] != GENERATED
            options = {"noise": noise, "filter": filter, "integrator": integrator, "recorded": recorded}
            options["rate"] = rate if rate is not None else math.inf if recorded else 10.0
            results[path] = replay_seeds(drive, drawn[path], progress=lambda: advance_to(next(count)), **options)
    title = f"noise {name_of(noise)}, filter {name_of(filter)}"
    title += f", mean of {number} seeds" if GENERATED in sensors.values() else ""
    result = ReplayResult(results=results, drives=drives, sensors=sensors, title=title, config=config)
    if json is not None:
        result.to_json(json)
    for path, picture in zip(paths, pictures, strict=False):
        heading = f"{path.name}, noise {name_of(noise)}, seed {seed}"
        save_figure(replay_figure(results[path].trajectory, dead_reckoning(drives[path]), title=heading), picture)
    return result


def _read(path: Path, measured: str, **given: Any) -> tuple[Drive, str]:
    """Return a drive to be replayed, and where its measured poses come from: a topic, "recorded" or "generated"."""
    from turtlebot_gym_lab.calibration.calibrate import detect_kind
    from turtlebot_gym_lab.calibration.estimates import POSE
    from turtlebot_gym_lab.drives import read
    from turtlebot_gym_lab.drives.reading import pose_sensors
    from turtlebot_gym_lab.evaluation.replay import replayable

    topics: Topics = given["topics"]
    if measured == GENERATED:
        if topics.fix:
            raise ValueError("--topics.fix names recorded poses, and --measured generated takes none: leave one of them out.")
        return replayable(read(path, **reading(**given))), GENERATED
    found = pose_sensors(path, truth=given["truth"])
    fix = topics.fix or (found[0] if len(found) == 1 else "")
    drive = read(path, **reading(given["truth"], given["columns"], replace(topics, fix=fix)))
    if len(found) > 1 and not topics.fix:
        remark = f"{path}: {', '.join(found)} state poses: --topics.fix says which of them corrects the filter"
        drive = replace(drive, remarks=(*drive.remarks, remark))
    if fix or measured == "recorded" or detect_kind(drive) == POSE:
        return replayable(drive, recorded=True), fix or "recorded"
    return replayable(drive), GENERATED


def pictures_of(plot: Path | None, paths: Sequence[Path]) -> list[Path]:
    """Return the figures of drives: one each, with the drive's name if there are several."""
    if plot is None or len(paths) < 2:
        return [] if plot is None else [plot]
    stems = [path.stem for path in paths]
    numbers = [f"-{at}" if stems.count(stem) > 1 else "" for at, stem in enumerate(stems)]
    return [plot.with_stem(f"{plot.stem}-{stem}{at}") for stem, at in zip(stems, numbers, strict=True)]
