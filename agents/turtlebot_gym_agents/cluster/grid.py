"""The file of a study, YAML. Values in ``grid`` may be lists; each combination of them is a cell::

episodes: 2000
seed: 1000000
compare_with: bearing
grid:
  env: turtlebot_gym/TurtleBotNav-v0
  noise: [tutorial, documented]
policies: [bearing, proportional]
trainings:
  ppo: {algo: ppo, seeds: 3, steps: 200000}
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Annotated, Any

from turtlebot_gym import Options
from turtlebot_gym.config import Range, as_int, build, check_fields, choose, short_repr
from turtlebot_gym.files import load
from turtlebot_gym_agents.evaluation.evaluate import require_known
from turtlebot_gym_agents.ids import environment_id
from turtlebot_gym_agents.training.config import TrainingConfig

SETTINGS = ("env", *(item.name for item in fields(Options)))
"""Settings that a grid may hold: the environment's id and its options."""
MAX_SEEDS = 1000
"""Most seeds of a training."""


@dataclass(frozen=True, kw_only=True)
class StudyGrid:
    """Contents of a study. Every policy drives in every cell; every training is repeated in every cell."""

    policies: tuple[str, ...]
    """Names for `turtlebot_gym_agents.make_policy`."""
    grid: Mapping[str, Any] = field(default_factory=dict)
    """Settings by name, each a value or a list of values."""
    trainings: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """Trainings by name: fields of `training.config.TrainingConfig`, and ``seeds``, the number of seeds, from seed 0."""
    compare_with: str = ""
    """Policy whose times are subtracted; by default the first one."""
    episodes: Annotated[int, Range(2, 10**9, whole=True)] = 1000
    """Episodes of each policy in each cell."""
    seed: int = 0
    """Seed of the first episode."""

    def __post_init__(self) -> None:
        check_fields(self, "")
        if not self.policies or not all(isinstance(name, str) for name in self.policies):
            raise ValueError(f"policies must be names, at least one, got {short_repr(list(self.policies))}.")
        object.__setattr__(self, "compare_with", self.compare_with or self.policies[0])
        choose("compare_with", self.compare_with, dict.fromkeys(self.policies))
        for name in self.grid:
            choose("grid", name, dict.fromkeys(SETTINGS))
        for cell in self.cells():
            require_known(cell["env"], self.seed)
            for name in self.trainings:
                self.trainings_of(name, cell)

    def cells(self) -> list[dict[str, Any]]:
        """Return the combinations of settings."""
        names = {"env": "nav", **self.grid}
        cells = [dict(zip(names, values, strict=True)) for values in itertools.product(*map(_listed, names.values()))]
        return [{**cell, "env": environment_id(cell["env"])} for cell in cells]

    def trainings_of(self, name: str, cell: Mapping[str, Any]) -> list[TrainingConfig]:
        """Return the configurations of a training in a cell, one per seed."""
        settings = {**self.trainings[name], **cell}
        seeds = as_int(f"seeds of training {short_repr(name)}", settings.pop("seeds", 1), 1, MAX_SEEDS)
        if "config" in settings:
            settings["config"] = Path(settings["config"])
        return [build(TrainingConfig, {**settings, "seed": seed}, f"training {short_repr(name)}") for seed in range(seeds)]


def read_grid(path: Path) -> StudyGrid:
    """Read a study.

    Raises:
        ValueError: If the file is not YAML, or a field is unknown or invalid; the message names the file.
    """
    content = load(path)
    try:
        if isinstance(content, Mapping) and "policies" in content:
            content = {**content, "policies": tuple(_listed(content["policies"]))}
        return build(StudyGrid, content, "a study")
    except (ValueError, TypeError, AttributeError) as error:
        raise ValueError(f"{path}: {' '.join(str(error).split())}") from error


def _listed(value: Any) -> list[Any]:
    return list(value) if isinstance(value, (list, tuple)) else [value]
