"""Episodes with which a training judges its policy: one for each seed, in few rows, each of which takes the next free seed.

With a row for each episode, all rows would be stepped until the longest episode ends. In rooms that is 600 steps, where an
episode takes 170.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray

from turtlebot_gym_agents.policies import Policy


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
    """Drive episodes, each the first one of its seed.

    Args:
        envs: Vector environment in the mode SAME_STEP.
        policy: A policy without a memory.
        seed: Seed of the first episode; the i-th after it has the seed ``seed + i``.
        episodes: Number of episodes.
    """
    judged = Judged(np.zeros(episodes, np.bool_), np.zeros(episodes), np.zeros(episodes, np.int64))
    observations, _ = envs.reset(seed=seed)
    number = np.arange(envs.num_envs)  # of the episode that each row drives; beyond the last one it is done
    begun = envs.num_envs
    while (running := number < episodes).any():
        observations, rewards, terminated, truncated, infos = envs.step(policy(observations))
        driven = number[running]
        judged.returns[driven] += rewards[running]
        judged.steps[driven] += 1
        over = np.flatnonzero(running & (terminated | truncated))
        if len(over) == 0:
            continue
        judged.success[number[over]] = infos["final_info"]["is_success"][over]
        number[over] = np.arange(begun, begun + len(over))
        begun += len(over)
        again = np.zeros(envs.num_envs, np.bool_)
        again[over] = number[over] < episodes
        if again.any():
            seeds: Any = [seed + int(at) if begins else None for at, begins in zip(number, again, strict=True)]
            observations, _ = envs.reset(seed=seeds, options={"reset_mask": again})
    return judged
