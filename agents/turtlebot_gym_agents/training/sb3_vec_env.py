"""A Stable-Baselines3 ``VecEnv`` over any native Gymnasium vector environment.

The adapter bridges the four differences between the two interfaces: SB3 resets finished environments within the step and
expects their last observation in the infos; it expects one dictionary per environment; ``reset`` returns observations only; and
``TimeLimit.truncated`` marks time-outs.

SB3's on-policy algorithms evaluate the value of each timed-out episode's last observation in a separate forward pass, which
takes most of the time with thousands of environments. After ``bootstrap_with(model)`` the adapter does it for all rows at once.
"""

from __future__ import annotations

import inspect
import time
from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv, VectorEnv, VectorWrapper
from gymnasium.vector.utils import concatenate, create_empty_array
from numpy.typing import NDArray
from stable_baselines3.common.env_util import is_wrapped
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm
from stable_baselines3.common.vec_env import VecEnv

from turtlebot_gym.config import POSITIVE

_PURE = ("compute_reward",)
"""Methods whose result does not depend on the row; `HerReplayBuffer` uses this one."""


class Sb3VecEnv(VecEnv):
    """Present a Gymnasium vector environment to Stable-Baselines3.

    With `SyncVectorEnv`, rows are addressed individually, as in SB3's `DummyVecEnv`. Rows of a native vector environment share
    their attributes and methods, and those of `AsyncVectorEnv` answer together; requests for only some of these rows are
    refused. Rows with different options are reset by ``reset_mask``.

    Infos hold, for the environments whose episode has just ended, ``terminal_observation``, ``TimeLimit.truncated``,
    ``episode`` (return r, length l, seconds t, as SB3's ``Monitor`` has them) and the contents of ``final_info``, such as
    ``is_success``. All other infos are empty. `shares` adds up those of the reward.

    Args:
        envs: A vector environment in the mode ``AutoresetMode.SAME_STEP`` whose steps return new arrays.
        reward_scale: Factor of the rewards that the algorithm sees; those in infos are the environment's. Returns far above 1
            take a critic many updates, and the errors until then leave the actions little of a clipped gradient.

    Raises:
        ValueError: If its autoreset mode is not SAME_STEP, or the scale not positive.
    """

    def __init__(self, envs: VectorEnv, *, reward_scale: float = 1.0) -> None:
        if envs.metadata.get("autoreset_mode") is not AutoresetMode.SAME_STEP:
            raise ValueError(
                "Sb3VecEnv needs a vector environment that resets within the step, got "
                f"{envs.metadata.get('autoreset_mode')}: make it with autoreset_mode=AutoresetMode.SAME_STEP."
            )
        self.envs, self._scale = envs, POSITIVE.check("reward_scale", reward_scale)
        self._model: OnPolicyAlgorithm | None = None
        self._actions: NDArray[Any] = np.empty(0)
        self._returns = np.zeros(envs.num_envs)
        self._lengths = np.zeros(envs.num_envs, np.int64)
        self._start = time.time()
        self._begun = False
        self.shares: NDArray[np.float64] = np.zeros(0)
        """What each term has added to the reward of all rows since somebody has emptied this; empty if nobody tells."""
        super().__init__(envs.num_envs, envs.single_observation_space, envs.single_action_space)
        if "render_fps" in envs.metadata:
            self.metadata["render_fps"] = envs.metadata["render_fps"]

    def bootstrap_with(self, model: OnPolicyAlgorithm) -> None:
        """Add ``gamma V(last observation)`` of timed-out episodes to their rewards, in one batch, instead of leaving it to SB3.

        Their infos then have ``TimeLimit.truncated`` set to false, so that SB3 does not do it again.

        Args:
            model: An on-policy model (those with a replay buffer need the flag) whose env is this adapter itself: under
                `VecNormalize` its values would refer to other observations and rewards.

        Raises:
            ValueError: If the model is not one of these.
        """
        if not isinstance(model, OnPolicyAlgorithm) or model.env is not self:
            raise ValueError(f"model must be an on-policy algorithm whose env is this adapter, got {model!r}.")
        parameters = inspect.signature(model.policy.predict_values).parameters.values()
        _, *more = (parameter.name for parameter in parameters if parameter.default is parameter.empty)
        if more:
            raise ValueError(
                f"model must value an observation by itself, and {type(model).__name__} needs {' and '.join(more)}, which only "
                "its rollouts know: do not call bootstrap_with, and it does the same on its own."
            )
        self._model = model

    def reset(self) -> Any:
        """Start all episodes with the seeds and options set, and return observations."""
        # VecEnv.seed(s) sets s + i, as Gymnasium does for the int s; not all vector environments accept lists.
        seed, groups, observations = self._seeds[0], self._groups(), None
        if len(groups) > 1 and not self._begun:
            self.envs.reset(seed=seed)  # the first reset must include all rows
        for options, rows in groups:
            options = {**options, "reset_mask": rows} if len(groups) > 1 else options
            begins = options.get("reset_mask", rows)
            observations, infos = self.envs.reset(seed=seed, options=dict(options) or None)
            for row in np.flatnonzero(rows).tolist():
                self.reset_infos[row] = _row(infos, row)
            self._returns[begins] = 0.0
            self._lengths[begins] = 0
        self._begun = True
        self._reset_seeds()
        self._reset_options()
        return observations

    def _groups(self) -> list[tuple[dict[str, Any], NDArray[np.bool_]]]:
        """Return the distinct options of the rows, and the rows of each."""
        if len(self._options) != self.num_envs:
            raise ValueError(f"options must be one for all or {self.num_envs}, got {len(self._options)}.")
        groups: list[tuple[dict[str, Any], NDArray[np.bool_]]] = []
        for row, options in enumerate(self._options):
            mask = next((mask for other, mask in groups if options is other or data_equivalence(options, other)), None)
            if mask is None:
                mask = np.zeros(self.num_envs, np.bool_)
                groups.append((options, mask))
            mask[row] = True
        if len(groups) > 1 and any("reset_mask" in options for options, _ in groups):
            raise ValueError("options must be the same for all rows where they hold a reset_mask.")
        return groups

    def step_async(self, actions: NDArray[Any]) -> None:
        self._actions = actions

    def step_wait(self) -> tuple[Any, NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        observations, rewards, terminated, truncated, infos = self.envs.step(self._actions)
        self._returns += rewards
        self._lengths += 1
        # Returns are summed in double precision before that.
        rewards = (self._scale * rewards).astype(np.float32)
        dones = terminated | truncated
        self._add_shares(infos)
        split: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        if dones.any():
            rows = np.flatnonzero(dones)
            last, final = infos["final_obs"], infos.get("final_info", {})
            timed_out = truncated & ~terminated
            if self._model is not None and timed_out.any():
                rewards[timed_out] += self._model.gamma * self._values(self._model, last[timed_out])
            elapsed = round(time.time() - self._start, 6)
            for row in rows.tolist():
                info = split[row] = _row(final, row)
                info["terminal_observation"] = last[row]
                info["TimeLimit.truncated"] = bool(timed_out[row]) and self._model is None
                info["episode"] = {"r": round(float(self._returns[row]), 6), "l": int(self._lengths[row]), "t": elapsed}
            self._returns[rows] = 0.0
            self._lengths[rows] = 0
        return observations, rewards, dones, split

    def _add_shares(self, infos: dict[str, Any]) -> None:
        if "reward_shares" in infos:
            shares = infos["reward_shares"].sum(axis=0)  # 0 in the rows whose next episode has begun
            if "final_info" in infos:
                shares = shares + infos["final_info"]["reward_shares"][infos["_final_info"]].sum(axis=0)
            self.shares = shares if self.shares.size == 0 else self.shares + shares

    def _values(self, model: OnPolicyAlgorithm, observations: NDArray[Any]) -> NDArray[np.float32]:
        """Return the model's values of observations, shape (n,)."""
        space = self.observation_space
        batch: Any = concatenate(space, list(observations), create_empty_array(space, len(observations)))
        with torch.no_grad():
            return model.policy.predict_values(model.policy.obs_to_tensor(batch)[0]).cpu().numpy().ravel()

    def close(self) -> None:
        self.envs.close()

    def _chosen(self, indices: Any) -> list[int]:
        return [int(index) for index in (range(self.num_envs) if indices is None else np.atleast_1d(indices))]

    def _rows(self) -> Sequence[gym.Env] | None:
        """Return the environments of the rows, if they are accessible."""
        return self.envs.unwrapped.envs if isinstance(self.envs.unwrapped, SyncVectorEnv) else None

    def _require_all(self, chosen: list[int], remedy: str) -> None:
        if sorted(chosen) != list(range(self.num_envs)):
            raise ValueError(f"The rows of {type(self.envs.unwrapped).__name__} share their {remedy} for all of them.")

    def _layer_of(self, name: str) -> VectorEnv:
        """Return the outermost wrapper that has an attribute, or the vector environment."""
        layer = self.envs
        while not hasattr(layer, name) and isinstance(layer, VectorWrapper):
            layer = layer.env
        return layer

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return an attribute of each row, which those of a native environment share."""
        rows, chosen = self._rows(), self._chosen(indices)
        if rows is not None:
            return [rows[row].get_wrapper_attr(attr_name) for row in chosen]
        if isinstance(self.envs.unwrapped, AsyncVectorEnv):
            values = self.envs.unwrapped.get_attr(attr_name)
            return [values[row] for row in chosen]
        return [getattr(self._layer_of(attr_name), attr_name)] * len(chosen)

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Set an attribute of each row; for a native vector environment, the one that all rows share.

        Raises:
            ValueError: If only some rows are meant and they share it.
        """
        rows, chosen = self._rows(), self._chosen(indices)
        if rows is not None:
            for row in chosen:
                rows[row].set_wrapper_attr(attr_name, value)
            return
        self._require_all(chosen, "attributes: set it")
        if isinstance(self.envs.unwrapped, AsyncVectorEnv):
            self.envs.unwrapped.set_attr(attr_name, [value] * self.num_envs)
        else:
            layer = self._layer_of(attr_name)
            setattr(layer if hasattr(layer, attr_name) else self.envs, attr_name, value)

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """Call a method of each row; for a native vector environment call it once, with the same result for all rows.

        Raises:
            ValueError: If only some rows are meant and they share it.
        """
        rows, chosen = self._rows(), self._chosen(indices)
        if rows is not None:
            return [rows[row].get_wrapper_attr(method_name)(*args, **kwargs) for row in chosen]
        if method_name not in _PURE:
            self._require_all(chosen, "methods: call it")
        if isinstance(self.envs.unwrapped, AsyncVectorEnv):
            results = self.envs.unwrapped.call(method_name, *args, **kwargs)
            return [results[row] for row in chosen]
        return [getattr(self._layer_of(method_name), method_name)(*args, **kwargs)] * len(chosen)

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        """Return whether each row is wrapped; for `Monitor` always true, since infos are those of a monitor."""
        rows, chosen = self._rows(), self._chosen(indices)
        if rows is None or wrapper_class is Monitor:
            return [wrapper_class is Monitor] * len(chosen)
        return [is_wrapped(rows[row], wrapper_class) for row in chosen]

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        """Return the vector environment's pictures, if it draws any."""
        images: Any = self.envs.render()
        return [None] * self.num_envs if images is None else list(images)


def _row(infos: dict[str, Any], row: int) -> dict[str, Any]:
    """Return one row of Gymnasium's infos, where the mask ``_key`` says whether it has a value."""
    return {
        key: _row(value, row) if isinstance(value, dict) else value[row]
        for key, value in infos.items()
        if not key.startswith("_") and (f"_{key}" not in infos or infos[f"_{key}"][row])
    }
