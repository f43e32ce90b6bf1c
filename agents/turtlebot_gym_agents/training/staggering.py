"""Environments whose first episodes are at different times, so that a rollout sees all of a course.

Environments that begin together stay together where episodes are alike: on the square all of them turn at the same corner, and
each rollout would teach that corner alone, and let the network forget the others.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.vector import VectorEnv, VectorWrapper
from numpy.typing import NDArray

from turtlebot_gym_agents.policies import Policy

GROUPS = 16
"""Most different times."""


class Staggered(VectorWrapper):
    """Drive the rows of a vector environment for different times, at most ``steps``, after a reset of all of them.

    It resets within the step and knows ``reset_mask``; the policy has no memory.
    """

    def __init__(self, envs: VectorEnv, policy: Policy, steps: int) -> None:
        super().__init__(envs)
        self._policy, self._steps = policy, steps

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Reset all rows and drive them; rows that ``reset_mask`` chooses begin at once."""
        observations, infos = self.env.reset(seed=seed, options=options)
        if options is None or "reset_mask" not in options:
            groups = min(GROUPS, self.num_envs)
            group = np.arange(self.num_envs) % groups
            for number in range(groups):
                for _ in range(self._steps // groups):
                    observations, *_ = self.env.step(self._policy(observations))
                observations, infos = self.env.reset(options={"reset_mask": group == number})
        return observations, infos
