"""A study: policies and trainings in every combination of settings, on the same episodes, with intervals.

A study is a YAML file. Values in ``grid`` may be lists; each combination is a cell. Every policy drives in every cell. Each
training is repeated in each cell with several seeds, and its results include the variation between the trained policies::

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
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from turtlebot_gym.files import load
from turtlebot_gym.validation import shown, whole
from turtlebot_gym_agents.cluster.drives import CHUNK, DriveUnit, drives, evaluation
from turtlebot_gym_agents.cluster.trainings import Training
from turtlebot_gym_agents.cluster.units import Result, Runner, Unit, complete
from turtlebot_gym_agents.evaluation.comparison import compare
from turtlebot_gym_agents.evaluation.evaluate import NAV, Evaluation, paired, require_known
from turtlebot_gym_agents.evaluation.metrics import holm
from turtlebot_gym_agents.training.config import TrainingConfig

SETTINGS = (
    "env", "robot", "noise", "filter", "observation", "arrival", "delay", "fix", "imu", "localizer", "world", "lidar", "switch",
    "laps",
)  # fmt: skip
"""Settings that a grid may hold: arguments of environments."""

MAX_SEEDS = 1000
"""Most seeds of a training."""


@dataclass(frozen=True, kw_only=True)
class Grid:
    """Contents of a study."""

    grid: Mapping[str, Any] = field(default_factory=dict)
    """Settings by name, each a value or a list of values."""
    policies: tuple[str, ...] = ()
    """Names for `turtlebot_gym_agents.make_policy`."""
    trainings: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """Trainings by name: fields of `training.config.TrainingConfig`, and ``seeds``, the number of seeds, from seed 0."""
    compare_with: str | None = None
    """Policy whose times are subtracted; by default the first one."""
    episodes: int = 1000
    """Episodes of each policy in each cell."""
    seed: int = 0
    """Seed of the first episode."""
    chunk: int = CHUNK
    """Episodes of a unit of work; results do not depend on it."""

    def __post_init__(self) -> None:
        if not self.policies:
            raise ValueError("policies must name at least one.")
        if not all(isinstance(name, str) for name in self.policies):
            raise ValueError(f"policies must be names, got {shown(list(self.policies))}.")
        for name, value in (("grid", self.grid), ("trainings", self.trainings)):
            if not isinstance(value, Mapping):
                raise ValueError(f"{name} must be a mapping, got {shown(value)}.")
        for name, settings in self.trainings.items():
            if not isinstance(settings, Mapping):
                raise ValueError(f"training {shown(name)} must be a mapping of its settings, got {shown(settings)}.")
            whole(f"seeds of training {shown(name)}", settings.get("seeds", 1), 1, MAX_SEEDS)
        if self.baseline not in self.policies:
            raise ValueError(f"compare_with must be one of policies, {', '.join(self.policies)}, got {self.compare_with!r}.")
        for name in ("episodes", "chunk"):
            whole(name, getattr(self, name), 2)
        if unknown := [str(name) for name in self.grid if name not in SETTINGS]:
            raise ValueError(f"grid must hold settings, {', '.join(SETTINGS)}, got {', '.join(unknown)}.")
        for env in _listed(self.grid.get("env", NAV)):
            require_known(env, self.seed)

    @property
    def baseline(self) -> str:
        """Return the policy with which the others are compared."""
        return self.compare_with or self.policies[0]

    def cells(self) -> list[dict[str, Any]]:
        names = {"env": NAV, **self.grid}
        return [dict(zip(names, values, strict=True)) for values in itertools.product(*map(_listed, names.values()))]

    def trainings_of(self, name: str, cell: Mapping[str, Any]) -> list[Training]:
        """Return the units of a training in a cell, one per seed."""
        settings = {**self.trainings[name], **cell}
        seeds = settings.pop("seeds", 1)
        allowed = {item.name for item in fields(TrainingConfig) if item.init} - {"seed"}
        if unknown := [str(setting) for setting in settings if setting not in allowed]:
            raise ValueError(
                f"training {name!r} has no fields {', '.join(unknown)}; known fields are {', '.join(sorted(allowed))}."
            )
        if "config" in settings:
            if not isinstance(settings["config"], str):
                raise ValueError(f"config of training {name!r} must be the name of a file, got {shown(settings['config'])}.")
            settings["config"] = Path(settings["config"])
        return [Training.of(TrainingConfig(**settings, seed=seed)) for seed in range(seeds)]

    def drives_of(self, policy: str, cell: Mapping[str, Any], *, bundle: bytes | None = None) -> list[DriveUnit]:
        """Return the units of a policy's evaluation in a cell; the policy may be the content of a bundle."""
        files = None if bundle is None else {policy: {Path(policy).name: bundle}}
        return drives(policy, **cell, episodes=self.episodes, seed=self.seed, chunk=self.chunk, files=files)


def read_grid(path: Path) -> Grid:
    """Read a study.

    Raises:
        ValueError: If the file is not YAML, or a field is unknown or invalid; the message names the file.
    """
    content = load(path)
    try:
        allowed = [item.name for item in fields(Grid)]
        unknown = [str(name) for name in content if name not in allowed] if isinstance(content, Mapping) else [shown(content)]
        if unknown:
            raise ValueError(f"a study must hold {', '.join(allowed)}, got {', '.join(unknown)}.")
        return Grid(**{**content, "policies": tuple(_listed(content.get("policies", ())))})
    except (ValueError, TypeError, AttributeError) as error:
        raise ValueError(f"{path}: {' '.join(str(error).split())}") from error


def study(
    grid: Grid,
    *,
    runner: Runner = complete,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> list[dict[str, Any]]:
    """Return the results of policies and trainings in each cell.

    Args:
        grid: The study.
        runner: Runs the units of work; an interrupted study resumes from its store.
        progress: Called with the work done and the total, as counted by `units.Unit.size`, for trainings and then for episodes.

    Returns:
        Per cell its setting; per policy a summary and the paired difference of times to the baseline, s; per training the
        result of `evaluation.comparison.compare`, with p-values corrected over the whole study (Holm).
    """

    def run(units: Iterable[Unit]) -> list[Result]:
        work = list(units)
        total = sum(unit.size for unit in work)
        return runner(work, lambda done: progress(done, total))

    cells = grid.cells()
    trained = {
        (at, f"{name}/seed-{seed}.onnx"): unit
        for at, cell in enumerate(cells)
        for name in grid.trainings
        for seed, unit in enumerate(grid.trainings_of(name, cell))
    }
    learned = dict(zip(trained, run(trained.values()), strict=True))
    driven = {(at, policy): grid.drives_of(policy, cell) for at, cell in enumerate(cells) for policy in grid.policies}
    for (at, label), result in learned.items():
        driven[at, label] = grid.drives_of(label, cells[at], bundle=result.files["policy.onnx"])
    # All units at once, so that no worker waits for a cell.
    results = iter(run(itertools.chain(*driven.values())))
    evaluations: dict[tuple[int, str], Evaluation] = {}
    for (at, policy), units in driven.items():
        config = {**cells[at], "policy": policy, "episodes": grid.episodes, "seed": grid.seed}
        evaluations[at, policy] = evaluation([next(results) for _ in units], config)
    rows = [_row(grid, at, cell, evaluations) for at, cell in enumerate(cells)]
    compared = [comparison for row in rows for comparison in row["trainings"].values() if "p" in comparison]
    for comparison, p in zip(compared, holm([comparison["p"] for comparison in compared]), strict=True):
        comparison["p_holm"] = p
    return rows


def _row(grid: Grid, at: int, cell: Mapping[str, Any], evaluations: Mapping[tuple[int, str], Evaluation]) -> dict[str, Any]:
    baseline = evaluations[at, grid.baseline]
    policies = {policy: _beside(evaluations[at, policy], baseline) for policy in grid.policies}
    trainings = {}
    for name in grid.trainings:
        learned = [
            result for (where, label), result in evaluations.items() if where == at and label.startswith(f"{name}/seed-")
        ]
        if len(learned) > 1:
            trainings[name] = compare(learned, baseline)
        else:  # a single training says nothing about the spread of trainings: treat it as a policy
            policies[name] = _beside(learned[0], baseline)
    return {"setting": dict(cell), "compared_with": grid.baseline, "policies": policies, "trainings": trainings}


def _beside(result: Evaluation, baseline: Evaluation) -> dict[str, Any]:
    return {**result.summary(), "difference": paired(result, baseline)}


def _listed(value: Any) -> list[Any]:
    return list(value) if isinstance(value, (list, tuple)) else [value]
