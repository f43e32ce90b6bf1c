"""Wrappers of vector environments for every autoreset mode; each row behaves like the wrapped scalar environment.

Gymnasium's `VectorObservationWrapper` refuses the mode SAME_STEP, in which the last observation of an ended episode must be
wrapped too; these wrappers do so.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from gymnasium.utils import RecordConstructorArgs
from gymnasium.vector import AutoresetMode, VectorEnv, VectorWrapper
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from turtlebot_gym.envs.common import of_rows
from turtlebot_gym.validation import as_int, choose
from turtlebot_gym.wrappers.common import SHARE, Moment, Transition, ask, doubled, moment, require_box


class _Stepped(NamedTuple):
    """Result of a vector environment's step, and its meaning for each row."""

    observations: Any
    rewards: Any
    terminated: Any
    truncated: Any
    infos: dict[str, Any]
    done: NDArray[np.bool_]
    """Rows in which an episode ended."""
    waited: NDArray[np.bool_]
    """Rows in which the action was ignored and an episode begins instead."""

    def begins(self, mode: AutoresetMode) -> NDArray[np.bool_]:
        """Return the rows whose observations are the first of an episode."""
        return self.done if mode is AutoresetMode.SAME_STEP else self.waited

    def last(self) -> Moment:
        """Return observations and infos, with the final ones for ended episodes."""
        if "final_obs" not in self.infos:
            return Moment(self.observations, self.infos)
        observations = self.observations.copy()
        for row in np.flatnonzero(self.done).tolist():
            observations[row] = self.infos["final_obs"][row]
        infos = {key: value for key, value in self.infos.items() if key.lstrip("_") not in ("final_obs", "final_info")}
        return Moment(observations, _merged(infos, self.infos.get("final_info", {}), self.done))

    def returned(self, observations: Any, final: Any = None) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Return the step's result with other observations."""
        infos = (
            self.infos
            if final is None or "final_obs" not in self.infos
            else {**self.infos, "final_obs": of_rows(self.done, final)}
        )
        return observations, self.rewards, self.terminated, self.truncated, infos


def _merged(infos: dict[str, Any], others: dict[str, Any], mask: NDArray[np.bool_]) -> dict[str, Any]:
    """Return infos, replaced by those of others where a mask is true."""
    merged = dict(infos)
    for key, value in others.items():
        before = infos.get(key)
        if isinstance(value, dict):
            merged[key] = _merged(before or {}, value, mask)
        elif before is None:
            merged[key] = value
        else:
            merged[key] = np.where(mask.reshape(-1, *(1,) * (value.ndim - 1)), value, before)
    return merged


class _RowsWrapper(VectorWrapper):
    """Base of wrappers that track which rows begin and end."""

    def __init__(self, env: VectorEnv) -> None:
        super().__init__(env)
        self._mode = AutoresetMode(env.metadata["autoreset_mode"])
        self._ended = np.zeros(env.num_envs, np.bool_)

    def _reset(self, seed: Any, options: dict[str, Any] | None) -> tuple[Any, dict[str, Any], NDArray[np.bool_]]:
        """Reset, and return which rows were reset."""
        mask = (options or {}).get("reset_mask", np.ones(self.num_envs, np.bool_))
        observations, infos = self.env.reset(seed=seed, options=None if options is None else dict(options))
        self._ended = self._ended & ~mask
        return observations, infos, mask

    def _step(self, actions: Any) -> _Stepped:
        waited = self._ended if self._mode is AutoresetMode.NEXT_STEP else np.zeros(self.num_envs, np.bool_)
        observations, rewards, terminated, truncated, infos = self.env.step(actions)
        self._ended = np.logical_or(terminated, truncated)
        return _Stepped(observations, rewards, terminated, truncated, infos, self._ended, waited)


class TransitionReward(_RowsWrapper, RecordConstructorArgs):
    """Compute the reward from each whole transition, see `turtlebot_gym.wrappers.TransitionReward`.

    Args:
        env: A vector environment whose observations are a Box; those of this package have more infos with ``info="full"``.
        reward: A function of a `Transition` of all rows that returns a number for each, shape (N,).

    Raises:
        ValueError: If the observations are not a Box or, at a step, if the function returns another shape.
    """

    def __init__(self, env: VectorEnv, reward: Callable[[Transition], Any]) -> None:
        RecordConstructorArgs.__init__(self, reward=reward, _disable_deepcopy=True)
        super().__init__(env)
        require_box(env.single_observation_space, "observation")
        self._reward = reward
        self._before = Moment(None, {})

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        observations, infos, mask = self._reset(seed, options)
        self._before = moment(observations, infos if mask.all() else _merged(self._before.info, infos, mask))
        return observations, infos

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Make a step; rows that begin an episode instead have the reward 0."""
        outcome = self._step(actions)
        last = outcome.last()
        after = moment(*last)
        transition = Transition(self._before, doubled(actions), after, outcome.rewards, outcome.terminated, outcome.truncated)
        rewards = ask(self._reward, transition)
        if rewards.shape != (self.num_envs,):
            raise ValueError(f"reward must return shape ({self.num_envs},), got {rewards.shape}.")
        self._before = after if last.info is outcome.infos else moment(outcome.observations, outcome.infos)
        return outcome._replace(rewards=np.where(outcome.waited, 0.0, rewards)).returned(outcome.observations)


class SmoothAction(_RowsWrapper, RecordConstructorArgs):
    """Pass actions through a first-order low-pass filter, see `turtlebot_gym.wrappers.SmoothAction`."""

    def __init__(self, env: VectorEnv, share: float) -> None:
        RecordConstructorArgs.__init__(self, share=share)
        super().__init__(env)
        self._share = SHARE.check("share", share)
        self._last: Any = np.zeros_like(require_box(env.action_space, "action").low)

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        observations, infos, mask = self._reset(seed, options)
        self._last = self._still(mask)
        return observations, infos

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        self._last = self._last + self._last.dtype.type(self._share) * (np.asarray(actions, self._last.dtype) - self._last)
        outcome = self._step(self._last)
        self._last = self._still(outcome.begins(self._mode))
        return outcome.returned(outcome.observations)

    def _still(self, mask: NDArray[np.bool_]) -> Any:
        """Return the last actions, with zeros where a mask is true."""
        return np.where(mask.reshape(-1, *(1,) * (self._last.ndim - 1)), self._last.dtype.type(0), self._last)


class FrameStackObservation(_RowsWrapper, RecordConstructorArgs):
    """Stack the last observations of each row, as Gymnasium's `FrameStackObservation` does for scalar environments.

    Args:
        env: A vector environment whose observations are a Box.
        stack_size: Number of stacked observations; the newest is the last.
        padding_type: Padding before an episode's first observation: "reset" repeats it, "zero" is zeros.

    Raises:
        ValueError: If an argument is invalid.
    """

    def __init__(self, env: VectorEnv, stack_size: int, *, padding_type: str = "reset") -> None:
        RecordConstructorArgs.__init__(self, stack_size=stack_size, padding_type=padding_type)
        super().__init__(env)
        stack_size = as_int("stack_size", stack_size, 1)
        box = require_box(env.single_observation_space, "observation")
        self._repeats = choose("padding_type", padding_type, {"reset": True, "zero": False})
        self.single_observation_space = batch_space(box, stack_size)
        self.observation_space = batch_space(self.single_observation_space, env.num_envs)
        self._frames = np.zeros((env.num_envs, stack_size, *box.shape), box.dtype)

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        observations, infos, mask = self._reset(seed, options)
        self._pad(mask, observations)
        return self._frames.copy(), infos

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        outcome = self._step(actions)
        self._frames = final = np.concatenate([self._frames[:, 1:], outcome.last().observation[:, None]], axis=1)
        begins = outcome.begins(self._mode)
        if begins.any():
            self._frames = final.copy()
            self._pad(begins, outcome.observations)
        return outcome.returned(self._frames.copy(), final)

    def _pad(self, mask: NDArray[np.bool_], observations: Any) -> None:
        self._frames[mask] = observations[mask][:, None] if self._repeats else 0
        self._frames[mask, -1] = observations[mask]
