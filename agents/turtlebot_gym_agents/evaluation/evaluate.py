"""Evaluate a policy: one episode per seed, measured by the true pose.

Episode *i* has the seed ``seed + i`` in every evaluation, and noise is drawn by counter. So start, goal and noise are the same
for all policies, and differences between policies are paired.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import registry
from gymnasium.vector import VectorEnv

from turtlebot_gym.config import as_int, choose
from turtlebot_gym.drive import NOWHERE, Drive
from turtlebot_gym.models.random import MAX_SEED
from turtlebot_gym.systems import Parameters
from turtlebot_gym_agents.evaluation import metrics
from turtlebot_gym_agents.evaluation.consistency import Consistent, joined
from turtlebot_gym_agents.evaluation.driving import ROWS, Moment, driven
from turtlebot_gym_agents.evaluation.episodes import Episodes, concatenate, measure, outcome_of
from turtlebot_gym_agents.evaluation.metrics import Interval
from turtlebot_gym_agents.evaluation.record import Recorder
from turtlebot_gym_agents.evaluation.result import Evaluation
from turtlebot_gym_agents.evaluation.surroundings import room_of, scene_of, walkers_of
from turtlebot_gym_agents.ids import arguments_of, environment_id
from turtlebot_gym_agents.policies import Policy, make_policy
from turtlebot_gym_agents.policies.fit import ANYWAY, Mismatch, parameters_of, require_task, require_terms
from turtlebot_gym_agents.policies.policy import shown

ORACLE = "oracle"
"""The name that stands for `oracle.Oracle`."""
BATCH = 1024
"""Number of episodes held in memory at once."""


def paired(first: Evaluation, second: Evaluation) -> Interval:
    """Return the mean paired difference of times of two evaluations with the same seeds, s; a failure counts as the limit.

    Raises:
        ValueError: If their seeds are not the same.
    """
    if not np.array_equal(first.episodes.seed, second.episodes.seed):
        raise ValueError("Evaluations can be compared in pairs only if they have the same seeds.")
    return metrics.mean(first.times() - second.times())


def evaluate(
    policy: str | Path | Policy,
    *,
    env: str = "nav",
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
        env: The id of an environment of this package, or its short name, such as "nav".
        episodes: Number of episodes; episode i has the seed ``seed + i``.
        seed: The first seed.
        progress: Called with the number of episodes that have ended so far.
        allow_mismatch: Whether a policy that was made for another task, observation, robot or rate may drive.
        consistency: Whether to compute the filter's NEES and NIS at each step.
        **options: The environment's, see `turtlebot_gym.Options`.

    Raises:
        ValueError: If an argument is unknown or out of its range.
    """
    as_int("episodes", episodes, 1)
    env, policy = environment_id(env), policy_of(policy)
    require_known(env, seed)
    runs = []
    # In batches, which bound the memory of the record.
    for start, size in batches(episodes, BATCH):
        envs = make_envs(env, min(size, ROWS), **options)
        so_far = lambda ended, start=start: progress(start + ended)  # noqa: E731
        judged = Consistent() if consistency else None
        runs.append((*drive(envs, policy, seed + start, size, so_far, allow_mismatch=allow_mismatch, judge=judged), judged))
        envs.close()
    parts, trajectories, parameters, judges = zip(*runs, strict=True)
    p: Parameters = parameters[0]
    return Evaluation(
        config={"env": env, "policy": policy, "episodes": episodes, "seed": seed, **options},
        limit=p.task.max_steps * p.dt,
        max_linear=p.robot.max_linear,
        episodes=concatenate(parts),
        trajectory=trajectories[0],
        consistency=joined([judge.result(p.dt) for judge in judges]) if consistency else None,
    )


def policy_of(policy: Any) -> str | Policy:
    """Return a policy that is given as such or by name; for a path, or the result of a training or an export, the bundle."""
    if isinstance(policy, Path):
        return str(policy)
    bundle = getattr(policy, "policy", None)
    return str(bundle) if isinstance(bundle, Path) else policy


def make_envs(env: str, num_envs: int, **options: Any) -> VectorEnv:
    """Return environments whose infos hold all that is measured."""
    given = arguments_of(options)
    return gym.make_vec(environment_id(env), num_envs=num_envs, vectorization_mode="vector_entry_point", info="full", **given)


def batches(episodes: int, size: int) -> list[tuple[int, int]]:
    """Return first episode and number of episodes of each batch; results do not depend on the size."""
    return [(start, min(size, episodes - start)) for start in range(0, episodes, size)]


def require_known(env: str, seed: int) -> None:
    """Raise ValueError unless the id or short name is of this package and the seed is valid."""
    as_int("seed", seed, 0, MAX_SEED)
    choose("env", environment_id(env), {spec.id: spec for spec in registry.values() if spec.namespace == "turtlebot_gym"})


def driver_of(policy: str | Policy, envs: gym.Env | VectorEnv, *, allow_mismatch: bool = False) -> Policy:
    """Return a policy; one given by name is made for the environment's robot and control interval.

    Args:
        policy: Its name for `turtlebot_gym_agents.make_policy`, or the policy; in a vector environment also "oracle".
        envs: An environment or a vector environment, made by Gymnasium.
        allow_mismatch: Whether a policy that was made for another task, observation, robot or rate may drive.

    Raises:
        ValueError: If the policy does not match, there is no policy of that name, or the oracle has no room.
    """
    terms: Any = getattr(envs.unwrapped, "observation_terms", ())
    if not isinstance(policy, str):
        return shown(policy, type(policy).__name__, terms) if terms else policy
    if policy == ORACLE and isinstance(envs, VectorEnv):
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
    return shown(driver, policy, terms)


def drive(
    envs: VectorEnv,
    policy: str | Policy,
    seed: int,
    episodes: int,
    progress: Callable[[int], None] = lambda ended: None,
    *,
    allow_mismatch: bool = False,
    judge: Callable[[Moment], None] | None = None,
) -> tuple[Episodes, Drive, Parameters]:
    """Drive episodes.

    Args:
        envs: Vector environment of this package, with ``info="full"``.
        policy: See `evaluate`.
        seed: Seed of the first episode.
        episodes: Number of episodes.
        progress: Called with the number of episodes that have ended so far.
        allow_mismatch: See `driver_of`.
        judge: Called with what `driven` yields.

    Returns:
        The episodes, the first one's trajectory, and the environments' parameters.
    """
    p = parameters_of(envs)
    driver = driver_of(policy, envs, allow_mismatch=allow_mismatch)
    recorder, walkers, around, ended = Recorder(episodes), [], NOWHERE, 0
    for at, moment in enumerate(driven(envs, driver, seed=seed, episodes=episodes)):
        if at == 0:
            around = room_of(envs, policy if isinstance(policy, str) else type(policy).__name__)
        if around.room and len(moment.number) and moment.number[0] == 0:
            walkers.append(walkers_of(scene_of(envs)))
        recorder(moment)
        if judge is not None:
            judge(moment)
        if moment.ended.any():
            ended += int(moment.ended.sum())
            progress(ended)
    record = recorder.result()
    measured = measure(record, p, seed)
    first = replace(record.trajectory(dt=p.dt), around=around, circles=tuple(walkers), outcome=outcome_of(measured))
    return measured, first, p
