"""A training's configuration and curves on Weights & Biases, the extra [wandb]."""

from __future__ import annotations

import uuid
from collections.abc import Mapping
from importlib import import_module
from numbers import Real
from pathlib import Path
from typing import Any

from stable_baselines3.common.logger import KVWriter

from turtlebot_gym.files import read_text, write_text
from turtlebot_gym_agents.provenance import provenance
from turtlebot_gym_agents.training.callbacks import Callback
from turtlebot_gym_agents.training.config import TrainingConfig

PROJECT = "turtlebot-gym"
"""Default name of the project."""
RUN_FILE = "wandb-run"
"""File in a training's folder with its run's id, which a resumed training reads."""


class WandbCallback(Callback):
    """Send what Stable-Baselines3 logs, TensorBoard's curves, to a run of Weights & Biases.

    wandb reads its own environment variables: with ``WANDB_MODE=offline`` nothing leaves the machine, and ``wandb sync``
    uploads the run later.

    Args:
        config: Configuration of the training, which becomes the run's.
        folder: The training's folder; wandb's files go to ``wandb`` in it.
        project: The project's name.

    Raises:
        ModuleNotFoundError: If wandb is not installed.
    """

    def __init__(self, config: TrainingConfig, folder: Path, *, project: str = PROJECT) -> None:
        super().__init__()
        self._wandb: Any = import_module("wandb")
        self._config, self._folder, self._project = config, folder, project
        self._run: Any = None

    def _on_training_start(self) -> None:
        self._run = self._wandb.init(
            project=self._project,
            name=self._config.title,
            id=_run_id(self._folder / RUN_FILE),
            resume="allow",
            dir=str(self._folder),
            config={**self._config.settings(), **provenance()},
        )
        for name, best in (("return", "max"), ("success", "max"), ("steps_to_end", "min")):
            self._run.define_metric(f"eval/{name}", summary=best)
        self.logger.output_formats.append(_Writer(self._run))

    def _on_training_end(self) -> None:
        formats = self.logger.output_formats
        formats[:] = [output for output in formats if not isinstance(output, _Writer)]
        self._run.finish()


class _Writer(KVWriter):
    """A run as an output of Stable-Baselines3's logger."""

    def __init__(self, run: Any) -> None:
        self._run = run

    def write(self, key_values: Mapping[str, Any], key_excluded: Mapping[str, Any], step: int = 0) -> None:
        self._run.log({name: float(value) for name, value in key_values.items() if isinstance(value, Real)}, step=step)

    def close(self) -> None:
        """Leave the run open: the callback ends it."""


def _run_id(path: Path) -> str:
    """Return the id of the run in a file, which is written if missing."""
    if not path.is_file():
        write_text(path, uuid.uuid4().hex[:8] + "\n")
    return read_text(path).strip()
