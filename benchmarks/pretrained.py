"""Train the policies that come with the package, compare them with the baselines, and write their cards.

Run `python benchmarks/pretrained.py`; about four minutes on two cores. Training is randomized: noise, speed scale and delay
differ from environment to environment. Evaluation is on fixed noise, on seeds that no training has seen.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from shutil import copyfile
from typing import Literal

import tyro
from rich.console import Console

from turtlebot_gym_agents.evaluation.evaluate import evaluate, paired
from turtlebot_gym_agents.policies.bundle import BundlePolicy
from turtlebot_gym_agents.training.train import TrainingConfig, train

TASKS = {
    "nav": ("turtlebot_gym/TurtleBotNav-v0", ("bearing",)),
    "pose": ("turtlebot_gym/TurtleBotPose-v0", ("polar", "rotate-drive-rotate")),
    "square": ("turtlebot_gym/TurtleBotSquare-v0", ("bearing",)),
}
NOISES = ("tutorial", "documented", "rough")


@dataclass(frozen=True, kw_only=True)
class Config:
    """Train and describe the shipped policies."""

    tasks: tuple[Literal["nav", "pose", "square"], ...] = ("nav", "pose", "square")
    """Which of them."""
    seed: int = 0
    """Of the trainings."""
    episodes: int = 2000
    """Paired episodes of each evaluation."""
    first_seed: int = 2_000_000
    """First seed of the evaluations."""
    runs: Path = Path("out/pretrained")
    """Where the trainings are kept."""
    out: Path = Path("agents/pretrained")
    """Where policies and cards go."""


def card(name: str, config: Config, seconds: float, steps: int) -> str:
    """Return a policy's card, in Markdown."""
    env, baselines = TASKS[name]
    policy = BundlePolicy(config.out / f"ppo-{name}.onnx")
    size = (config.out / f"ppo-{name}.onnx").stat().st_size
    lines = [
        f"# ppo-{name}",
        "",
        f"PPO on `{env}`, robot `burger`, 10 Hz, observation `ekf`; {size / 1000:.0f} kB, sha256 `{policy.sha256[:16]}`.",
        f"Trained with randomized noise, speed (2 %) and delay (0 or 1 step): seed {config.seed}, {steps:,} steps, "
        f"{seconds:.0f} s on two cores.",
        "",
        f"Train it again: `turtlebot-gym train --env {env} --randomize --seed {config.seed}`. Use it: `--policy ppo-{name}`.",
        "",
        f"{config.episodes} episodes on seeds from {config.first_seed:,}, 95 % intervals; a failure counts as the time limit.",
        "The difference is that of paired episodes: below zero the policy is faster.",
        "",
        "| noise | policy | success, % | time, s | ppo minus it, s |",
        "|---|---|---|---|---|",
    ]
    for noise in NOISES:
        common = {"env": env, "noise": noise, "episodes": config.episodes, "seed": config.first_seed}
        learned = evaluate(policy, **common)
        rows = {f"ppo-{name}": learned} | {baseline: evaluate(baseline, **common) for baseline in baselines}
        for label, one in rows.items():
            success, time = one.summary()["success"], one.summary()["time"]
            difference = paired(learned, one)
            told = "" if one is learned else f"{difference.value:+.2f} ({difference.low:+.2f}, {difference.high:+.2f})"
            share = f"{100 * success.value:.1f} ({100 * success.low:.1f}, {100 * success.high:.1f})"
            lines.append(f"| {noise} | {label} | {share} | {time.value:.2f} | {told} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Train, evaluate, and write."""
    config = tyro.cli(Config, description=__doc__)
    config.out.mkdir(parents=True, exist_ok=True)
    for name in config.tasks:
        env, _ = TASKS[name]
        folder = config.runs / name
        result = train(TrainingConfig(env=env, seed=config.seed, randomize=True), folder, resume=True)
        copyfile(folder / "policy.onnx", config.out / f"ppo-{name}.onnx")
        text = card(name, config, result.seconds, result.steps)
        (config.out / f"ppo-{name}.md").write_text(text)
        Console().print(text)


if __name__ == "__main__":
    main()
