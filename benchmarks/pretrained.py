"""Train the policies shipped with the package, compare them with tuned baselines, and write their cards.

Training is randomized: noise, speed scale and delay differ between environments. The training with the highest return on its
own evaluation seeds is selected from several. It is then compared, on new seeds, with the baselines of its task, each tuned for
the noise of the comparison: one policy for all noises against specialists.

`make study` runs it. Finished work is kept under `out/`, by commit, so an interrupted run resumes.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from shutil import copyfile
from typing import Any, Literal

import tyro

from scenarios import (
    BASELINES,
    NAV,
    POSE,
    SQUARE,
    Budget,
    best_of_trainings,
    described,
    evaluate_baselines,
    results_folder,
    run_all,
    trainings,
    tuned,
)
from turtlebot_gym_agents.evaluation.evaluate import evaluate, paired
from turtlebot_gym_agents.evaluation.metrics import mean, paired_share_difference, share, side
from turtlebot_gym_agents.policies.bundle import BundlePolicy
from turtlebot_gym_agents.provenance import settings_of, write_json

TASKS = {"nav": NAV, "pose": POSE, "square": SQUARE}
NOISES = ("tutorial", "documented", "rough")
WORDS = {-1: "Faster than", 0: "No different from", 1: "Slower than"}


@dataclass(frozen=True, kw_only=True)
class Config(Budget):
    """Train and describe the shipped policies."""

    tasks: tuple[Literal["nav", "pose", "square"], ...] = ("nav", "pose", "square")
    """Policies to train."""
    seeds: int = 3
    """Number of trainings of each, with seeds from 0; the best one is selected."""
    steps: int | None = None
    """Steps of each training; by default those of the configuration."""
    first_seed: int = 2_000_000
    """First seed of the evaluation's episodes."""
    runs: Path | None = None
    """Folder of trainings; by default out/pretrained/COMMIT."""
    tunings: Path | None = None
    """Folder of tuned baselines; by default those of the study, out/study/COMMIT."""
    out: Path = Path("out/pretrained")
    """Folder for policies, cards and pretrained.json."""


def scenario(task: str, noise: str) -> dict[str, Any]:
    """Return the environment's arguments in the form of the study, so that its tunings are reused."""
    return {"env": TASKS[task], "observation": "ekf", "noise": noise}


def compared(config: Config, tunings: Path, bundle: Path, task: str) -> list[dict[str, Any]]:
    """Return a policy's figures with those of the tuned baselines, for each noise."""
    policy, rows = BundlePolicy(bundle), []
    for noise in NOISES:
        options = scenario(task, noise)
        learned = evaluate(policy, **options, episodes=config.episodes, seed=config.first_seed)
        success = learned.episodes.success
        rows.append({"noise": noise, "policy": f"ppo-{task}", "success": share(success), "time": mean(learned.times())})
        for name, evaluation in evaluate_baselines(tunings, config, config.first_seed, **options).items():
            rows.append(
                {
                    "noise": noise,
                    "policy": name,
                    "success": share(evaluation.episodes.success),
                    "time": mean(evaluation.times()),
                    "ppo_minus_it": paired(learned, evaluation),
                    "success_difference": paired_share_difference(success, evaluation.episodes.success),
                }
            )
    return rows


def card(task: str, config: Config, bundle: Path, rows: list[dict[str, Any]]) -> str:
    """Return a policy's card, in Markdown."""
    policy = BundlePolicy(bundle)
    seed, name = policy.card.training["config"]["seed"], f"ppo-{task}"
    lines = [
        f"# {name}",
        "",
        *_verdicts(rows),
        "",
        *described(bundle, policy, "noise, speed (2 %) and delay (0 or 1 step)", config.seeds),
        "",
        f"Train it again: `turtlebot-gym train --env {policy.card.env} --randomize --seed {seed}`. Use it: `--policy {name}`.",
        "",
        f"{config.episodes} episodes on seeds from {config.first_seed:,}, 95 % intervals. A failure counts as the time limit.",
        f"Each baseline is tuned for the noise of its row: {config.tries} tries of {config.episodes} episodes on other seeds.",
        "Differences are those of the same episodes. They speak of this one policy, not of another training.",
        "",
        f"| noise | policy | success, % | time, s | {name} minus it, s | in success, points |",
        "|---|---|---|---|---|---|",
    ]
    for row in rows:
        line = f"| {row['noise']} | {row['policy']} | {row['success']:.1%} | {row['time'].value:.2f} |"
        if "ppo_minus_it" in row:
            line += f" {row['ppo_minus_it']:+.2f} | {row['success_difference']:+.1%} |"
        else:
            line += " | |"
        lines.append(line)
    return "\n".join(lines) + "\n"


def _verdicts(rows: list[dict[str, Any]]) -> list[str]:
    """Return a line for each outcome, losses first, with the baselines for which the whole interval is on one side."""
    names_by_side: dict[int, list[str]] = {1: [], 0: [], -1: []}
    for row in rows:
        if "ppo_minus_it" in row:
            names_by_side[side(row["ppo_minus_it"])].append(f"`{row['policy']}` ({row['noise']})")
    return [f"{WORDS[sign]} the tuned {', '.join(names)}." for sign, names in names_by_side.items() if names]


def main() -> None:
    """Train, tune, evaluate, and write the results."""
    config = tyro.cli(Config, description=__doc__)
    folder, tunings = config.runs or results_folder("pretrained"), config.tunings or results_folder("study")
    training_of = {task: trainings(folder, config.steps, config.seeds, TASKS[task]) for task in config.tasks}
    jobs = [job for task in reversed(config.tasks) for job in training_of[task]]
    jobs += [
        partial(tuned, tunings, policy, config, **scenario(task, noise))
        for task in config.tasks for noise in NOISES for policy in BASELINES[TASKS[task]]
    ]  # fmt: skip
    run_all(jobs, "trainings and tunings", config.processes)
    config.out.mkdir(parents=True, exist_ok=True)
    for task in config.tasks:
        best = best_of_trainings([training() for training in training_of[task]])
        copyfile(best / "policy.onnx", config.out / f"ppo-{task}.onnx")
    bundles = {task: config.out / f"ppo-{task}.onnx" for task in config.tasks}
    cards = [partial(compared, config, tunings, bundles[task], task) for task in config.tasks]
    rows = run_all(cards, "cards", config.processes)
    results = dict(zip((f"ppo-{task}" for task in config.tasks), rows, strict=True))
    for task in config.tasks:
        text = card(task, config, bundles[task], results[f"ppo-{task}"])
        (config.out / f"ppo-{task}.md").write_text(text, encoding="utf-8")
        print(text)
    write_json(config.out / "pretrained.json", results, config=settings_of(config))


if __name__ == "__main__":
    main()
