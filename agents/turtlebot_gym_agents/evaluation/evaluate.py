"""Evaluate a policy: one episode per seed, measured by the true pose.

Episode *i* has the seed ``seed + i`` in every evaluation, and noise is drawn by counter. So start, goal and noise are the same
for all policies, and differences between policies are paired.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import registry
from gymnasium.vector import VectorEnv

from turtlebot_gym.config import as_int, choose
from turtlebot_gym.models.random import MAX_SEED
from turtlebot_gym.observations import TERMS, TRACKS
from turtlebot_gym.observations.reading import read_items
from turtlebot_gym_agents.evaluation import metrics
from turtlebot_gym_agents.evaluation.driving import ROWS, ROWS_IN_ROOMS, driven
from turtlebot_gym_agents.evaluation.episodes import concatenate, measure
from turtlebot_gym_agents.evaluation.metrics import Interval
from turtlebot_gym_agents.evaluation.record import Consistency, Recorder
from turtlebot_gym_agents.evaluation.result import Evaluation
from turtlebot_gym_agents.front.results import name_of
from turtlebot_gym_agents.ids import arguments_of, brought_by, environment_id
from turtlebot_gym_agents.policies import Policy, make_policy
from turtlebot_gym_agents.policies.fit import ANYWAY, MISSIONS, ROOMS, Mismatch, parameters_of, require_task, require_terms
from turtlebot_gym_agents.policies.policy import shown, terms_of

ORACLE = "oracle"
"""The name that stands for `oracle.Oracle`."""
WHEEL = "wheel"
"""The noise of policies that read tracks, unless another one is given."""
BATCH = 1024
"""Number of episodes held in memory at once."""


def paired(first: Evaluation, second: Evaluation) -> Interval:
    """Return the mean paired difference of times of two evaluations with the same seeds, s; a failure counts as the limit."""
    if not np.array_equal(first.episodes.seed, second.episodes.seed):
        raise ValueError("Evaluations can be compared in pairs only if they have the same seeds.")
    return metrics.mean(first.times() - second.times())


def evaluate(
    policy: str | Path | Policy,
    *,
    env: str | None = None,
    episodes: int = 1000,
    seed: int = 0,
    progress: Callable[[int], None] = lambda ended: None,
    allow_mismatch: bool = False,
    consistency: bool = False,
    **options: Any,
) -> Evaluation:
    """Drive and measure one episode per seed.

    Args:
        policy: A name or a bundle for `turtlebot_gym_agents.make_policy`, a policy, what `train` or `export` returned, or
            "oracle", which in rooms knows map and true pose.
        env: The id of an environment of this package, or its short name, such as "nav"; None for rooms where the options name
            a world or a LiDAR, otherwise for nav.
        episodes: Number of episodes; episode i has the seed ``seed + i``.
        seed: The first seed.
        progress: Called with the number of episodes that have ended so far.
        allow_mismatch: Whether a policy that was made for another task, observation, robot or rate may drive.
        consistency: Whether to compute the filter's NEES and NIS at each step.
        **options: The environment's, see `turtlebot_gym.Options`. Without ``observation``, it has the terms that the policy
            names beside those of the task.

    Raises:
        ValueError: If an argument is unknown or out of its range.
    """
    as_int("episodes", episodes, 1)
    env, policy = environment_id(env, options), policy_of(policy)
    require_known(env, seed)
    parts, rows = [], ROWS_IN_ROOMS if env in (ROOMS, MISSIONS) else ROWS
    for first in range(0, episodes, BATCH):
        size = min(BATCH, episodes - first)
        with driving(policy, env, min(size, rows), allow_mismatch=allow_mismatch, **options) as (envs, driver):
            config = {"env": env, "policy": policy, "episodes": size, "seed": seed + first, **chosen_in(envs), **options}
            so_far = lambda ended, first=first: progress(first + ended)  # noqa: E731
            parts.append(_driven(envs, driver, config, so_far, consistency=consistency))
    return joined(parts)


def _driven(
    envs: VectorEnv, driver: Policy, config: dict[str, Any], progress: Callable[[int], None], *, consistency: bool
) -> Evaluation:
    """Drive the episodes of a batch."""
    p, recorder, ended = parameters_of(envs), Recorder(consistency=consistency), 0
    for moment in driven(envs, driver, seed=config["seed"], episodes=config["episodes"]):
        recorder(moment)
        if moment.ended.any():
            ended += int(moment.ended.sum())
            progress(ended)
    record = recorder.result()
    return Evaluation(
        config=config,
        limit=p.task.max_steps * p.dt,
        max_linear=p.robot.max_linear,
        episodes=measure(record, p, config["seed"]),
        consistency=record.consistency(p.dt) if consistency else None,
    )


def joined(parts: Sequence[Evaluation]) -> Evaluation:
    """Return the evaluation of several batches of episodes, one after the other; results do not depend on their size."""
    judged = [part.consistency for part in parts if part.consistency is not None]
    return replace(
        parts[0],
        config={**parts[0].config, "episodes": sum(part.config["episodes"] for part in parts)},
        episodes=concatenate([part.episodes for part in parts]),
        consistency=Consistency.joined(judged) if judged else None,
    )


def policy_of(policy: Any) -> str | Policy:
    """Return a policy that is given as such or by name; for a path, or the result of a training or an export, the bundle."""
    if isinstance(policy, Path):
        return str(policy)
    bundle = getattr(policy, "policy", None)
    return str(bundle) if isinstance(bundle, Path) else policy


@contextmanager
def driving(
    policy: str | Policy, env: str, num_envs: int, *, allow_mismatch: bool = False, **options: Any
) -> Iterator[tuple[VectorEnv, Policy]]:
    """Yield environments whose infos hold all that is measured, and a policy, which is made for them if it is given by name.

    If the options name no observation, it has the terms that the policy reads beside those of the task, and if they name no
    noise, one that these terms need. A bundle gets only the package's terms so: a file names no code to run.
    """
    given = {"vectorization_mode": "vector_entry_point", "info": "full", **arguments_of(options)}
    with closing(gym.make_vec(env, num_envs=num_envs, **given)) as envs:
        made, terms = _made_for(policy, envs, allow_mismatch), getattr(envs.unwrapped, "observation_terms", ())
        is_bundle = getattr(made, "card", None) is not None
        lacks = [term for term in terms_of(made) or () if terms and term not in terms and (term.name in TERMS or not is_bundle)]
        if not lacks or options.get("observation") is not None:
            yield envs, shown(made, name_of(policy), terms) if terms else made
            return
    _, items = read_items(brought_by(env).get("observation", "ekf"))
    options["observation"] = (*items, *(term.spelled for term in lacks))
    if TRACKS in lacks and options.get("noise") is None:
        needs = f"{name_of(policy)} reads tracks, which need wheel odometry: it drives with noise={WHEEL!r}."
        warnings.warn(needs, stacklevel=2)
        options["noise"] = WHEEL
    with driving(policy, env, num_envs, allow_mismatch=allow_mismatch, **options) as made:
        yield made


def chosen_in(envs: VectorEnv) -> dict[str, Any]:
    """Return the noise of environments that `driving` chose, or was given, if any."""
    noise = envs.spec.kwargs.get("noise") if envs.spec else None
    return {} if noise is None else {"noise": noise}


def require_known(env: str, seed: int) -> None:
    """Raise ValueError unless the id or short name is of this package and the seed is valid."""
    as_int("seed", seed, 0, MAX_SEED)
    choose("env", environment_id(env), {spec.id: spec for spec in registry.values() if spec.namespace == "turtlebot_gym"})


def _made_for(policy: str | Policy, envs: VectorEnv, allow_mismatch: bool) -> Policy:
    """Return a policy; one given by name is made for the environment, and refused where it does not match."""
    if not isinstance(policy, str):
        return policy
    if policy == ORACLE:
        from turtlebot_gym_agents.evaluation.oracle import Oracle  # slow to import

        return Oracle(envs)
    p = parameters_of(envs)
    try:
        driver = make_policy(policy, robot=p.robot, dt=p.dt, noise=p.noise, allow_mismatch=allow_mismatch)
    except Mismatch as error:
        raise Mismatch(f"{error} {ANYWAY}") from error
    if envs.spec is not None:
        require_terms(driver, policy, envs.spec.id)
        if not allow_mismatch:
            require_task(driver, policy, envs.spec.id, p.observed.name.lower())
    return driver
