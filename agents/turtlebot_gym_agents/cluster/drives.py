"""Evaluations in jobs of many episodes each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from turtlebot_gym.config import as_int
from turtlebot_gym_agents.cluster.workers import run
from turtlebot_gym_agents.evaluation.consistency import joined
from turtlebot_gym_agents.evaluation.episodes import concatenate
from turtlebot_gym_agents.evaluation.evaluate import batches, evaluate, require_known
from turtlebot_gym_agents.evaluation.result import Evaluation

CHUNK = 250
"""Episodes of a job; results do not depend on it."""


def evaluate_all(
    requests: Sequence[Mapping[str, Any]], *, cluster: str | None = None, workers: int | None = None, chunk: int = CHUNK
) -> list[Evaluation]:
    """Return several evaluations, split into jobs.

    Args:
        requests: Arguments of `evaluation.evaluate.evaluate`: policy (a name), env, episodes, seed and options.
        cluster: Where the jobs run, as for `workers.run`.
        workers: Number of processes.
        chunk: Episodes of a job.
    """
    jobs = []
    for request in requests:
        as_int("episodes", request["episodes"], 1)
        require_known(request["env"], request["seed"])
        for start, size in batches(request["episodes"], chunk):
            jobs.append(partial(evaluate, **{**request, "seed": request["seed"] + start, "episodes": size}))
    parts = iter(run(jobs, cluster=cluster, workers=workers))
    return [_joined([next(parts) for _ in batches(request["episodes"], chunk)]) for request in requests]


def _joined(parts: Sequence[Evaluation]) -> Evaluation:
    config = {**parts[0].config, "episodes": sum(part.config["episodes"] for part in parts)}
    judged = [part.consistency for part in parts if part.consistency is not None]
    episodes = concatenate([part.episodes for part in parts])
    return replace(parts[0], config=config, episodes=episodes, consistency=joined(judged) if judged else None)
