"""Wrappers of scalar environments: a custom reward, smoother actions."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.utils import RecordConstructorArgs

from turtlebot_gym.wrappers.common import SHARE, Moment, Transition, ask, doubled, moment, require_box


class TransitionReward(gym.Wrapper, RecordConstructorArgs):
    """Compute the reward from each whole transition; Gymnasium's `TransformReward` sees only the environment's reward.

    Args:
        env: The environment.
        reward: A function of a `Transition` that returns a number. It also works on rows of a vector environment if it indexes
            as in ``info["distance"]`` and ``action[..., 1]``.
    """

    def __init__(self, env: gym.Env, reward: Callable[[Transition], Any]) -> None:
        RecordConstructorArgs.__init__(self, reward=reward, _disable_deepcopy=True)
        gym.Wrapper.__init__(self, env)
        self._reward = reward
        self._before = Moment(None, {})

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        observation, info = self.env.reset(seed=seed, options=options)
        self._before = moment(observation, info)
        return observation, info

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        observation, reward, terminated, truncated, info = self.env.step(action)
        after = moment(observation, info)
        transition = Transition(self._before, doubled(action), after, reward, terminated, truncated)
        self._before = after
        return observation, float(ask(self._reward, transition)), terminated, truncated, info


class SmoothAction(gym.Wrapper, RecordConstructorArgs):
    """Pass actions through a first-order low-pass filter, which is at zero when an episode begins.

    The environment receives ``last + share (action - last)``: a jump reaches about 63 % within ``1 / share`` steps.

    Args:
        env: An environment whose actions are a Box.
        share: Share of the difference that each step makes up, in (0, 1]; 1 changes nothing.

    Raises:
        ValueError: If the share is out of its range, or the actions are not a Box.
    """

    def __init__(self, env: gym.Env, share: float) -> None:
        RecordConstructorArgs.__init__(self, share=share)
        gym.Wrapper.__init__(self, env)
        self._share = SHARE.check("share", share)
        self._last: Any = np.zeros_like(require_box(env.action_space, "action").low)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        self._last = np.zeros_like(self._last)
        return self.env.reset(seed=seed, options=options)

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        self._last = self._last + self._last.dtype.type(self._share) * (np.asarray(action, self._last.dtype) - self._last)
        return self.env.step(self._last)
