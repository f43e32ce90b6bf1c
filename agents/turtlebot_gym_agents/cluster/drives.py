"""Evaluations in units of a few episodes each."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

import turtlebot_gym.drives
from turtlebot_gym.validation import whole
from turtlebot_gym_agents.cluster.attachments import Attachments, attach, hashes, placed, unpacked
from turtlebot_gym_agents.cluster.units import Result, Runner, complete
from turtlebot_gym_agents.evaluation.episodes import Episodes, concatenate
from turtlebot_gym_agents.evaluation.evaluate import NAV, Evaluation, batches, drive, make_envs, require_known
from turtlebot_gym_agents.evaluation.metrics import Errors
from turtlebot_gym_agents.provenance import plain

ROWS = ("time", "true_state", "odometry", "estimate", "covariance", "reference", "command", "clearance")
"""Columns of a trajectory that a unit returns."""
CHUNK = 250
"""Episodes per unit, whatever the number of workers: stored units are found again."""


@dataclass(frozen=True, kw_only=True)
class DriveUnit:
    """Some episodes of a policy, one per seed: a unit of work, see `units`."""

    policy: str
    """A name for `turtlebot_gym_agents.make_policy`, or "oracle"."""
    env: str
    """Environment id."""
    seed: int
    """Seed of the first episode."""
    episodes: int
    """Number of episodes."""
    options: Mapping[str, Any] = field(default_factory=dict)
    """Arguments of the environment."""
    files: Attachments = field(default_factory=dict)
    """Files that policy and options name."""
    trajectory: bool = False
    """Whether to record the first episode's trajectory."""
    allow_mismatch: bool = False
    """Whether a policy made for another task, observation, robot or rate may drive."""
    memory = 500 * 2**20

    @property
    def size(self) -> int:
        return self.episodes

    def about(self) -> dict[str, Any]:
        settings = {name: value for name, value in vars(self).items() if name != "files"}
        return {"drive": plain(settings), "files": hashes(self.files)}

    def run(self) -> Result:
        with unpacked(self.files) as places:
            options = {name: placed(value, places) for name, value in self.options.items()}
            envs = make_envs(self.env, self.episodes, **options)
            episodes, trajectory, p = drive(envs, placed(self.policy, places), self.seed, allow_mismatch=self.allow_mismatch)
            envs.close()
        arrays = dict(_columns(episodes))
        if self.trajectory:
            arrays |= {f"trajectory.{name}": getattr(trajectory, name) for name in ROWS}
        return Result({"limit": p.task.max_steps * p.dt, "max_linear": p.robot.max_linear}, arrays, {}, {})


def drives(
    policy: str,
    *,
    env: str,
    episodes: int,
    seed: int,
    chunk: int = CHUNK,
    files: Attachments | None = None,
    allow_mismatch: bool = False,
    **options: Any,
) -> list[DriveUnit]:
    """Return the units of an evaluation.

    Args:
        policy: See `evaluation.evaluate.evaluate`.
        env: Environment id.
        episodes: Number of episodes.
        seed: Seed of the first episode.
        chunk: Episodes per unit.
        files: Files that policy and options name, if they do not exist on this machine.
        allow_mismatch: See `evaluation.evaluate.evaluate`.
        **options: Arguments of the environment.
    """
    carried = {**attach(policy, *options.values()), **(files or {})}
    common = {"policy": policy, "env": env, "options": options, "files": carried, "allow_mismatch": allow_mismatch}
    return [
        DriveUnit(**common, seed=seed + start, episodes=size, trajectory=start == 0) for start, size in batches(episodes, chunk)
    ]


def evaluation(results: Sequence[Result], config: Mapping[str, Any]) -> Evaluation:
    """Combine the results of `drives` into one, as `evaluation.evaluate.evaluate` returns it."""
    first = results[0]
    rows: dict[str, Any] = {name: first.arrays[f"trajectory.{name}"] for name in ROWS if f"trajectory.{name}" in first.arrays}
    return Evaluation(
        config=dict(config),
        limit=first.facts["limit"],
        max_linear=first.facts["max_linear"],
        episodes=concatenate(list(map(_episodes, results))),
        trajectory=turtlebot_gym.drives.Drive(**rows),
    )


def evaluate_all(
    requests: Sequence[Mapping[str, Any]],
    *,
    runner: Runner = complete,
    progress: Callable[[int], None] = lambda done: None,
) -> list[Evaluation]:
    """Return several evaluations, split into units.

    Args:
        requests: Arguments of `evaluation.evaluate.evaluate`, with policies by name.
        runner: Runs the units of work.
        progress: Called with the number of episodes driven.
    """
    configs = [{"env": NAV, "episodes": 1000, "seed": 0, **request} for request in requests]
    for config in configs:
        whole("episodes", config["episodes"], 1)
        require_known(config["env"], config["seed"])
    parts = [drives(**config) for config in configs]
    results = iter(runner([unit for part in parts for unit in part], progress))
    evaluations = []
    for part, config in zip(parts, configs, strict=True):
        head = {name: config.pop(name) for name in ("env", "policy", "episodes", "seed")}
        config.pop("allow_mismatch", None)  # which `evaluate` does not record either
        evaluations.append(evaluation([next(results) for _ in part], head | config))
    return evaluations


def _columns(episodes: Episodes) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the numbers of episodes by name; those in `Errors` as "field.name"."""
    for name, value in episodes._asdict().items():
        if isinstance(value, Errors):
            yield from ((f"{name}.{part}", numbers) for part, numbers in value._asdict().items())
        else:
            yield name, value


def _episodes(result: Result) -> Episodes:
    arrays = result.arrays
    errors = {name: Errors(*(arrays[f"{name}.{part}"] for part in Errors._fields)) for name in ("estimate", "odometry")}
    values: dict[str, Any] = {**arrays, **errors}
    return Episodes(**{name: values[name] for name in Episodes._fields})
