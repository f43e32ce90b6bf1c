"""The driver of episodes, for evaluations and trainings: few rows, each of which takes the next free seed.

An episode depends on its seed alone, not on its row. With a row for each, all would be stepped until the longest ends.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray

from turtlebot_gym_agents.policies import Policy, PolicyWithMemory

ROWS, ROWS_IN_ROOMS = 64, 32
"""Most environments that drive episodes at the same time, on open ground and in rooms, where policies take longer: all of them
are looked at until the last episode ends."""


class Moment(NamedTuple):
    """The start of some episodes, or a step of others."""

    info: dict[str, Any]
    """The environments' info, a row for each."""
    rewards: NDArray[np.float64]
    """Shape (rows,)."""
    rows: NDArray[np.intp]
    """Rows whose episode begins here, or has taken this step."""
    number: NDArray[np.intp]
    """Number of the episode of each of these rows."""
    is_start: bool
    ended: NDArray[np.bool_]
    """Of each of these rows, whether its episode has ended with this step."""


def driven(envs: VectorEnv, policy: Policy, *, seed: int, episodes: int) -> Iterator[Moment]:
    """Drive episodes, each the first one of its seed, from ``seed`` on, and yield their starts and steps."""
    rows = envs.num_envs
    observations, info = envs.reset(seed=seed)
    number, begun = np.arange(rows), rows  # of the episode that each row drives; beyond the last one it is done
    remembers = policy if isinstance(policy, PolicyWithMemory) else None
    if remembers is not None:
        remembers.reset(np.ones(rows, np.bool_))
    at = np.flatnonzero(number < episodes)
    actions = np.zeros((rows, 2), np.float32)
    yield Moment(info, np.zeros(rows), at, number[at], True, np.zeros(len(at), np.bool_))
    while len(at):
        shown = slice(None) if remembers is not None or len(at) == rows else at
        actions[shown] = policy(observations[shown])
        observations, rewards, terminated, truncated, info = envs.step(actions)
        ended = (terminated | truncated)[at]
        yield Moment(info, rewards, at, number[at], False, ended)
        if not ended.any():
            continue
        over = at[ended]
        number[over] = np.arange(begun, begun + len(over))
        begun += len(over)
        at = np.flatnonzero(number < episodes)
        again = np.zeros(rows, np.bool_)
        again[over] = number[over] < episodes
        if again.any():
            seeds: Any = [seed + int(next_) if begins else None for next_, begins in zip(number, again, strict=True)]
            observations, info = envs.reset(seed=seeds, options={"reset_mask": again})
            if remembers is not None:
                remembers.reset(again)
            new = np.flatnonzero(again)
            yield Moment(info, np.zeros(rows), new, number[new], True, np.zeros(len(new), np.bool_))


class Judged(NamedTuple):
    """What a policy reached in each episode; all of shape (n,), in the order of their seeds."""

    success: NDArray[np.bool_]
    returns: NDArray[np.float64]
    steps: NDArray[np.int64]

    def figures(self) -> dict[str, float]:
        """Return success rate, mean return and mean length in steps."""
        means = (float(column.mean()) for column in self)
        return dict(zip(("success", "return", "steps_to_end"), means, strict=True))


def judge(envs: VectorEnv, policy: Policy, *, seed: int, episodes: int) -> Judged:
    """Return what a policy reaches in episodes; the arguments are those of `driven`."""
    judged = Judged(np.zeros(episodes, np.bool_), np.zeros(episodes), np.zeros(episodes, np.int64))
    for moment in driven(envs, policy, seed=seed, episodes=episodes):
        if not moment.is_start:
            judged.returns[moment.number] += moment.rewards[moment.rows]
            judged.steps[moment.number] += 1
        if moment.ended.any():
            last = moment.info.get("final_info", moment.info)  # in the mode SAME_STEP
            judged.success[moment.number[moment.ended]] = last["is_success"][moment.rows[moment.ended]]
    return judged
