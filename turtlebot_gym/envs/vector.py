"""The vector environment of a device: what `gymnasium.make_vec` calls."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from turtlebot_gym.config import as_int, choose
from turtlebot_gym.envs.common import read_seeds, spaces_of, with_limit
from turtlebot_gym.models.random import MAX_SEED
from turtlebot_gym.systems import Options

MOST = 2**24
"""Most environments in one."""


def make_vector(num_envs: int = 1, *, device: str = "cpu", **options: Any) -> VectorEnv[Any, Any, Any]:
    """Make a vector environment.

    Args:
        num_envs: Number of environments.
        device: "cpu" for the engine, see `NavigationVectorEnv`, which returns numpy's arrays; or a device on which everything
            is a tensor of torch, see `NavigationDeviceEnv`: "cuda", "cuda:1" and so on, or "torch-cpu".
        **options: Those of the environment.
    """
    if device == "cpu":
        from turtlebot_gym.envs.navigation_vector import NavigationVectorEnv

        return NavigationVectorEnv(num_envs, **options)
    from turtlebot_gym.envs.navigation_device import NavigationDeviceEnv

    return NavigationDeviceEnv(num_envs, device=device, **options)


class SeededVectorEnv(VectorEnv[Any, Any, Any]):
    """What the vector environments of all devices share: their arguments, spaces and seeds."""

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "autoreset_mode": AutoresetMode.NEXT_STEP}

    def __init__(
        self,
        num_envs: int,
        max_episode_steps: int | None,
        autoreset_mode: AutoresetMode | str,
        render_mode: str | None,
        options: Mapping[str, Any],
    ) -> None:
        self.num_envs = as_int("num_envs", num_envs, 1, MOST)
        self.render_mode = choose("render_mode", render_mode, {mode: mode for mode in (None, "rgb_array")})
        modes = {name: mode for mode in AutoresetMode for name in (mode, mode.name, mode.value)}
        self.autoreset_mode = choose("autoreset_mode", autoreset_mode, modes)
        self._begun, chosen = False, Options.of(options)
        self._setup = setup = chosen.setup() if max_episode_steps is None else with_limit(chosen, max_episode_steps)
        self.observation_terms = setup.system.terms
        """The terms of an observation, in turn."""
        fps = max(1, round(1.0 / setup.parameters.dt))
        self.metadata = {**self.metadata, "autoreset_mode": self.autoreset_mode, "render_fps": fps}
        self.single_action_space, self.single_observation_space = spaces_of(setup.system)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)

    def _seed(self, seed: int | Sequence[int | None] | None) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
        """Return which environments a reset gives a new seed, and their seeds; at the first reset all get one."""
        seeds = read_seeds(seed, self.num_envs)
        super().reset(seed=next((given for given in seeds if given is not None), None))
        if not self._begun:
            first = int(self.np_random_seed or 0)
            seeds = [first + row if given is None else given for row, given in enumerate(seeds)]
        is_given = np.array([given is not None for given in seeds])
        return is_given, np.array([(given or 0) & MAX_SEED for given in seeds], np.int64)

    def _require_begun(self, mask: Any) -> None:
        """Refuse a mask, an array or a tensor, that leaves out environments before the first reset of all."""
        if not self._begun and not mask.all():
            row = next(row for row, is_chosen in enumerate(mask.tolist()) if not is_chosen)
            raise ResetNeeded(f"Environment {row}: call reset() for all before a reset_mask leaves it out.")
