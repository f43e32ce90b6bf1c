"""The study: what learning is worth, and what the filter is worth, under every noise; with intervals, on paired episodes.

Part 1, the matrix: policies x what they see x noise. PPO is trained anew for each observation and each noise, with several
seeds, and tested on every noise, that it was trained on or not. Part 2, the scenarios: tasks where more than geometry counts;
there PPO is trained on the scenario itself and compared in pairs with the geometric baselines.

Run `python benchmarks/robustness.py`; it takes about twenty minutes on two cores and goes on where it was interrupted.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from matplotlib.figure import Figure
from rich.console import Console
from rich.progress import track

from turtlebot_gym import ROBOTS
from turtlebot_gym_agents.evaluation.evaluate import Evaluation, evaluate
from turtlebot_gym_agents.evaluation.metrics import mean
from turtlebot_gym_agents.policies.bundle import BundlePolicy
from turtlebot_gym_agents.provenance import write_json
from turtlebot_gym_agents.training.train import TrainingConfig, train

NAV, POSE, SQUARE = (f"turtlebot_gym/TurtleBot{name}-v0" for name in ("Nav", "Pose", "Square"))
NOISES = ("clean", "tutorial", "documented", "wheel", "rough")
OBSERVATIONS = ("truth", "odometry", "ekf")
BURGER = ROBOTS["burger"]
SCENARIOS: dict[str, dict[str, Any]] = {
    "Nav": {"env": NAV},
    "Nav, arrival on belief": {"env": NAV, "arrival": "belief"},
    "Nav, delay of 0.2 s": {"env": NAV, "delay": 2},
    "Nav, 0.1 m/s^2 and 1 rad/s^2": {
        "env": NAV,
        "robot": replace(BURGER, max_linear_acceleration=0.1, max_angular_acceleration=1.0),
    },
    "Nav, no reverse": {"env": NAV, "robot": replace(BURGER, reverse=False)},
    "Pose": {"env": POSE},
    "Pose, no reverse": {"env": POSE, "robot": replace(BURGER, reverse=False)},
    "Square": {"env": SQUARE},
}
"""Tasks where more than the bearing of a point may count."""
BASELINES = {NAV: ("bearing",), POSE: ("polar", "rotate-drive-rotate"), SQUARE: ("bearing",)}


@dataclass(frozen=True, kw_only=True)
class Config:
    """Train and evaluate it all."""

    episodes: int = 2000
    """Paired episodes of each evaluation."""
    seeds: int = 3
    """Seeds of training."""
    steps: int | None = None
    """Steps of each training; those of the configuration where it is not given."""
    runs: Path = Path("out/robustness")
    """Where trainings are kept; those that are there already are not made again."""
    json: Path = Path("benchmarks/robustness.json")
    """Results."""
    plot: Path = Path("benchmarks/robustness.png")
    """Figure."""
    first_seed: int = 1_000_000
    """First seed of the evaluation."""


def trained(config: Config, name: str, **options: Any) -> BundlePolicy:
    """Return the policy of a training, which is run if it was not before."""
    folder = config.runs / name
    bundle = folder / "policy.onnx"
    if not bundle.exists():
        train(TrainingConfig(steps=config.steps, **options), folder, resume=True, progress=False)
    return BundlePolicy(bundle)


def row(evaluations: list[Evaluation], against: Evaluation | None = None) -> dict[str, Any]:
    """Return the figures of one policy, over the seeds that it was trained with; times count a failure as the limit."""
    summary = {
        "success": mean(np.concatenate([one.episodes.success for one in evaluations]).astype(float)),
        "time": mean(np.mean([one.times() for one in evaluations], axis=0)),
        "effort": mean(np.mean([one.episodes.effort for one in evaluations], axis=0)),
        "false_arrival": mean(np.mean([one.episodes.false_arrival for one in evaluations], axis=0)),
        "time_of_each_seed": [float(one.times().mean()) for one in evaluations],
    }
    if against is not None:
        summary["minus_baseline"] = mean(np.mean([one.times() for one in evaluations], axis=0) - against.times())
    return summary


def matrix(config: Config) -> list[dict[str, Any]]:
    """Return part 1: a row for each policy, observation, noise of training and noise of testing."""
    rows = []
    common = {"env": NAV, "episodes": config.episodes, "seed": config.first_seed}
    for observation in OBSERVATIONS:
        base = {}
        for policy in ("proportional", "bearing"):
            for noise in NOISES:
                base[policy, noise] = evaluate(policy, noise=noise, observation=observation, **common)
                figures = row([base[policy, noise]], base["bearing", noise] if policy == "bearing" else None)
                rows.append({"policy": policy, "observation": observation, "trained": None, "noise": noise, **figures})
        for noise in track(NOISES, f"PPO on {observation}", console=Console(stderr=True)):
            policies = [
                trained(config, f"{observation}-{noise}-{seed}", noise=noise, observation=observation, seed=seed)
                for seed in range(config.seeds)
            ]
            for test in NOISES:
                tests = [evaluate(policy, noise=test, observation=observation, **common) for policy in policies]
                figures = row(tests, base["bearing", test])
                rows.append({"policy": "ppo", "observation": observation, "trained": noise, "noise": test, **figures})
    return rows


def scenarios(config: Config) -> list[dict[str, Any]]:
    """Return part 2: a row for each scenario and policy."""
    rows = []
    for name, options in track(SCENARIOS.items(), "scenarios", console=Console(stderr=True)):
        common = {**options, "episodes": config.episodes, "seed": config.first_seed}
        baselines = {policy: evaluate(policy, **common) for policy in BASELINES[options["env"]]}
        slug = "".join(letter if letter.isalnum() else "-" for letter in name.lower())
        policies = [trained(config, f"{slug}-{seed}", seed=seed, **options) for seed in range(config.seeds)]
        learned = [evaluate(policy, **common) for policy in policies]
        rows += [{"scenario": name, "policy": policy, **row([one])} for policy, one in baselines.items()]
        best = min(baselines.values(), key=lambda one: float(one.times().mean()))
        rows.append({"scenario": name, "policy": "ppo", **row(learned, best)})
    return rows


def _intervals(rows: list[dict[str, Any]], name: str) -> np.ndarray:
    """Return value, low and high of a figure of each row, shape (n, 3)."""
    return np.array([[row[name][part] for part in ("value", "low", "high")] for row in rows])


def figure(results: dict[str, Any]) -> Figure:
    """Draw the matrix's times by noise, one panel for each observation, and the scenarios' differences.

    The proportional law, at 29 s everywhere, is left out: it would press the others together.
    """
    drawn = Figure(figsize=(13, 7.5), layout="constrained")
    panels = drawn.subplot_mosaic([list(OBSERVATIONS), ["scenarios"] * 3], height_ratios=[1.0, 1.1])
    at = np.arange(len(NOISES))
    styles = {"bearing": ("#D55E00", "o"), "ppo": ("#009E73", "^")}
    for observation in OBSERVATIONS:
        axes = panels[observation]
        for shift, (policy, (colour, marker)) in zip((-0.1, 0.1), styles.items(), strict=True):
            chosen = [
                one
                for noise in NOISES
                for one in results["matrix"]
                if (one["policy"], one["observation"], one["noise"]) == (policy, observation, noise)
                and one["trained"] in (None, noise)
            ]
            values = _intervals(chosen, "time")
            errors = np.abs(values[:, 1:].T - values[:, 0])
            label = "PPO, trained on the same noise" if policy == "ppo" else policy
            axes.errorbar(at + shift, values[:, 0], errors, fmt=marker, color=colour, label=label, capsize=3)
        axes.set(title=f"observed: {observation}", ylim=(9.5, 17.5), xticks=at)
        axes.set_xticklabels(NOISES, rotation=20)
        axes.grid(axis="y", alpha=0.3)
    panels["truth"].set_ylabel("time to goal (s), a failure as 30 s")
    panels["truth"].legend(loc="upper left", fontsize="small")
    axes = panels["scenarios"]
    chosen = [one for one in results["scenarios"] if one["policy"] == "ppo"][::-1]
    values = _intervals(chosen, "minus_baseline")
    axes.errorbar(
        values[:, 0], range(len(chosen)), xerr=np.abs(values[:, 1:].T - values[:, 0]), fmt="^", color="#009E73", capsize=3
    )
    axes.axvline(0.0, color="black", linewidth=0.8)
    axes.set(
        yticks=range(len(chosen)),
        yticklabels=[one["scenario"] for one in chosen],
        xlabel="time of PPO minus that of the best baseline (s): left of the line, learning pays",
    )
    axes.grid(axis="x", alpha=0.3)
    return drawn


def main() -> None:
    """Run the study, and write its results and its figure."""
    config = tyro.cli(Config, description=__doc__)
    config.runs.mkdir(parents=True, exist_ok=True)
    results = {"matrix": matrix(config), "scenarios": scenarios(config)}
    told = {name: value for name, value in vars(config).items() if not isinstance(value, Path)}
    write_json(config.json, results, config=told)
    figure(json.loads(config.json.read_text())).savefig(config.plot, dpi=120)
    Console().print(f"{config.json} and {config.plot} are written.")


if __name__ == "__main__":
    main()
