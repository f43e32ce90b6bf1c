"""A Stable-Baselines3 ``VecEnv`` over any native Gymnasium vector environment.

The two interfaces differ in four things, which are all that this adapter does: SB3 resets finished environments within the
step and wants their last observation in the infos; it wants one dictionary per environment; ``reset`` returns observations
only; and time-outs are told apart by ``TimeLimit.truncated``.

SB3's on-policy algorithms evaluate the value of every timed-out episode's last observation with a forward pass of its own. With
thousands of environments that is most of the time. After ``bootstrap_with(model)`` the adapter does it for all rows at once.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import concatenate, create_empty_array
from numpy.typing import NDArray
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm
from stable_baselines3.common.vec_env import VecEnv


class Sb3VecEnv(VecEnv):
    """Present a Gymnasium vector environment to Stable-Baselines3.

    Infos hold, for the environments whose episode has just ended, ``terminal_observation``, ``TimeLimit.truncated``,
    ``episode`` (return r, length l, seconds t, as SB3's ``Monitor`` has them) and whatever ``final_info`` has, such as
    ``is_success``. All others' are empty.

    Args:
        envs: A vector environment in the mode ``AutoresetMode.SAME_STEP`` whose steps return fresh arrays.

    Raises:
        ValueError: If its autoreset mode is another one.
    """

    def __init__(self, envs: VectorEnv) -> None:
        if envs.metadata.get("autoreset_mode") is not AutoresetMode.SAME_STEP:
            raise ValueError(
                "Sb3VecEnv needs a vector environment that resets within the step, got "
                f"{envs.metadata.get('autoreset_mode')}: make it with autoreset_mode=AutoresetMode.SAME_STEP."
            )
        self.envs = envs
        self._model: OnPolicyAlgorithm | None = None
        self._actions: NDArray[Any] = np.empty(0)
        self._returns = np.zeros(envs.num_envs)
        self._lengths = np.zeros(envs.num_envs, np.int64)
        self._start = time.time()
        super().__init__(envs.num_envs, envs.single_observation_space, envs.single_action_space)

    def bootstrap_with(self, model: OnPolicyAlgorithm) -> None:
        """Add ``gamma V(last observation)`` of timed-out episodes to their rewards, in one batch, instead of leaving it to SB3.

        Their infos then have ``TimeLimit.truncated`` false, so that it is not done twice.

        Args:
            model: An on-policy one (those with a replay buffer need the flag) that works on this adapter directly: under
                `VecNormalize` its values would belong to other observations and rewards.

        Raises:
            ValueError: If the model is not such a one.
        """
        if not isinstance(model, OnPolicyAlgorithm) or model.env is not self:
            raise ValueError(f"model must be an on-policy algorithm whose env is this adapter, got {model!r}.")
        self._model = model

    def reset(self) -> Any:
        """Start all episodes, with the seeds and options that `seed` and `set_options` have left, and return observations."""
        options = self._options[0]
        if any(row != options for row in self._options):
            raise ValueError("The rows of a native vector environment share their options: set them for all.")
        # VecEnv.seed(s) has left s + i, which is what Gymnasium makes of the int s; not all vector environments take lists.
        observations, infos = self.envs.reset(seed=self._seeds[0], options=options or None)
        self._reset_seeds()
        self._reset_options()
        self._returns[:] = 0.0
        self._lengths[:] = 0
        self.reset_infos = [_row(infos, row) for row in range(self.num_envs)]
        return observations

    def step_async(self, actions: NDArray[Any]) -> None:
        """Take the actions for `step_wait`."""
        self._actions = actions

    def step_wait(self) -> tuple[Any, NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        """Make the step."""
        observations, rewards, terminated, truncated, infos = self.envs.step(self._actions)
        self._returns += rewards
        self._lengths += 1
        rewards = rewards.astype(np.float32)
        dones = terminated | truncated
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

    def _values(self, model: OnPolicyAlgorithm, observations: NDArray[Any]) -> NDArray[np.float32]:
        """Return the model's values of observations, shape (n,)."""
        space = self.observation_space
        batch: Any = concatenate(space, list(observations), create_empty_array(space, len(observations)))
        with torch.no_grad():
            return model.policy.predict_values(model.policy.obs_to_tensor(batch)[0]).cpu().numpy().ravel()

    def close(self) -> None:
        """Close the vector environment."""
        self.envs.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return an attribute of the vector environment, once for each of the indices: it is the same for all."""
        return [getattr(self.envs, attr_name)] * len(list(self._get_indices(indices)))

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Set an attribute of the vector environment, which is that of all rows."""
        if len(list(self._get_indices(indices))) != self.num_envs:
            raise ValueError("The rows of a native vector environment share their attributes: set it for all.")
        setattr(self.envs, attr_name, value)

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """Call a method of the vector environment once, and return its result for each of the indices."""
        return [getattr(self.envs, method_name)(*args, **kwargs)] * len(list(self._get_indices(indices)))

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        """Return for each of the indices whether it is wrapped: rows have no wrappers, but the infos have what Monitor's do."""
        return [wrapper_class is Monitor] * len(list(self._get_indices(indices)))

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        """Return the pictures that the vector environment draws, if it draws any."""
        images: Any = self.envs.render()
        return [None] * self.num_envs if images is None else list(images)


def _row(infos: dict[str, Any], row: int) -> dict[str, Any]:
    """Return one environment's part of Gymnasium's dictionary of arrays, where the mask ``_key`` says whether it has one."""
    return {
        key: _row(value, row) if isinstance(value, dict) else value[row]
        for key, value in infos.items()
        if not key.startswith("_") and (f"_{key}" not in infos or infos[f"_{key}"][row])
    }
