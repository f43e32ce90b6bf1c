"""The study: where learning beats geometry, by how much, and with what certainty.

In each scenario PPO is trained with several seeds, and the baselines are tuned with as many episodes per try as the evaluation
has. All drive the same new episodes. The intervals include the variation between trainings as well as between episodes, and the
p-values are corrected for the number of scenarios (Holm). A tuned baseline is a single policy, so its interval covers episodes
only.

Finished work is kept under `out/`, by commit, so an interrupted run resumes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import tyro

from harness.study import write_summary
from harness.tables import table
from scenarios import BASELINES, NAV, POSE, SQUARE, Budget, evaluate_baselines, results_folder, run_all, trained, tuned
from tune_baseline import best_of
from turtlebot_gym import ROBOTS
from turtlebot_gym_agents.evaluation.comparison import PairedOutcome, compare
from turtlebot_gym_agents.evaluation.evaluate import evaluate
from turtlebot_gym_agents.evaluation.metrics import holm, mean, share
from turtlebot_gym_agents.policies.bundle import BundlePolicy
from turtlebot_gym_agents.provenance import plain, settings_of, write_json

BURGER = ROBOTS["burger"]
SLUGGISH = replace(BURGER, max_linear_acceleration=0.1, max_angular_acceleration=1.0)
SEES = {"truth": "true pose", "odometry": "raw odometry", "ekf": "estimate"}
SCENARIOS: dict[str, dict[str, Any]] = {
    **{
        f"Nav, {SEES[observation]}, {noise}": {"env": NAV, "observation": observation, "noise": noise}
        for observation, noises in {
            "truth": ("clean", "rough"),  # under clean, tutorial and documented the plant is the same, exact
            "odometry": ("tutorial", "documented", "rough", "wheel"),
            "ekf": ("tutorial", "documented", "rough", "wheel"),
        }.items()
        for noise in noises
    },
    **{
        f"{name}, tutorial": {"env": env, "observation": "ekf", "noise": "tutorial", **options}
        for name, env, options in (
            ("Nav, arrival on belief", NAV, {"arrival": "belief"}),
            ("Nav, delay of 0.2 s", NAV, {"delay": 2}),
            ("Nav, 0.1 m/s² and 1 rad/s²", NAV, {"robot": SLUGGISH}),
            ("Nav, no reverse", NAV, {"robot": replace(BURGER, reverse=False)}),
            ("Pose", POSE, {}),
            ("Pose, no reverse", POSE, {"robot": replace(BURGER, reverse=False)}),
            ("Square", SQUARE, {}),
        )
    },
}
"""Arguments of environments by name. The default robot is the burger."""
LEVEL = 0.05
UNREAD = ("options", "seeds", "numbers", "commits")
"""Parts of the results that no page shows."""
COLUMNS = {
    "scenario": "{scenario}",
    "baseline": "{compared_with}",
    "tuned, s": "{baselines[0][time].value:.2f}",
    "PPO minus it, s": "{ppo[difference]:+.2f}",
    "p (Holm)": "{p_holm:.2g}",
    "": "{verdict}",
}


@dataclass(frozen=True, kw_only=True)
class Config(Budget):
    """Train, tune and evaluate everything."""

    only: tuple[str, ...] = ()
    """Scenarios by name; by default all."""
    seeds: int = 5
    """Number of trainings of each scenario, with seeds from 0."""
    steps: int | None = None
    """Steps of each training; by default those of the configuration."""
    first_seed: int = 1_000_000
    """First seed of the evaluation's episodes."""
    runs: Path | None = None
    """Folder of trainings and tunings; by default out/study/COMMIT."""
    out: Path = Path("out/study")
    """Folder for robustness.json, whose summary goes beside this script."""


def compared(config: Config, folder: Path, name: str) -> dict[str, Any]:
    """Return the row of a scenario with finished trainings and tunings."""
    options = SCENARIOS[name]
    baselines = evaluate_baselines(folder, config, config.first_seed, **options)
    common = {**options, "episodes": config.episodes, "seed": config.first_seed}
    bundles = [BundlePolicy(trained(folder, seed, config.steps, **options) / "policy.onnx") for seed in range(config.seeds)]
    best = next(iter(baselines))

    def described(policy: str) -> dict[str, Any]:
        episodes, tries = baselines[policy].episodes, tuned(folder, policy, config, **options)
        return {
            "policy": policy,
            "numbers": best_of(tries).numbers,
            "time": mean(baselines[policy].times()),
            "time_untuned": mean(evaluate(policy, **common).times()),
            "success": share(episodes.success),
            "false_arrival": share(episodes.false_arrival),
        }

    return {
        "scenario": name,
        "options": options,
        "seeds": {
            "training": list(range(config.seeds)),
            "evaluation": [config.first_seed, config.first_seed + config.episodes],
        },
        "baselines": [described(policy) for policy in baselines],
        "compared_with": best,
        "ppo": compare([PairedOutcome.of(evaluate(bundle, **common)) for bundle in bundles], PairedOutcome.of(baselines[best])),
        "commits": sorted({str(bundle.card.training["commit"]) for bundle in bundles}),
    }


def false_arrivals(config: Config, noise: str) -> dict[str, Any]:
    """Return how often the bearing law with its defaults ends an episode by a false belief of arrival."""
    options = {"env": NAV, "arrival": "belief", "noise": noise, "episodes": config.episodes, "seed": config.first_seed}
    return {"noise": noise, "policy": "bearing", "false_arrival": share(evaluate("bearing", **options).episodes.false_arrival)}


def verdict(row: dict[str, Any]) -> str:
    """Return the verdict by the corrected p-value."""
    if row["p_holm"] >= LEVEL:
        return "no difference found"
    return "PPO faster" if row["ppo"]["difference"].value < 0.0 else "PPO slower"


def main() -> None:
    """Run the study, and write its results and its figure."""
    config = tyro.cli(Config, description=__doc__)
    folder = config.runs or results_folder("study")
    names = config.only or tuple(SCENARIOS)
    # Longest first, so that no process ends long after the others.
    ordered = sorted(names, key=lambda name: (SCENARIOS[name]["env"] == NAV, SCENARIOS[name]["env"]))
    jobs: list[Any] = [
        partial(trained, folder, seed, config.steps, **SCENARIOS[name]) for name in ordered for seed in range(config.seeds)
    ]
    jobs += [
        partial(tuned, folder, policy, config, **SCENARIOS[name])
        for name in ordered
        for policy in BASELINES[SCENARIOS[name]["env"]]
    ]
    run_all(jobs, "trainings and tunings", config.processes)
    rows = run_all([partial(compared, config, folder, name) for name in names], "evaluations", config.processes)
    for row, p in zip(rows, holm([row["ppo"]["p"] for row in rows]), strict=True):
        row["p_holm"] = p
        row["verdict"] = verdict(row)
    noises = ("tutorial", "documented", "wheel", "rough")
    results = {"comparisons": rows, "false_arrivals": [false_arrivals(config, noise) for noise in noises]}
    write_json(config.out / "robustness.json", results, config=settings_of(config))
    write_summary(Path("benchmarks/robustness.json"), results, config, UNREAD)
    print(table(plain(rows), COLUMNS))


if __name__ == "__main__":
    main()
