"""Wrappers of scalar environments: a reward of one's own, another sensor, smoother actions."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.utils import RecordConstructorArgs
from numpy.typing import ArrayLike, NDArray

from turtlebot_gym.wrappers.draws import Draws
from turtlebot_gym.wrappers.transition import (
    Moment,
    Transition,
    appended,
    ask,
    doubled,
    longer,
    moment,
    own_seeds,
    require_box,
    require_share,
    seeds_of,
)

_ALL = np.ones(1, np.bool_)


class TransitionReward(gym.Wrapper, RecordConstructorArgs):
    """Reward what a function makes of each step; Gymnasium's `TransformReward` knows the environment's reward alone.

    Args:
        env: The environment.
        reward: Takes a `Transition` and returns a number. It works on rows of a vector environment too if it takes numbers as
            ``info["distance"]`` and ``action[..., 1]``.
    """

    def __init__(self, env: gym.Env, reward: Callable[[Transition], Any]) -> None:
        RecordConstructorArgs.__init__(self, reward=reward, _disable_deepcopy=True)
        gym.Wrapper.__init__(self, env)
        self._reward = reward
        self._before = Moment(None, {})

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin an episode."""
        observation, info = self.env.reset(seed=seed, options=options)
        self._before = moment(observation, info)
        return observation, info

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Make a step."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        after = moment(observation, info)
        transition = Transition(self._before, doubled(action), after, reward, terminated, truncated)
        self._before = after
        return observation, float(ask(self._reward, transition)), terminated, truncated, info


class AppendSensor(gym.Wrapper, RecordConstructorArgs):
    """Append what another sensor says to the observation.

    Its noise depends on seed, episode and step alone, so that a row of `wrappers.vector.AppendSensor` has the same.

    Args:
        env: An environment whose observations are a Box of one dimension.
        measure: ``measure(info, draws)`` returns the sensor's numbers, shape (..., k); ``draws`` are standard normal, shape
            (..., draws). They are clipped to the bounds.
        low: Least values, shape (k,).
        high: Greatest values, shape (k,).
        draws: How many draws it needs in a step, at most 32.

    Raises:
        ValueError: If the observations, the bounds or the number of draws are others.
    """

    def __init__(self, env: gym.Env, measure: Callable[..., Any], *, low: ArrayLike, high: ArrayLike, draws: int = 0) -> None:
        RecordConstructorArgs.__init__(self, measure=measure, low=low, high=high, draws=draws, _disable_deepcopy=True)
        gym.Wrapper.__init__(self, env)
        self._space = self.observation_space = longer(env.observation_space, low, high)
        self._measure, self._draws, self._old = measure, Draws(1, draws), require_box(env.observation_space, "").shape[0]

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin an episode."""
        observation, info = self.env.reset(seed=seed, options=options)
        known = self._draws.seeded or seed is not None
        self._draws.begin(_ALL, seeds_of(seed, 1) if known else own_seeds(self.env, 1))
        return self._with(observation, info), info

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Make a step."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        self._draws.advance(_ALL)
        return self._with(observation, info), reward, terminated, truncated, info

    def _with(self, observation: NDArray[np.float32], info: dict[str, Any]) -> NDArray[np.float32]:
        numbers = appended(self._measure, info, self._draws.now()[0], self._space, self._old)
        return np.concatenate([observation, numbers]).astype(np.float32)


class SmoothAction(gym.Wrapper, RecordConstructorArgs):
    """Let actions through a first-order low-pass filter, which is at zero when an episode begins.

    The environment is given ``last + share (action - last)``: after a jump, 63 % of it within ``1 / share`` steps, nearly.

    Args:
        env: An environment whose actions are a Box.
        share: Share of the difference that each step makes up, in (0, 1]; 1 changes nothing.

    Raises:
        ValueError: If the share is another one, or the actions are no Box.
    """

    def __init__(self, env: gym.Env, share: float) -> None:
        RecordConstructorArgs.__init__(self, share=share)
        gym.Wrapper.__init__(self, env)
        self._share = require_share(share)
        self._last: Any = np.zeros_like(require_box(env.action_space, "action").low)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin an episode."""
        self._last = np.zeros_like(self._last)
        return self.env.reset(seed=seed, options=options)

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Make a step."""
        self._last = self._last + self._last.dtype.type(self._share) * (np.asarray(action, self._last.dtype) - self._last)
        return self.env.step(self._last)
