"""What carries over from the unicycle to a second physics: every policy on open ground, and every filter, on three floors.

The same seeds are driven with the unicycle, with a Burger in MuJoCo on a floor that grips, and on a slippery one. Policies are
compared in pairs with themselves on the unicycle; all filters see the same drives, whose commands do not depend on an estimate.

`make study-transfer` runs it and writes `transfer.json`. What was driven is kept under `out/`, by commit, so an interrupted run
resumes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import tyro
from numpy.typing import NDArray
from rich.table import Table
from scenarios import NAV, POSE, SQUARE, kept, results_folder, run_all, slug, trained

from turtlebot_gym import FilterTuning, make_filter, make_noise
from turtlebot_gym.estimation.consistency import difference, nees
from turtlebot_gym.estimation.filters import matrix
from turtlebot_gym.estimation.interface import filter_of
from turtlebot_gym.models.angles import sincos
from turtlebot_gym.models.odometry import increment
from turtlebot_gym.models.unicycle import INTEGRATORS, command_of
from turtlebot_gym.parameters import ProcessNoise
from turtlebot_gym.plants import make_plant
from turtlebot_gym.systems import Episode, make_parameters
from turtlebot_gym.tasks import make_task
from turtlebot_gym.values import STOP, Pose, Senses
from turtlebot_gym_agents.commands.console import print_tables
from turtlebot_gym_agents.evaluation import metrics
from turtlebot_gym_agents.evaluation.estimation import FORWARD, HOLD, TURN
from turtlebot_gym_agents.evaluation.evaluate import Evaluation, evaluate
from turtlebot_gym_agents.evaluation.metrics import Interval
from turtlebot_gym_agents.provenance import settings_of, write_json

RESULTS = Path(__file__).with_suffix(".json")
UNICYCLE, GRIP, SLIPPERY = "unicycle", "grip", "slippery"
FLOORS = {UNICYCLE: make_plant(), GRIP: make_plant("mujoco"), SLIPPERY: make_plant("mujoco", friction=0.5, caster_friction=0.3)}
"""Plants by name."""
POLICIES = {
    NAV: ("proportional", "bearing", "corner", "polar", "rotate-drive-rotate", "ppo-nav"),
    POSE: ("polar", "rotate-drive-rotate", "ppo-pose"),
    SQUARE: ("bearing", "corner", "ppo-square"),
}
"""Who drives each task."""
NOISES = ("tutorial", "documented", "wheel")
CASES = [
    (env, policy, noise)
    for env, names in POLICIES.items()
    for policy in names
    for noise in NOISES
    if (env, noise) != (SQUARE, "documented")
]
"""Square drives are long, and documented tells little that is new."""
MEASURED = ("tutorial", "documented")
"""Those under which there is something to filter."""
SPEED_ERRORS = (0.02, 0.15)
"""Greatest errors of the executed speed in trainings: that of the policies that come with the package, and one that covers what
a slippery floor costs."""
BY_NAME = ("matched", "gated", "mixture", "slip", "scale")
"""Filters by name that know the noise in force."""
CREEP = 0.3
"""Standard deviation of the executed twist, as a share of it, in the noise model of filters that are told of a slippery floor.
Chosen: more than the tenth that is lost on average, since what is lost in one step is lost in the next ones too."""
SLIPS = ProcessNoise(slip=0.1, slip_start=0.02, slip_end=0.02)
"""What the filter `slip` is told of it: a tenth is lost, half of the time, for 5 s at once."""


@dataclass(frozen=True, kw_only=True)
class Config:
    """Drive them all."""

    episodes: int = 50
    """Of each policy on each floor."""
    drives: int = 30
    """Of all filters on each floor."""
    trainings: int = 2
    """On Nav, of each range of the speed's error."""
    seconds: float = 60.0
    """Length of such a drive."""
    first_seed: int = 2_000_000
    """Of policies and filters."""
    processes: int = 1
    """Processes at once, each on one core."""
    json: Path = RESULTS
    """Where the results go."""


class Drive(NamedTuple):
    """A drive of T steps, and what its odometry said."""

    truth: NDArray[np.float64]
    """Shape (T + 1, 5)."""
    senses: list[Senses]
    """T + 1 of them."""


def driven(env: str, policy: str, noise: str, floor: str, config: Config) -> Evaluation:
    """Drive a policy."""
    options = {"noise": noise, "plant": FLOORS[floor] or "unicycle"}
    return evaluate(policy, env=env, episodes=config.episodes, seed=config.first_seed, **options)


def record(noise: str, floor: str, config: Config) -> list[Drive]:
    """Drive with commands that are drawn and held for a second, as `turtlebot-gym estimate` does."""
    task, waypoints = make_task("square", switch="time")
    p = make_parameters(task, noise=noise, plant=FLOORS[floor] or "unicycle")
    steps, random, drives = round(config.seconds / p.dt), np.random.default_rng(config.first_seed), []
    for number in range(config.drives):
        episode = Episode(p, waypoints, seed=config.first_seed + number)
        command, truth, senses = STOP, [episode.world.body.true_state], [episode.world.senses]
        for at in range(steps):
            if at % HOLD == 0:
                command = command_of(random.uniform(*FORWARD), random.uniform(*TURN), p.robot)
            episode.step(command)
            truth.append(episode.world.body.true_state)
            senses.append(episode.world.senses)
        drives.append(Drive(np.array(truth), senses))
    return drives


def tunings(noise: str) -> dict[str, FilterTuning]:
    """Return the filters by name, and some that are told more than the preset knows."""
    model = make_noise(noise)
    creeping = replace(model, process=replace(model.process, alpha1=CREEP**2, alpha4=CREEP**2))
    return {
        **{name: make_filter(name, model) for name in BY_NAME},
        "matched, told of creep": make_filter("matched", creeping),
        "scale, told of creep": make_filter("scale", creeping),
        "slip, told of slip": make_filter("slip", replace(model, process=SLIPS)),
    }


def filtered(drives: Sequence[Drive], tuning: FilterTuning, dt: float = 0.1) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Run a filter over drives; return errors of the pose, shape (n, T + 1, 3), and its NEES, shape (n, T + 1)."""
    begin, step = filter_of(tuning)
    errors, consistency = [], []
    for truth, senses in drives:
        estimate = begin(senses[0].odometry, tuning)
        beliefs = [estimate.belief]
        for before, now in pairwise(senses):
            estimate = step(estimate, before, now, tuning, dt, INTEGRATORS["euler"])
            beliefs.append(estimate.belief)
        means = np.array([belief.mean for belief in beliefs])
        covariances = np.array([matrix(belief.covariance) for belief in beliefs])
        errors.append(difference(means, truth)[:, :3])
        consistency.append(nees(means, truth, covariances, components=3))
    return np.array(errors), np.array(consistency)


def filter_rows(folder: Path, noise: str, floor: str, config: Config) -> list[dict[str, Any]]:
    """Return how each filter did on the same drives."""
    rows: list[dict[str, Any]] = []
    drives = recorded(folder, noise, floor, config)
    reference = np.zeros(len(drives))
    for name, tuning in tunings(noise).items():
        errors, consistency = filtered(drives, tuning)
        position, heading = (errors[..., :2] ** 2).sum(axis=2).mean(axis=1), (errors[..., 2] ** 2).mean(axis=1)
        reference = position if name == "matched" else reference
        told = {"noise": noise, "floor": floor, "filter": name, "position": root(position), "heading": root(heading)}
        rows.append({**told, "over_matched": ratio(position, reference), "nees": metrics.mean(consistency.mean(axis=1))})
    return rows


def root(squared: NDArray[np.float64]) -> Interval:
    """Return the root of a mean square."""
    return Interval(*(float(np.sqrt(max(number, 0.0))) for number in metrics.mean(squared)))


def ratio(one: NDArray[np.float64], other: NDArray[np.float64], samples: int = 2000) -> Interval:
    """Return the ratio of two roots of mean squares of the same drives, with a bootstrap's interval over the drives."""
    rows = np.random.default_rng(0).integers(len(one), size=(samples, len(one)))
    low, high = np.quantile(np.sqrt(one[rows].mean(axis=1) / other[rows].mean(axis=1)), [0.025, 0.975])
    return Interval(float(np.sqrt(one.mean() / other.mean())), float(low), float(high))


def drift(floor: str, drives: Sequence[Drive]) -> dict[str, Any]:
    """Return by how much odometry is off after each metre of the way, seen from where the metre began; m, rad."""
    found = []
    for truth, senses in drives:
        way = np.concatenate([[0.0], np.hypot(*np.diff(truth[:, :2], axis=0).T).cumsum()])
        ends = np.searchsorted(way, np.arange(0.0, way[-1], 1.0))
        for begin, end in pairwise(ends.tolist()):
            start, before, after = Pose(*truth[begin, :3].tolist()), senses[begin].odometry, senses[end].odometry
            told = increment(start, before, after, sincos(start.theta - before.theta))
            off = difference(np.array(told), truth[end, :3])
            found.append((math.hypot(off[0], off[1]), abs(off[2])))
    position, heading = np.array(found).T
    return {"floor": floor, "metres": len(found), "position": root(position**2), "heading": root(heading**2)}


def policy_row(env: str, policy: str, noise: str, floor: str, one: Evaluation, unicycle: Evaluation) -> dict[str, Any]:
    """Return how a policy did on a floor, and against itself on the unicycle, in pairs."""
    e, u = one.episodes, unicycle.episodes
    both = e.success & u.success
    times = {"n": int(both.sum()), "ratio": float(e.time[both].sum() / u.time[both].sum()) if both.any() else None}
    return {
        "env": env, "policy": policy, "noise": noise, "floor": floor, "succeeded": int(e.success.sum()), "of": len(e.success),
        "success": metrics.share(e.success), "success_difference": metrics.paired_share_difference(e.success, u.success),
        "time_to_goal": metrics.mean(e.time[e.success]), "where_both_succeed": times,
        "time_difference": metrics.mean((e.time - u.time)[both]), "position": metrics.mean(e.estimate.position_mean),
    }  # fmt: skip


def evaluated(folder: Path, env: str, policy: str, noise: str, floor: str, config: Config) -> Evaluation:
    """Return a policy's episodes on a floor, which are driven where they are missing."""
    name = Path(policy).parent.name if policy.endswith(".onnx") else policy
    told = slug(env=env, policy=name, noise=noise, floor=floor, n=config.episodes, seed=config.first_seed)
    return kept(folder / f"{told}.pickle", driven, env, policy, noise, floor, config)


def recorded(folder: Path, noise: str, floor: str, config: Config) -> list[Drive]:
    """Return the drives for filters on a floor, which are driven where they are missing."""
    told = slug(noise=noise, floor=floor, n=config.drives, seconds=config.seconds, seed=config.first_seed)
    return kept(folder / f"{told}.pickle", record, noise, floor, config)


def judged(folder: Path, noise: str, floor: str, config: Config) -> list[dict[str, Any]]:
    """Return how filters did on a floor, who are run where that is missing."""
    told = slug(filters=f"filters {noise}", floor=floor, n=config.drives, seconds=config.seconds, seed=config.first_seed)
    return kept(folder / f"{told}.pickle", filter_rows, folder, noise, floor, config)


def trained_policy(folder: Path, env: str, error: float, seed: int) -> str:
    """Return the bundle of a policy that was trained with errors of the speed, which is made where it is missing."""
    return str(trained(folder, seed, None, env=env, randomize=True, speed_error=error) / "policy.onnx")


def study(config: Config, folder: Path) -> dict[str, Any]:
    """Drive what was not driven yet, and return the rows."""

    def run(function: Any, cases: Sequence[tuple[Any, ...]], label: str, *last: Any) -> dict[tuple[Any, ...], Any]:
        jobs = [(function, (folder, *case, *last)) for case in cases]
        return dict(zip(cases, run_all(jobs, label, config.processes), strict=True))

    evaluations = run(evaluated, [(*case, floor) for case in CASES for floor in FLOORS], "policies", config)
    drives = run(recorded, [(noise, floor) for noise in NOISES for floor in FLOORS], "drives", config)
    filters = run(judged, [(noise, floor) for noise in MEASURED for floor in FLOORS], "filters", config)
    learned = [(NAV, error, seed) for error in SPEED_ERRORS for seed in range(config.trainings)]
    bundles = run(trained_policy, learned, "trainings")
    ours = [(env, bundles[env, error, seed], MEASURED[0]) for env, error, seed in learned]
    evaluations |= run(evaluated, [(*case, floor) for case in ours for floor in FLOORS], "trained policies", config)

    def row(case: tuple[str, ...], floor: str, **names: Any) -> dict[str, Any]:
        return policy_row(*case, floor, evaluations[(*case, floor)], evaluations[(*case, UNICYCLE)]) | names

    return {
        "policies": [row(case, floor) for case in CASES for floor in FLOORS],
        "trained": [
            row(case, floor, policy=f"ppo, error {error:g}, seed {seed}")
            for case, (_, error, seed) in zip(ours, learned, strict=True) for floor in FLOORS
        ],
        "filters": [one for rows in filters.values() for one in rows],
        "drift": [drift(floor, drives["wheel", floor]) for floor in FLOORS],
    }  # fmt: skip


def tables(found: Mapping[str, Any]) -> list[Table]:
    """Return the study's tables."""
    policies = Table("task", "policy", "noise", *(f"{floor}, of n" for floor in FLOORS), "time, grip", "time, slippery")
    rows = [*found["policies"], *found["trained"]]
    for at in range(0, len(rows), len(FLOORS)):
        several = rows[at : at + len(FLOORS)]
        counts = [f"{row['succeeded']} of {row['of']}" for row in several]
        ratios = [row["where_both_succeed"]["ratio"] for row in several[1:]]
        first = several[0]
        cells = [f"{ratio:.3f}" if ratio else "" for ratio in ratios]
        policies.add_row(first["env"].removeprefix("turtlebot_gym/TurtleBot"), first["policy"], first["noise"], *counts, *cells)
    filters = Table("noise", "floor", "filter", "position, m", "over matched", "heading, rad", "NEES")
    for row in found["filters"]:
        numbers = f"{row['position'].value:.3f}", told(row["over_matched"]), f"{row['heading'].value:.3f}"
        filters.add_row(row["noise"], row["floor"], row["filter"], *numbers, f"{row['nees'].value:.1f}")
    drifts = Table("floor", "drift of wheel odometry, m per metre", "rad per metre")
    for row in found["drift"]:
        drifts.add_row(row["floor"], told(row["position"], 4), told(row["heading"], 4))
    return [policies, filters, drifts]


def told(interval: Interval, digits: int = 2) -> str:
    """Return a number with its interval."""
    value, low, high = (f"{number:.{digits}f}" for number in interval)
    return f"{value} ({low}, {high})"


def main() -> None:
    """Drive, print tables, and write."""
    config = tyro.cli(Config, description=__doc__)
    found = study(config, results_folder("transfer"))
    print_tables(*tables(found))
    write_json(config.json, found, config=settings_of(config))


if __name__ == "__main__":
    main()
