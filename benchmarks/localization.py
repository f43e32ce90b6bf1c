"""Measure the localizer in drawn rooms: its error and honesty, wrong maps and wheels, blocked robots, and the cost of a step.

Robots wander for minutes with wheel odometry and the LiDAR `lds01`. The rooms are held out: constants were chosen on rooms of
other seeds, from 13,000, 20,000, 21,000, 50,000 and 52,000.
`make bench-localization` runs it and writes `localization.json`; with `--only speed` it times steps alone, into the same file.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from harness.beliefs import Errors, begun, errors_of
from harness.study import Study, run
from harness.turns import timed
from turtlebot_gym.compiled.batch import Batch
from turtlebot_gym.localization.tuning import matched
from turtlebot_gym.presets import WHEEL
from turtlebot_gym.presets import matched as matched_filter
from turtlebot_gym.rooms.lidar import LIDARS, SECTORS, SIGHT
from turtlebot_gym.rooms.rules import ROOMS
from turtlebot_gym.systems import Options
from turtlebot_gym_agents.evaluation import metrics
from turtlebot_gym_agents.provenance import provenance

DT = 0.1
WORLDS = ("dense", "office", "corridor")
MATCHED = matched(LIDARS["lds01"])
WRONG_MAP = replace(MATCHED, grain=0.04, bias=0.03, turn_bias=0.01)
"""What a user says of a map whose walls may be off by 5 cm."""


def wheels(**changes: float) -> Any:
    """Return the noise of the wheels with other numbers, of which the filter is not told."""
    return replace(WHEEL, process=replace(WHEEL.process, **changes))


_ALPHAS = ("alpha1", "alpha2", "alpha3", "alpha4")
THRICE = wheels(**{name: 9.0 * getattr(WHEEL.process, name) for name in _ALPHAS})
CASES: dict[str, dict[str, Any]] = {
    "wheels only": {"localizer": None},
    "localizer": {},
    "60 beams": {"localizer": replace(MATCHED, beams=60)},
    "without the scale of the ranges": {"localizer": replace(MATCHED, scale=0.0)},
    "half of the obstacles not on the map": {"rules": {"unmapped": 0.5}},
    "30 % more obstacles on the map than in the room": {"rules": {"vanished": 0.3}},
    "map off by 5 cm, told": {"rules": {"map_error": 0.05}, "localizer": WRONG_MAP},
    "map off by 5 cm": {"rules": {"map_error": 0.05}},
    "bursts of slip": {"noise": wheels(slip=0.5, slip_start=0.01, slip_end=0.2)},
    "wheels 5 % too large": {"noise": wheels(scale=1.05)},
    "wheels that turn by 20 % more": {"noise": wheels(turn_scale=1.2)},
    "three times the noise": {"noise": THRICE},
    "three times the noise, told": {"noise": THRICE, "filter": matched_filter(THRICE)},
}
"""What differs from the localizer in a right map with the wheels that its filter assumes."""


@dataclass(frozen=True, kw_only=True)
class Config(Study):
    """Drive with a localizer."""

    runs: int = 32
    """Number of drives in each case."""
    seconds: float = 300.0
    """Length of a drive, s."""
    seed: int = 860_000
    """Seed of the first drive."""
    only: Literal["", "cases", "needless", "blocked", "unknown", "kidnapped", "speed"] = ""
    """Measure this part alone, and leave the others in the file as they are: steps are timed on a quiet machine."""


class Wander:
    """Drive forwards where there is room, and turn to the side with more of it."""

    def __init__(self, runs: int, seed: int) -> None:
        self._rng, self._steps = np.random.default_rng(seed), 0
        self._turn, self._side = np.zeros(runs), np.ones(runs)

    def __call__(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        ranges = observations[:, -SECTORS - 1 : -1] * SIGHT
        front = np.minimum(ranges[:, :5].min(1), ranges[:, -4:].min(1))
        left, right = ranges[:, 3:12].mean(1), ranges[:, -11:-2].mean(1)
        if self._steps % 20 == 0:
            self._turn = self._rng.uniform(-0.5, 0.5, len(front))
        self._side = np.where(front > 0.7, np.where(left > right, 1.0, -1.0), self._side)
        turn = np.where(front < 0.45, 0.6 * self._side, 0.6 * self._turn + 0.3 * (left - right) / SIGHT)
        self._steps += 1
        return np.column_stack([np.clip(2.0 * (front - 0.25), 0.0, 1.0), turn]).astype(np.float32)


def make_batch(world: str, number: int, case: Mapping[str, Any], seed: int) -> tuple[Batch, NDArray[np.float32]]:
    """Return environments at the start of their episodes, and their observations."""
    given = {"noise": "wheel", "localizer": MATCHED, "filter": matched_filter(WHEEL)} | dict(case)
    rules = replace(ROOMS[world], **given.pop("rules", {}))
    p, waypoints, _, _ = Options(world=rules, lidar="lds01", **given).setup()
    return begun(number, seed, p, waypoints)


def drive(
    batch: Batch,
    observations: NDArray[np.float32],
    seconds: float,
    seed: int,
    at: Callable[[Batch, int], None] = lambda b, s: None,
    after: Callable[[Batch, int], None] = lambda b, s: None,
) -> Errors:
    """Wander, and return the errors after each step.

    Args:
        batch: The environments.
        observations: Their present observations.
        seconds: How long, s.
        seed: Of the random turns.
        at: Called before each step with the batch and the step's number.
        after: Called after it.
    """
    policy, errors = Wander(batch.num_envs, seed), []
    for step in range(round(seconds / DT)):
        at(batch, step)
        observations, _ = batch.step(policy(observations))
        errors.append(errors_of(batch))
        after(batch, step)
    return Errors(*map(np.array, zip(*errors, strict=True)))


def right(position: NDArray[np.float64], heading: NDArray[np.float64], after: float) -> Any:
    """Return the share of robots within 0.3 m and 0.3 rad of the truth at a time, s."""
    at = round(after / DT) - 1
    return metrics.share((position[at] < 0.3) & (heading[at] < 0.3))


def blocked(world: str, config: Config) -> dict[str, Any]:
    """Return the share of robots that are right some seconds after their wheels turned in vain for 5 s."""
    batch, seen = make_batch(world, 3 * config.runs, {}, config.seed)
    free = batch.parameters
    stuck = free._replace(noise=wheels(scale=1e-9, **dict.fromkeys(_ALPHAS, 0.0)))

    def block(batch: Batch, step: int) -> None:
        if step in (100, 150):
            batch.set_parameters(stuck if step == 100 else free)

    position, heading, _ = drive(batch, seen, 25.0, config.seed, block)
    return {f"after {after:g} s": right(position, heading, 15.0 + after) for after in (0.1, 2.0, 5.0)}


class Sure:
    """Where robots are sure of their place: there is one hypothesis, and the last scan leaves no doubt of it."""

    def __init__(self, seconds: float, runs: int) -> None:
        self.rows, self.searches, self.fits = np.zeros((round(seconds / DT), runs), np.bool_), 0, []
        self._looked = np.zeros(runs, np.bool_)

    def __call__(self, batch: Batch, step: int) -> None:
        misfits, fits = batch.numbers("estimate.misfits"), batch.numbers("estimate.fits")
        self.rows[step] = (misfits <= 0.0) & (fits >= 0.7 * MATCHED.doubt)
        self.fits.append(fits.mean())
        looks = misfits >= MATCHED.patience
        self.searches += int((looks & ~self._looked).sum())
        self._looked = looks


def placed(position: Any, heading: Any, sure: Sure, since: float, times: tuple[float, ...]) -> dict[str, Any]:
    """Return the share of robots that are right some seconds after a time, of those that are sure, and sure but wrong."""
    wrong, first = (position >= 0.3) | (heading >= 0.3), round(since / DT)
    at_end = sure.rows[first + round(times[-1] / DT) - 1]
    return {
        **{f"after {after:g} s": right(position, heading, since + after) for after in times},
        **{
            f"sure and wrong after {after:g} s": metrics.share((wrong & sure.rows)[first + round(after / DT) - 1])
            for after in times
        },
        "sure at the end": metrics.share(at_end),
        "sure and wrong": float((wrong & sure.rows)[first:].mean()),
    }


def unknown(world: str, config: Config) -> dict[str, Any]:
    """Return the share of robots that are right some seconds after an unknown start."""
    number, seconds = 6 * config.runs, 20.0
    sure = Sure(seconds, number)
    batch, seen = make_batch(world, number, {"start": "unknown"}, config.seed)
    position, heading, _ = drive(batch, seen, seconds, config.seed, after=sure)
    return placed(position, heading, sure, 0.0, (1.0, 5.0, 10.0, 20.0))


def kidnapped(world: str, config: Config) -> dict[str, Any]:
    """Return the share of robots that are right some seconds after they were carried to their goal, turned anyhow."""
    number, seconds, random = 6 * config.runs, 50.0, np.random.default_rng(config.seed)
    sure = Sure(seconds, number)
    batch, seen = make_batch(world, number, {}, config.seed)

    def carry(batch: Batch, step: int) -> None:
        if step == 300:
            state = batch.numbers("body.true_state")
            state[:, :2], state[:, 2] = batch.numbers("course.reference")[:, :2], random.uniform(-np.pi, np.pi, number)
            batch.put("body.true_state", state)
            batch.put("room.pose", state[:, :3])

    position, heading, _ = drive(batch, seen, seconds, config.seed, carry, sure)
    return placed(position, heading, sure, 30.0, (2.0, 5.0, 20.0))


def speed() -> dict[str, Any]:
    """Return steps per second without and with a localizer, each the best of some turns, and the ratio of processor times."""
    results: dict[str, Any] = {}
    for number in (512, 4096):
        batches = {name: make_batch("office", number, CASES[name], 0)[0] for name in ("wheels only", "localizer")}
        actions = np.random.default_rng(0).uniform([-0.1, -0.5], [0.3, 0.5], (number, 2)).astype(np.float32)
        wall, cpu, calls = dict.fromkeys(batches, np.inf), dict.fromkeys(batches, np.inf), max(20_000 // number, 4)
        for _ in range(8):
            for name, batch in batches.items():
                batch.step(actions)
                spent = timed(lambda k, batch=batch, actions=actions: batch.step(actions))(calls)
                wall[name] = min(wall[name], spent.wall / (number * calls))
                cpu[name] = min(cpu[name], spent.cpu / (number * calls))
        results[str(number)] = {
            "steps_per_second": {name: 1.0 / value for name, value in wall.items()},
            "cpu_microseconds": {name: 1e6 * value for name, value in cpu.items()},
            "ratio": cpu["localizer"] / cpu["wheels only"],
        }
    return results


def cases(world: str, config: Config) -> dict[str, Any]:
    """Return errors, honesty and searches in each of the `CASES`."""
    results = {}
    for name, case in CASES.items():
        sure, localized = Sure(config.seconds, config.runs), case.get("localizer", MATCHED) is not None
        position, heading, consistent = drive(
            *make_batch(world, config.runs, case, config.seed),
            config.seconds,
            config.seed,
            after=sure if localized else lambda b, s: None,
        )
        results[name] = {
            "position": metrics.mean(np.sqrt((position**2).mean(0))),
            "heading": metrics.mean(np.sqrt((heading**2).mean(0))),
            "position_rms": float(np.sqrt((position**2).mean())), "heading_rms": float(np.sqrt((heading**2).mean())),
            "nees": metrics.mean(consistent[20:].mean(0)), "most": float(position.max()),
            "lost": metrics.mean((position > 0.5).mean(0)), "searches": sure.searches,
            "fits": float(np.mean(sure.fits)) if localized else None,
        }  # fmt: skip
    return results


def needless(world: str, config: Config) -> dict[str, Any]:
    """Return how often robots that know where they are search the whole map, and in how many hours."""
    number = 120
    sure = Sure(config.seconds, number)
    drive(*make_batch(world, number, {}, config.seed), config.seconds, config.seed, after=sure)
    return {"hours": number * config.seconds / 3600.0, "searches": sure.searches}


PARTS = {"cases": cases, "needless": needless, "blocked": blocked, "unknown": unknown, "kidnapped": kidnapped}
"""What is measured in each world."""


def tables_of(results: Mapping[str, Any]) -> list[Table]:
    """Return results as tables."""
    errors = Table(
        "world", "case", "position, cm", "heading, mrad", "NEES (3)", "most, cm", "searches", title="root mean squares"
    )
    places = Table("what", "world", "when", "", title="within 0.3 m and 0.3 rad of the truth")
    costs = Table("environments", "steps/s without", "with", "ratio of processor time")
    for world, of_cases in results.get("cases", {}).items():
        for name, x in of_cases.items():
            row = 100.0 * x["position_rms"], 1e3 * x["heading_rms"], x["nees"].value, 100.0 * x["most"]
            errors.add_row(world, name, *(f"{value:.2f}" for value in row), str(x["searches"]))
    for what in results.keys() & (PARTS.keys() - {"cases"}):
        for world, shares in results[what].items():
            for name, share in shares.items():
                places.add_row(what, world, name, f"{getattr(share, 'value', share):.4g}")
    for number, cost in results.get("speed", {}).items():
        per_second = cost["steps_per_second"]
        costs.add_row(number, f"{per_second['wheels only']:,.0f}", f"{per_second['localizer']:,.0f}", f"{cost['ratio']:.2f}")
    return [table for table in (errors, places, costs) if table.row_count]


def measure(config: Config) -> tuple[dict[str, Any], list[Table]]:
    """Return the results of all parts, or of one beside the file's others, and their tables."""
    results: dict[str, Any] = {}
    for name in [config.only] if config.only else (*PARTS, "speed"):
        results[name] = speed() if name == "speed" else {world: PARTS[name](world, config) for world in WORLDS}
    tables = tables_of(results)
    if config.only and config.json is not None:  # options and origin stay those of the file
        kept = json.loads(config.json.read_text(encoding="utf-8"))
        results = kept | results | {"again": kept.get("again", {}) | {config.only: provenance()}}
    return results, tables


if __name__ == "__main__":
    run(Config, measure, beside=__file__)
