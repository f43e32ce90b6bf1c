"""The study of transfer from the unicycle to a second physics: every open-ground policy and every filter on three floors.

The same seeds are driven with the unicycle, with a Burger in MuJoCo on a floor that grips, and on a slippery one. Policies are
compared with themselves on the unicycle in pairs; all filters see the same drives, whose commands do not depend on an estimate.

`make study-transfer` runs it and writes `transfer.json`. Finished drives are kept under `out/`, by commit, so an interrupted
run resumes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from harness.study import Study, run
from scenarios import NAV, POSE, SQUARE, kept, results_folder, run_all, slug, trained
from transfer_filters import Drive, compared, drift
from turtlebot_gym.heart import Episode
from turtlebot_gym.models.unicycle import command_of
from turtlebot_gym.plants import make_plant
from turtlebot_gym.systems import Options, make_parameters
from turtlebot_gym.values import STOP
from turtlebot_gym_agents.evaluation import metrics
from turtlebot_gym_agents.evaluation.estimation import FORWARD, HOLD, TURN
from turtlebot_gym_agents.evaluation.evaluate import Evaluation, evaluate

UNICYCLE, GRIP, SLIPPERY = "unicycle", "grip", "slippery"
FLOORS = {UNICYCLE: make_plant(), GRIP: make_plant("mujoco"), SLIPPERY: make_plant("mujoco", friction=0.5, caster_friction=0.3)}
"""Plants by name."""
POLICIES = {
    NAV: ("proportional", "bearing", "corner", "polar", "rotate-drive-rotate", "ppo-nav"),
    POSE: ("polar", "rotate-drive-rotate", "ppo-pose"),
    SQUARE: ("bearing", "corner", "ppo-square"),
}
"""Policies of each task."""
NOISES = ("tutorial", "documented", "wheel")
CASES = [
    (env, policy, noise)
    for env, names in POLICIES.items()
    for policy in names
    for noise in NOISES
    if (env, noise) != (SQUARE, "documented")
]
"""Task, policy and noise of each case. Drives of the square are long, and `documented` adds little there."""
MEASURED = ("tutorial", "documented")
"""Noises for filters."""
SPEED_ERRORS = (0.02, 0.15)
"""Largest errors of the executed speed in trainings: that of the shipped policies, and one that covers a slippery floor."""


@dataclass(frozen=True, kw_only=True)
class Config(Study):
    """Drive everything."""

    episodes: int = 50
    """Episodes of each policy on each floor."""
    drives: int = 30
    """Drives of all filters on each floor."""
    trainings: int = 2
    """Trainings on Nav for each range of the speed's error."""
    seconds: float = 60.0
    """Length of a drive for filters, s."""
    first_seed: int = 2_000_000
    """First seed of policies and filters."""
    processes: int = 1
    """Number of parallel processes, each on one core."""


def driven(env: str, policy: str, noise: str, floor: str, config: Config) -> Evaluation:
    """Drive a policy."""
    options = {"noise": noise, "plant": FLOORS[floor] or "unicycle"}
    return evaluate(policy, env=env, episodes=config.episodes, seed=config.first_seed, **options)


def record(noise: str, floor: str, config: Config) -> list[Drive]:
    """Drive with random commands, each held for a second, as `turtlebot-gym estimate` does."""
    task, waypoints = Options(task="square", switch="time").course()
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


def filter_rows(folder: Path, noise: str, floor: str, config: Config) -> list[dict[str, Any]]:
    """Return the results of each filter on the drives of a floor."""
    return [{"noise": noise, "floor": floor, **row} for row in compared(recorded(folder, noise, floor, config), noise)]


def policy_row(env: str, policy: str, noise: str, floor: str, one: Evaluation, unicycle: Evaluation) -> dict[str, Any]:
    """Return the results of a policy on a floor, and its paired comparison with itself on the unicycle."""
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
    """Return a policy's episodes on a floor, which are driven if missing."""
    name = Path(policy).parent.name if policy.endswith(".onnx") else policy
    stem = slug(env=env, policy=name, noise=noise, floor=floor, n=config.episodes, seed=config.first_seed)
    return kept(folder / f"{stem}.pickle", driven, env, policy, noise, floor, config)


def recorded(folder: Path, noise: str, floor: str, config: Config) -> list[Drive]:
    """Return the drives for filters on a floor, which are driven if missing."""
    stem = slug(noise=noise, floor=floor, n=config.drives, seconds=config.seconds, seed=config.first_seed)
    return kept(folder / f"{stem}.pickle", record, noise, floor, config)


def judged(folder: Path, noise: str, floor: str, config: Config) -> list[dict[str, Any]]:
    """Return the results of filters on a floor, which are computed if missing."""
    stem = slug(filters=f"filters {noise}", floor=floor, n=config.drives, seconds=config.seconds, seed=config.first_seed)
    return kept(folder / f"{stem}.pickle", filter_rows, folder, noise, floor, config)


def study(config: Config, folder: Path) -> dict[str, Any]:
    """Run missing drives, and return the rows."""

    def run(function: Any, cases: Sequence[tuple[Any, ...]], label: str) -> dict[tuple[Any, ...], Any]:
        jobs = [partial(function, folder, *case, config) for case in cases]
        return dict(zip(cases, run_all(jobs, label, config.processes), strict=True))

    evaluations = run(evaluated, [(*case, floor) for case in CASES for floor in FLOORS], "policies")
    drives = run(recorded, [(noise, floor) for noise in NOISES for floor in FLOORS], "drives")
    filters = run(judged, [(noise, floor) for noise in MEASURED for floor in FLOORS], "filters")
    learned = [(NAV, error, seed) for error in SPEED_ERRORS for seed in range(config.trainings)]
    trainings = [
        partial(trained, folder, seed, None, env=env, randomize=True, speed_error=error) for env, error, seed in learned
    ]
    runs = run_all(trainings, "trainings", config.processes)
    ours = [(NAV, str(run / "policy.onnx"), MEASURED[0]) for run in runs]
    evaluations |= run(evaluated, [(*case, floor) for case in ours for floor in FLOORS], "trained policies")

    def row(case: tuple[str, ...], floor: str, **names: Any) -> dict[str, Any]:
        return policy_row(*case, floor, evaluations[(*case, floor)], evaluations[(*case, UNICYCLE)]) | names

    return {
        "policies": [row(case, floor) for case in CASES for floor in FLOORS],
        "trained": [
            row(case, floor, policy=f"ppo, error {error:g}, seed {seed}")
            for case, (_, error, seed) in zip(ours, learned, strict=True) for floor in FLOORS
        ],
        "filters": [row for rows in filters.values() for row in rows],
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
        numbers = f"{row['position'].value:.3f}", f"{row['over_matched']:.2f}", f"{row['heading'].value:.3f}"
        filters.add_row(row["noise"], row["floor"], row["filter"], *numbers, f"{row['nees'].value:.1f}")
    drifts = Table("floor", "drift of wheel odometry, m per metre", "rad per metre")
    for row in found["drift"]:
        drifts.add_row(row["floor"], f"{row['position']:.4f}", f"{row['heading']:.4f}")
    return [policies, filters, drifts]


def measure(config: Config) -> tuple[dict[str, Any], list[Table]]:
    """Return the results of the study, and its tables."""
    results = study(config, results_folder("transfer"))
    return results, tables(results)


if __name__ == "__main__":
    run(Config, measure, beside=__file__)
