"""Check a calibration by a map: whether its intervals hold the truth, and what it is worth in a real building.

Simulated robots tour drawn offices for five minutes with the LiDAR `lds01`, whose ranges are up to 5 % off, and with wheels of
which the localizer knows nothing: straight ahead, on the spot and in arcs, away from walls. Only parameters
that a drive determines count.

In the recorded building `aces` the first half of the log is calibrated, and the second half is filtered with the result, by the
wheels alone ("without corrections"), and corrected by poses some way apart: those of the localizer, and of single scans. The
NEES is that of predictions, before a pose corrects them. `make bench-calibration-by-map` runs both.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # a process for each core; threads within would wait for each other

import numpy as np
import tyro
from numpy.typing import NDArray

from buildings import chart, load
from calibration_intervals import judgement, summaries
from harness.beliefs import begun
from turtlebot_gym.calibration import Calibration
from turtlebot_gym.calibration.execution import at_axle
from turtlebot_gym.calibration.likelihood import tuning_of
from turtlebot_gym.calibration.poses import Scanned, nees_of
from turtlebot_gym.drives import Drive, Seen, known, read
from turtlebot_gym.estimation import ekf
from turtlebot_gym.estimation.consistency import nees
from turtlebot_gym.localization.tuning import ROBOT, matched
from turtlebot_gym.models.angles import TWO_PI
from turtlebot_gym.models.unicycle import INTEGRATORS
from turtlebot_gym.parameters import Noise, ProcessNoise
from turtlebot_gym.presets import WHEEL
from turtlebot_gym.rooms.lidar import LIDARS, SECTORS, SIGHT, beams_by
from turtlebot_gym.rooms.scan import Scan
from turtlebot_gym.systems import Options
from turtlebot_gym.values import Belief, Command, Covariance, Pose, State
from turtlebot_gym_agents.evaluation.by_map import by_map, calibrate_by_map
from turtlebot_gym_agents.evaluation.localize import KNOWN, Place
from turtlebot_gym_agents.provenance import settings_of, write_json

RESULTS = Path(__file__).with_suffix(".json")
LIDAR = LIDARS["lds01"]
HOLD = 15
"""Steps for which a motion is held."""
APARTS = (0.5, 1.0, 2.0, 4.0)
"""Ways between two poses by which the second half is filtered, m."""


def drawn(random: np.random.Generator) -> ProcessNoise:
    """Return wheels."""
    alphas = {f"alpha{k}": float(np.exp(random.uniform(np.log(0.002), np.log(0.012)))) for k in range(1, 5)}
    scale, turn_scale, veer = random.uniform((0.95, 0.8, -0.1), (1.05, 1.2, 0.1)).tolist()
    return ProcessNoise(**alphas, scale=scale, turn_scale=turn_scale, veer=veer)


def toured(seed: int, seconds: float = 300.0, world: str = "office") -> tuple[Drive, Place, ProcessNoise]:
    """Return a drive with scans and without truth, its place in the map, and the wheels that it was driven with."""
    random = np.random.default_rng([seed, 1])
    wheels = drawn(random)
    p, waypoints, plan, _ = Options(world=world, lidar="lds01", noise="wheel", localizer="match").setup()
    batch, observations = begun(1, seed, p._replace(noise=replace(WHEEL, process=wheels)), waypoints, plan=plan)
    start, beam, action = Pose(*batch.numbers("body.true_state")[0, :3].tolist()), 1.0 / (LIDAR.rate * LIDAR.beams), np.zeros(2)
    twists, odometry, scans = [np.zeros(2)], [batch.numbers("senses.odometry.pose")[0]], []
    for step in range(1, round(seconds / p.dt) + 1):
        action = motion(random, observations[0, -SECTORS - 1 : -1] * SIGHT, action, step % HOLD == 1)
        twists.append(batch.numbers("body.command")[0])
        observations, _ = batch.step(action.astype(np.float32)[None])
        odometry.append(batch.numbers("senses.odometry.pose")[0])
        turns = beams_by(step, LIDAR, p.dt) // LIDAR.beams
        if turns > beams_by(step - 1, LIDAR, p.dt) // LIDAR.beams:
            ranges = batch.scenes.lidar.ranges[0, 1, : LIDAR.beams].copy()
            scan = Scan(ranges, 0.0, TWO_PI / LIDAR.beams, LIDAR.range_min, LIDAR.range_max, beam)
            first = (turns - 1.0) / LIDAR.rate + beam
            scans.append(Seen(step, start, scan, first, Pose(LIDAR.x, LIDAR.y, LIDAR.yaw)))
    time = p.dt * np.arange(len(twists), dtype=np.float64)
    drive = Drive(time=time, twist=np.array(twists), odometry=np.array(odometry), scans=tuple(scans))
    return drive, Place(batch.scenes.memory.field[0], batch.scenes.memory.field_frame[0], matched(LIDAR), start), wheels


def motion(random: np.random.Generator, ranges: NDArray[Any], before: NDArray[np.float64], is_new: bool) -> NDArray[np.float64]:
    """Return an action: straight ahead, a turn on the spot or an arc, and a turn to the open side where the way is blocked."""
    is_blocked = min(ranges[:5].min(), ranges[-4:].min()) < 0.5
    if is_new:
        arc, turn = random.uniform(-0.25, 0.25), random.uniform(0.1, 0.35) * random.choice((-1.0, 1.0))
        ahead = random.uniform(0.5, 1.0)
        before = np.array(((ahead, 0.0), (0.0, turn), (ahead, arc))[random.integers(3)])
    if is_blocked and before[0] > 0.0:
        return np.array((0.0, 0.3 if ranges[3:12].mean() > ranges[-11:-2].mean() else -0.3))
    return before


def judged(seed: int, setting: str) -> dict[str, Any]:
    """Return of a drive for each parameter that it determines its error, and whether the interval holds the truth."""
    drive, place, wheels = toured(seed)
    fitted = calibrate_by_map(drive, place)
    determined = [name for name, estimate in fitted.estimates.items() if estimate.is_determined]
    true = {name: float(getattr(wheels, name, 0.0)) for name in determined}
    return {"seed": seed, "setting": setting, **judgement(fitted, true, "wheel", "euler")}


def halves(path: Path) -> dict[str, Any]:
    """Return what the first half of a building gives, and the NEES of the second against the localizer and against scans."""
    drive, map_of = read(path), chart(load(path), 0.05)
    drive = drive[int(np.flatnonzero(known(drive.truth))[0]) :]
    half, start = len(drive) // 2, Pose(*drive.truth[0].tolist())
    place = Place(map_of.field, map_of.frame, ROBOT, start, KNOWN)
    fitted = calibrate_by_map(drive[:half], place, kind="wheel")
    mapped = by_map(drive, place, fitted.likeliest.process)
    localizer = mapped.course.poses[mapped.where], mapped.course.covariances[mapped.where]
    marker = [fitted.estimates[name].value for name in ("marker_x", "marker_y", "marker_theta")]
    result: dict[str, Any] = {"verdict": fitted.verdict.text, "segment": fitted.segment, "remarks": fitted.remarks}
    result["estimates"] = {name: [estimate.low, estimate.value, estimate.high] for name, estimate in fitted.estimates.items()}
    for name, (truth, covariance) in {"localizer": localizer, "scans": (mapped.drive.truth, mapped.scanned.covariance)}.items():
        rest = at_axle(replace(drive, true_state=truth), *marker)[half:]
        result[name] = {
            f"{apart:g} m": nees_of(rest, Scanned(covariance[half:], 0.0), fitted.noise, fitted.integrator, apart)
            for apart in APARTS
        }
        result[name] = {
            key: {"median": np.median(errors), "mean": errors.mean(), "poses": len(errors)}
            for key, errors in result[name].items()
        }
    rest = at_axle(replace(drive, true_state=localizer[0]), *marker)[half:]
    result["without corrections"] = float(np.median(uncorrected(rest, localizer[1][half:], fitted)))
    return result


def uncorrected(drive: Drive, covariances: NDArray[np.float64], found: Calibration) -> NDArray[np.float64]:
    """Return the NEES of a filter that has only the wheels, from the first pose on, at each row against the truth."""
    tuning, rule = tuning_of(Noise(process=found.noise.process)), INTEGRATORS[found.integrator]
    x, y, theta = drive.truth[0].tolist()
    (xx, xy, xt), (_, yy, yt), (_, _, tt) = covariances[0].tolist()
    start = Covariance(xx, xy, xt, 0.0, 0.0, yy, yt, 0.0, 0.0, tt, 0.0, 0.0, 0.0, 0.0, 0.0)
    belief, beliefs = Belief(State(x, y, theta, 0.0, 0.0), start), []
    for row in range(len(drive) - 1):
        step = drive.time[max(row, 1)] - drive.time[max(row, 1) - 1]
        belief = ekf.predict(belief, Command(*drive.twist[row + 1].tolist()), tuning, float(step), rule)
        beliefs.append((*belief.mean[:3], *belief.covariance))
    numbers = np.array(beliefs)
    P = numbers[:, [[3, 4, 5], [4, 8, 9], [5, 9, 12]]]
    return nees(numbers[:, :3], drive.truth[:-1], P + covariances[:-1], components=3)


@dataclass(frozen=True, kw_only=True)
class Config:
    """Count how often intervals by a map contain the truth, and filter a real building."""

    drives: int = 200
    """Number of drives."""
    seed: int = 0
    """Seed of the first drive."""
    processes: int = 2
    """Number of processes."""
    data: Path = Path("../shared/data")
    """Folder with the recordings, in `carmen`."""
    kept: Path = Path("out/calibration_by_map.jsonl")
    """File for finished drives; an interrupted run resumes."""
    results: Path | None = RESULTS
    """File for the results."""


def main() -> None:
    """Judge all drives, print, and write the results."""
    config = tyro.cli(Config, description=__doc__)
    coverage = summaries(judged, ("by map",), config)
    building = halves(config.data / "carmen" / "aces.npz")
    print(building)
    if config.results is not None:
        write_json(config.results, {"coverage": coverage, "aces": building}, config=settings_of(config))


if __name__ == "__main__":
    main()
