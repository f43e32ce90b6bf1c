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
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv

if TYPE_CHECKING:
    from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm


class Sb3VecEnv(VecEnv):
    """Present a Gymnasium vector environment to Stable-Baselines3.

    Infos hold, for the environments whose episode has just ended, ``terminal_observation``, ``TimeLimit.truncated``,
    ``episode`` (return r, length l, seconds t) and whatever ``final_info`` has, such as ``is_success``. All others' are empty.

    Args:
        envs: A vector environment in the mode ``AutoresetMode.SAME_STEP``, with observations in one array.

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
        self.render_mode = envs.render_mode
        super().__init__(envs.num_envs, envs.single_observation_space, envs.single_action_space)

    def bootstrap_with(self, model: OnPolicyAlgorithm) -> None:
        """Add ``gamma V(last observation)`` of timed-out episodes to their rewards, in one batch, instead of leaving it to SB3.

        Their infos then have ``TimeLimit.truncated`` false, so that it is not done twice. For on-policy algorithms only: those
        with a replay buffer need the flag.
        """
        self._model = model

    def reset(self) -> NDArray[Any]:
        """Start all episodes, with the seeds and options that `seed` and `set_options` have left, and return observations."""
        seeds = None if all(seed is None for seed in self._seeds) else self._seeds
        options = self._options[0] if self._options and self._options[0] else None
        observations, infos = self.envs.reset(seed=seeds, options=options)
        self._reset_seeds()
        self._reset_options()
        self._returns[:] = 0.0
        self._lengths[:] = 0
        self.reset_infos = self._split(infos)
        return observations

    def step_async(self, actions: NDArray[Any]) -> None:
        """Take the actions for `step_wait`."""
        self._actions = actions

    def step_wait(self) -> tuple[NDArray[Any], NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        """Make the step."""
        observations, rewards, terminated, truncated, infos = self.envs.step(self._actions)
        dones = terminated | truncated
        rewards = rewards.astype(np.float32)
        self._returns += rewards
        self._lengths += 1
        split: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        if dones.any():
            rows = np.flatnonzero(dones)
            last = infos["final_obs"]
            timed_out = truncated & ~terminated
            if self._model is not None and timed_out.any():
                rewards[timed_out] += self._model.gamma * self._values(np.stack(list(last[timed_out])))
            final = infos.get("final_info", {})
            keys = [key for key in final if not key.startswith("_")]
            elapsed = round(time.time() - self._start, 6)
            for row in rows.tolist():
                info = {key: final[key][row] for key in keys}
                info["terminal_observation"] = last[row]
                info["TimeLimit.truncated"] = bool(timed_out[row]) and self._model is None
                info["episode"] = {"r": float(self._returns[row]), "l": int(self._lengths[row]), "t": elapsed}
                split[row] = info
            self._returns[rows] = 0.0
            self._lengths[rows] = 0
        return observations, rewards, dones, split

    def _values(self, observations: NDArray[Any]) -> NDArray[np.float32]:
        """Return the model's values of a batch of observations, shape (n,)."""
        import torch

        assert self._model is not None
        tensor, _ = self._model.policy.obs_to_tensor(observations)
        with torch.no_grad():
            return self._model.policy.predict_values(tensor).cpu().numpy().ravel()

    def _split(self, infos: dict[str, Any]) -> list[dict[str, Any]]:
        """Return one dictionary per environment from Gymnasium's dictionary of arrays with masks."""
        keys = [key for key in infos if not key.startswith("_")]
        return [{key: infos[key][row] for key in keys if infos[f"_{key}"][row]} for row in range(self.num_envs)]

    def close(self) -> None:
        """Close the vector environment."""
        self.envs.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return an attribute of the vector environment, once for each of the indices: it is the same for all."""
        return [getattr(self.envs, attr_name)] * len(list(self._get_indices(indices)))

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Set an attribute of the vector environment, which is that of all rows."""
        if len(list(self._get_indices(indices))) != self.num_envs:
            raise NotImplementedError("The rows of a native vector environment share their attributes: set it for all.")
        setattr(self.envs, attr_name, value)

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """Call a method of the vector environment once, and return its result for each of the indices."""
        return [getattr(self.envs, method_name)(*args, **kwargs)] * len(list(self._get_indices(indices)))

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        """Return false for each of the indices: rows have no wrappers of their own."""
        return [False] * len(list(self._get_indices(indices)))

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        """Return the picture that the vector environment draws, if it draws one."""
        images = self.envs.render()
        return list(images) if images is not None else [None] * self.num_envs
