"""A filter's doubts of its own model in ``info``, as the ROS node's diagnostics show them."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
from gymnasium.utils import RecordConstructorArgs

from turtlebot_gym.envs.navigation import NavigationEnv
from turtlebot_gym.estimation.doubt import Doubt
from turtlebot_gym.parameters import DeadReckoning, Noise


class ModelDoubts(gym.Wrapper, RecordConstructorArgs):
    """Add what the last ten seconds say of the filter's model to ``info``.

    Keys: ``mean_nis`` (mean normalized innovation squared), ``position_misfit`` and ``heading_misfit`` (mean squared residuals
    of the poses against the twists, in variances: 1 if the noise is as assumed), all NaN for the first seconds, and ``doubt``,
    the fault as a text, empty if there is none.

    Args:
        env: A scalar environment of this package.
        noise: Noise that the filter assumes; None for that of the environment.
    """

    def __init__(self, env: gym.Env, noise: Noise | None = None) -> None:
        RecordConstructorArgs.__init__(self, noise=noise)
        gym.Wrapper.__init__(self, env)
        if not isinstance(env.unwrapped, NavigationEnv):
            raise ValueError(f"env must be a scalar environment of turtlebot_gym, got {env.unwrapped!r}.")
        self._inner, p = env.unwrapped, env.unwrapped.parameters
        degrees = 0 if isinstance(p.tuning.kind, DeadReckoning) else 3
        self._dt, self._doubt = p.dt, Doubt(p.noise if noise is None else noise, degrees=degrees)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        observation, info = self.env.reset(seed=seed, options=options)
        self._doubt.begin()
        return observation, self._judged(info, 0.0)

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        observation, reward, terminated, truncated, info = self.env.step(action)
        return observation, reward, terminated, truncated, self._judged(info, self._dt)

    def _judged(self, info: dict[str, Any], dt: float) -> dict[str, Any]:
        world = self._inner.snapshot()
        found = self._doubt.add(dt, world.senses.odometry, world.estimate.nis)
        return info | {
            "mean_nis": found.nis,
            "position_misfit": found.position,
            "heading_misfit": found.heading,
            "doubt": found.cause,
        }
