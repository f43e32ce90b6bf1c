"""The study: where learning beats geometry on open ground, by how much, and with what certainty.

In each scenario PPO is trained with several seeds, and the baselines are tuned with as many episodes per try as the evaluation
has. All drive the same new episodes. The intervals include the variation between trainings as well as between episodes, and the
p-values are corrected for the number of scenarios (Holm). Every try of a tuning drives the same episodes, on seeds of its own;
the first has the defaults, half of the others are anywhere in the ranges, and the rest closer and closer to the best so far.
"""

from __future__ import annotations

import math
import os
import tempfile
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from itertools import product
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import tyro

from harness.study import each, finished, publish
from turtlebot_gym import ROBOTS
from turtlebot_gym_agents.evaluation.comparison import PairedOutcome, compare
from turtlebot_gym_agents.evaluation.evaluate import evaluate
from turtlebot_gym_agents.evaluation.metrics import holm, mean, share
from turtlebot_gym_agents.policies import POLICIES
from turtlebot_gym_agents.training.config import TrainingConfig
from turtlebot_gym_agents.training.train import train

FORWARDS = replace(ROBOTS["burger"], reverse=False)
SLUGGISH = replace(ROBOTS["burger"], max_linear_acceleration=0.1, max_angular_acceleration=1.0)
SEEN = {
    "true pose": ("truth", ("clean", "rough")),  # under clean, tutorial and documented the plant is the same, exact
    "raw odometry": ("odometry", ("tutorial", "documented", "rough", "wheel")),
    "estimate": ("ekf", ("tutorial", "documented", "rough", "wheel")),
}
"""What the policy sees, and the noises with it."""
OTHERS: dict[str, dict[str, Any]] = {
    "Nav, arrival on belief": {"env": "nav", "arrival": "belief"},
    "Nav, delay of 0.2 s": {"env": "nav", "delay": 2},
    "Nav, 0.1 m/s² and 1 rad/s²": {"env": "nav", "robot": SLUGGISH},
    "Nav, no reverse": {"env": "nav", "robot": FORWARDS},
    "Pose": {"env": "pose"},
    "Pose, no reverse": {"env": "pose", "robot": FORWARDS},
    "Square": {"env": "square"},
}
SCENARIOS: dict[str, dict[str, Any]] = {
    f"Nav, {seen}, {noise}": {"env": "nav", "observation": observation, "noise": noise}
    for seen, (observation, noises) in SEEN.items()
    for noise in noises
}
SCENARIOS |= {f"{name}, tutorial": {"observation": "ekf", "noise": "tutorial", **options} for name, options in OTHERS.items()}
BASELINES = {"nav": ("bearing",), "pose": ("bearing",), "square": ("bearing", "corner")}
"""Baselines of each task; on Nav, without a following waypoint, `corner` equals `bearing`."""
STEER = {"gain": (0.3, 20.0), "focus": (0.0, 3.0), "tolerance": (0.0, 0.15), "slow": (0.02, 0.5)}
RANGES = {"bearing": STEER, "corner": {"cut": (0.05, 0.4), "depth": (0.3, 0.85), **STEER}}
LOGARITHMIC = ("gain", "slow")
"""Ranges of tuned numbers, and those that are drawn by their logarithm."""
FIRST, TUNING = 1_000_000, 2**39
"""First seeds of the evaluation's episodes and of those of the tries."""
Numbers = dict[str, float]


def tuned(policy: str, options: dict[str, Any], episodes: int, tries: int) -> tuple[Numbers, float]:
    """Return the numbers with which a baseline is fastest in some tries, and its mean time, s; failures count as the limit."""
    ranges, kind, done = RANGES[policy], POLICIES[policy], list[tuple[float, Any, Numbers]]()
    to = [math.log if name in LOGARITHMIC else float for name in ranges]
    back = [math.exp if name in LOGARITHMIC else float for name in ranges]
    low, high = np.array([[scale(end) for end in ends] for scale, ends in zip(to, ranges.values(), strict=True)]).T
    for number in range(tries):
        rng = np.random.default_rng((0, number))
        at = low + rng.uniform(size=len(ranges)) * (high - low)
        if number == 0:
            at = np.array([scale(getattr(kind, name)) for scale, name in zip(to, ranges, strict=True)])
        elif 2 * number >= tries:
            width = 0.2 * 0.15 ** (2.0 * number / tries - 1.0)  # as a share of the ranges
            _, best, _ = min(done, key=lambda attempt: attempt[0])
            at = np.clip(best + width * rng.normal(size=len(ranges)) * (high - low), low, high)
        numbers = {name: float(f"{scale(value):.4g}") for name, scale, value in zip(ranges, back, at, strict=True)}
        driver = kind(options.get("robot", "burger"), **numbers)
        done.append((float(evaluate(driver, episodes=episodes, seed=TUNING, **options).times().mean()), at, numbers))
    time, _, numbers = min(done, key=lambda attempt: attempt[0])
    return numbers, time


def driven(scenario: str, policy: str, seed: int, steps: int | None, episodes: int, tries: int) -> dict[str, Any]:
    """Train PPO with a seed, or tune a baseline, and return how it drives the new episodes."""
    about, options, tuning = {**locals()}, SCENARIOS[scenario], {}
    given = {**options, "episodes": episodes, "seed": FIRST}
    if policy == "ppo":
        with tempfile.TemporaryDirectory() as folder:
            train(TrainingConfig(steps=steps, seed=seed, **options), folder, progress=False)
            evaluation = evaluate(Path(folder, "policy.onnx"), **given)
    else:
        numbers, time = tuned(policy, options, episodes, tries)
        evaluation = evaluate(POLICIES[policy](options.get("robot", "burger"), **numbers), **given)
        tuning = {"numbers": numbers, "tuning": time, "untuned": evaluate(policy, **given).times()}
    return {**about, **tuning, **PairedOutcome.of(evaluation)._replace(seed=seed)._asdict()}


def compared(scenario: str, rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Return a scenario's result: the tuned baselines, the fastest in its tuning first, and PPO beside that."""

    def outcome(row: dict[str, Any]) -> PairedOutcome:
        return PairedOutcome(FIRST, *(np.array(row[name]) for name in ("times", "success", "false_arrival")))

    rows = [row for row in rows if row["scenario"] == scenario]
    baselines = sorted((row for row in rows if row["policy"] != "ppo"), key=lambda row: row["tuning"])
    learned = [outcome(row) for row in sorted(rows, key=lambda row: row["seed"]) if row["policy"] == "ppo"]
    found, names = compare(learned, outcome(baselines[0])), ("trainings", "episodes", "time", "difference", "p", "success")
    shown = [
        {
            "policy": row["policy"],
            "success": share(row["success"]),
            "time": mean(row["times"]),
            "time_untuned": mean(row["untuned"]),
        }
        for row in baselines
    ]
    return {"scenario": scenario, "baselines": shown, "ppo": {name: found[name] for name in names}}


def main(
    *,
    episodes: int = 2000,
    tries: int = 40,
    processes: int = os.cpu_count() or 1,
    only: tuple[str, ...] = tuple(SCENARIOS),
    seeds: int = 5,
    steps: int | None = None,
    kept: Path = Path("out/robustness.jsonl"),
    json: Path = Path("benchmarks/robustness.json"),
) -> None:
    """Train with some seeds, for some steps or the configuration's, tune with some tries, and evaluate; print and write.

    Finished work is kept in a file, with which an interrupted run goes on; remove it when the code has changed.
    """
    options = {**locals()}
    os.environ.update(TURTLEBOT_GYM_THREADS="1", OMP_NUM_THREADS="1")  # of the processes: each has one core
    ordered = sorted(only, key=lambda name: SCENARIOS[name]["env"] == "nav")  # longest first, so that none ends long after
    contenders = {name: [*product(["ppo"], range(seeds)), *product(BASELINES[SCENARIOS[name]["env"]], [0])] for name in ordered}
    units = [(name, *contender, steps, episodes, tries) for name in ordered for contender in contenders[name]]
    pool = ProcessPoolExecutor(processes, get_context("spawn"))
    done = finished(driven, units, kept, "scenario policy seed steps episodes tries", pool)
    rows = [*each(done, "trainings and tunings", len(units))]
    comparisons = [compared(name, rows) for name in only]
    for row, p in zip(comparisons, holm([row["ppo"]["p"] for row in comparisons]), strict=True):
        faster = "PPO faster" if row["ppo"]["difference"].value < 0.0 else "PPO slower"
        row.update(p_holm=p, verdict="no difference found" if p >= 0.05 else faster)
    publish(json, {"comparisons": comparisons}, options)


if __name__ == "__main__":
    tyro.cli(main, description=__doc__)
