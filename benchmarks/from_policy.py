"""Measure trainings that begin with a known policy beside plain ones: success over CPU seconds, for several tasks and seeds.

Each training counts the CPU seconds of its process from before its model is made, without imports, compilation and its
evaluations of 500 episodes on other seeds. `make bench-from` runs it.
"""

from __future__ import annotations

import itertools
import json
import statistics
import time
from contextlib import closing
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import tyro

from harness.machine import in_child
from turtlebot_gym_agents.provenance import write_json

ENVS = {"Nav": ("bearing", 0.99), "Pose": ("polar", 0.99), "Square": ("corner", 0.95), "Rooms": ("vfh", 0.95)}
"""The policy that each task begins with, and the success whose time is reported."""


@dataclass(frozen=True, kw_only=True)
class Config:
    """Compare trainings from a policy with plain ones."""

    tasks: tuple[str, ...] = tuple(ENVS)
    """Tasks, of `ENVS`."""
    steps: int = 500_000
    """Steps of each training."""
    evaluations: int = 8
    """Evaluations of each training."""
    seeds: int = 5
    """Number of seeds."""
    json: Path | None = None
    """Write the results here, after each training; those that it holds are not run again."""
    child: tuple[str, str, int] | None = None
    """Task, policy ("none" for a plain training) and seed of a training in this process."""


def training(config: Config, task: str, policy: str, seed: int) -> list[dict[str, float]]:
    """Return the figures of a training's evaluations with its CPU seconds so far."""
    from turtlebot_gym_agents.training.callbacks import EvaluationCallback
    from turtlebot_gym_agents.training.config import TrainingConfig
    from turtlebot_gym_agents.training.train import learn

    begin = policy if policy != "none" else None
    chosen = TrainingConfig(env=f"turtlebot_gym/TurtleBot{task}-v0", seed=seed, steps=config.steps, from_policy=begin)

    class Judge(EvaluationCallback):
        spent = 0.0

        def run(self) -> dict[str, float]:
            started = time.process_time()
            reached = super().run()
            reached["cpu"] = started - start - self.spent
            self.spent += time.process_time() - started
            return reached

        def _on_training_start(self) -> None:
            super()._on_training_start()
            self.run()

    with closing(chosen.make_training()) as envs, closing(chosen.make(500)) as judges:
        for batch in (envs, judges):  # compiled before the clock starts
            batch.reset(seed=0)
            batch.step(batch.action_space.sample())
        start = time.process_time()
        judge = Judge(judges, every=max(1, config.steps // config.evaluations))
        learn(chosen, envs, [judge])
    return judge.history


def seconds_to(history: list[dict[str, float]], success: float) -> float | None:
    """Return the CPU seconds after which an evaluation reached a success rate, s; None if none did."""
    return next((figures["cpu"] for figures in history if figures["success"] >= success), None)


def summary(runs: list[list[dict[str, float]]], success: float) -> dict[str, Any]:
    """Return medians over the seeds: CPU seconds to the success, how many reached it, and the last figures."""
    times = [reached for history in runs if (reached := seconds_to(history, success)) is not None]
    last = {name: statistics.median(history[-1][name] for history in runs) for name in ("success", "return", "cpu")}
    return {"to": success, "seconds": statistics.median(times) if times else None, "reached": len(times), "last": last}


def main() -> None:
    """Measure, print and write JSON."""
    config = tyro.cli(Config, description=__doc__)
    if config.child:
        print(json.dumps(training(config, *config.child)))
        return
    known: dict[str, Any] = json.loads(config.json.read_text())["tasks"] if config.json and config.json.exists() else {}
    for task, seed in itertools.product(config.tasks, range(config.seeds)):
        policy, success = ENVS[task]
        for begin in (policy, "none"):
            begun = known.setdefault(task, {}).setdefault(begin, {"runs": []})
            if len(begun["runs"]) > seed:
                continue
            options = ("--steps", config.steps, "--evaluations", config.evaluations, "--child", task, begin, seed)
            begun["runs"].append(in_child(__file__, *options))
            begun |= summary(begun["runs"], success)
            print(task, begin, seed, {name: value for name, value in begun.items() if name != "runs"}, flush=True)
            if config.json is not None:
                settings = {name: value for name, value in asdict(config).items() if name not in ("json", "child", "tasks")}
                write_json(config.json, {"tasks": known}, config=settings)


if __name__ == "__main__":
    main()
