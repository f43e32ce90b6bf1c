"""Callbacks for training with Stable-Baselines3: progress, evaluation on separate seeds, checkpoints that survive a kill.

They know nothing of the command line: a script of one's own passes them to ``model.learn(callback=[...])``.
"""

from __future__ import annotations

import json
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback


def save_model(model: BaseAlgorithm, path: Path) -> None:
    """Save a model so that the file is, at every moment, either the old one or the new one, and whole."""
    beside = path.with_name(f".{path.name}.new")
    with beside.open("wb") as file:
        model.save(file)
    beside.replace(path)


class CheckpointCallback(BaseCallback):
    """Save the model every so many seconds; with a replay buffer, that too.

    Args:
        path: The file, replaced in one step.
        seconds: Least time between two checkpoints.
    """

    def __init__(self, path: Path, *, seconds: float = 5.0) -> None:
        super().__init__()
        self._path = path
        self._seconds = seconds
        self._last = time.monotonic()

    def _on_step(self) -> bool:
        return True

    def _on_rollout_start(self) -> None:
        if time.monotonic() - self._last >= self._seconds:
            save_model(self.model, self._path)
            self._last = time.monotonic()


class EvaluationCallback(BaseCallback):
    """Evaluate the deterministic policy on seeds of its own, keep the best model, and log to TensorBoard.

    Args:
        evaluate: Returns figures of a policy; "return" among them decides which model is best.
        path: Where the best model is kept.
        every: Steps between evaluations.
    """

    def __init__(self, evaluate: Callable[[Callable], dict[str, float]], *, path: Path, every: int) -> None:
        super().__init__()
        self._evaluate = evaluate
        self._path = path
        self._every = every
        self._next = every
        self._best = -np.inf
        self.history: list[dict[str, float]] = []

    def _on_training_start(self) -> None:
        note = self._path.with_suffix(".json")
        if note.is_file() and self.num_timesteps > 0:  # resumed
            self._best = json.loads(note.read_text())["return"]
        self._next = self.num_timesteps + self._every

    def _on_step(self) -> bool:
        return True

    def _on_rollout_start(self) -> None:
        if self.num_timesteps >= self._next:
            self._next = self.num_timesteps + self._every
            self.run()

    def run(self) -> dict[str, float]:
        """Evaluate now."""
        figures = {"steps": float(self.num_timesteps)}
        figures |= self._evaluate(lambda observations: self.model.predict(observations, deterministic=True)[0])
        self.history.append(figures)
        for name, value in figures.items():
            self.logger.record(f"eval/{name}", value)
        if figures["return"] > self._best:
            self._best = figures["return"]
            save_model(self.model, self._path)
            self._path.with_suffix(".json").write_text(json.dumps(figures) + "\n")
        return figures


class ProgressCallback(BaseCallback):
    """Show a bar on standard error, with the share of the last 200 episodes that were a success.

    Args:
        total: Steps of the whole training.
        label: What stands before it.
    """

    def __init__(self, total: int, *, label: str = "training") -> None:
        super().__init__()
        self._total = total
        self._label = label
        self._success: deque[bool] = deque(maxlen=200)
        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TextColumn("{task.completed:,.0f}/{task.total:,.0f} steps, {task.fields[rate]:,.0f}/s, {task.fields[success]}"),
            TimeRemainingColumn(),
            console=Console(stderr=True),
        )

    def _on_training_start(self) -> None:
        self._start = time.monotonic(), self.num_timesteps
        self._progress.start()
        self._task = self._progress.add_task(
            self._label, total=self._total, completed=self.num_timesteps, rate=0.0, success="no episode yet"
        )

    def _on_step(self) -> bool:
        dones: Any = self.locals.get("dones")
        if dones is not None and dones.any():
            self._success.extend(bool(self.locals["infos"][row].get("is_success")) for row in np.flatnonzero(dones))
        return True

    def _on_rollout_end(self) -> None:
        begun, first = self._start
        rate = (self.num_timesteps - first) / max(time.monotonic() - begun, 1e-9)
        success = f"success {np.mean(self._success):.0%}" if self._success else "no episode yet"
        self._progress.update(self._task, completed=self.num_timesteps, rate=rate, success=success)

    def _on_training_end(self) -> None:
        self._progress.stop()
