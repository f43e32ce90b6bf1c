"""A Stable-Baselines3 ``VecEnv`` over any native Gymnasium vector environment."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv, VectorWrapper
from numpy.typing import NDArray
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import VecEnv

from turtlebot_gym.config import POSITIVE
from turtlebot_gym_agents.policies import Policy

GROUPS = 16
"""Most different times at which the rows of `Staggered` begin."""


class Sb3VecEnv(VecEnv):
    """Present a Gymnasium vector environment in the mode ``AutoresetMode.SAME_STEP``, whose steps return new arrays, to SB3.

    The rows share their attributes, methods and options; single ones are refused. For rows of their own, use SB3's
    `DummyVecEnv`.

    Infos hold, for the environments whose episode has just ended, ``terminal_observation``, ``TimeLimit.truncated``,
    ``episode`` (return r and length l, as SB3's ``Monitor`` has them) and the contents of ``final_info``, such as
    ``is_success``. All other infos are empty. `shares` adds up those of the reward. The algorithm sees rewards times
    ``reward_scale``: returns far above 1 take a critic many updates, and the errors until then leave the actions little of a
    clipped gradient.
    """

    def __init__(self, envs: VectorEnv, *, reward_scale: float = 1.0) -> None:
        if envs.metadata.get("autoreset_mode") is not AutoresetMode.SAME_STEP:
            raise ValueError(
                "Sb3VecEnv needs a vector environment that resets within the step, got "
                f"{envs.metadata.get('autoreset_mode')}: make it with autoreset_mode=AutoresetMode.SAME_STEP."
            )
        self.envs, self._scale = envs, POSITIVE.check("reward_scale", reward_scale)
        self._actions: NDArray[Any] = np.empty(0)
        self._returns = np.zeros(envs.num_envs)
        self._lengths = np.zeros(envs.num_envs, np.int64)
        self.shares: NDArray[np.float64] = np.zeros(0)
        """What each term has added to the reward of all rows since somebody has emptied this; empty if nobody tells."""
        super().__init__(envs.num_envs, envs.single_observation_space, envs.single_action_space)

    def reset(self) -> Any:
        """Start all episodes with the seeds and the options set, one for all rows, and return observations."""
        # VecEnv.seed(s) sets s + i, as Gymnasium does for the int s; not all vector environments accept lists.
        options = self._options[0]
        observations, infos = self.envs.reset(seed=self._seeds[0], options=dict(options) or None)
        self.reset_infos = [_row(infos, row) for row in range(self.num_envs)]
        begins = options.get("reset_mask", slice(None))
        self._returns[begins] = 0.0
        self._lengths[begins] = 0
        self._reset_seeds()
        self._reset_options()
        return observations

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
            for row in rows.tolist():
                info = split[row] = _row(final, row)
                info["terminal_observation"] = last[row]
                info["TimeLimit.truncated"] = bool(timed_out[row])
                info["episode"] = {"r": round(float(self._returns[row]), 6), "l": int(self._lengths[row])}
            self._returns[rows] = 0.0
            self._lengths[rows] = 0
        return observations, rewards, dones, split

    def _add_shares(self, infos: dict[str, Any]) -> None:
        if "reward_shares" in infos:
            shares = infos["reward_shares"].sum(axis=0)  # 0 in the rows whose next episode has begun
            if "final_info" in infos:
                shares = shares + infos["final_info"]["reward_shares"][infos["_final_info"]].sum(axis=0)
            self.shares = shares if self.shares.size == 0 else self.shares + shares

    def close(self) -> None:
        self.envs.close()

    def _layer_of(self, name: str, indices: Any) -> Any:
        """Return the outermost wrapper that has an attribute, or the vector environment; refuse single rows, which share it."""
        if indices is not None and {*np.atleast_1d(indices).tolist()} != {*range(self.num_envs)}:
            raise ValueError(f"The rows of {type(self.envs.unwrapped).__name__} share their attributes and methods: name all.")
        layer = self.envs
        while not hasattr(layer, name) and isinstance(layer, VectorWrapper):
            layer = layer.env
        return layer

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return an attribute of each row, which all share."""
        return [getattr(self._layer_of(attr_name, None), attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Set the attribute that all rows share."""
        setattr(self._layer_of(attr_name, indices), attr_name, value)

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """Call a method once, with the same result for all rows."""
        return [getattr(self._layer_of(method_name, indices), method_name)(*args, **kwargs)] * self.num_envs

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        """Return whether each row is wrapped; for `Monitor` always true, since infos are those of a monitor."""
        return [wrapper_class is Monitor for _ in self._get_indices(indices)]

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        """Return the vector environment's pictures, if it draws any."""
        images: Any = self.envs.render()
        return [None] * self.num_envs if images is None else list(images)


class Staggered(VectorWrapper):
    """Drive the rows of a vector environment for different times, at most ``steps``, after a reset of all of them.

    It resets within the step and knows ``reset_mask``; the policy has no memory. Environments that begin together stay together
    where episodes are alike: on the square all of them turn at the same corner, and each rollout would teach that corner alone.
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


def _row(infos: dict[str, Any], row: int) -> dict[str, Any]:
    """Return one row of Gymnasium's infos, where the mask ``_key`` says whether it has a value."""
    return {
        key: _row(value, row) if isinstance(value, dict) else value[row]
        for key, value in infos.items()
        if not key.startswith("_") and (f"_{key}" not in infos or infos[f"_{key}"][row])
    }
