"""The vector environment on a GPU: state, observations and rewards stay there, as tensors of torch."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium.error import InvalidAction, ResetNeeded
from gymnasium.vector import AutoresetMode

from turtlebot_gym.compiled.gpu import DeviceBatch
from turtlebot_gym.compiled.loop import FLAGS
from turtlebot_gym.compiled.values import Untraceable
from turtlebot_gym.config import choose, refusal, short_repr
from turtlebot_gym.envs.common import read_options
from turtlebot_gym.envs.vector import SeededVectorEnv
from turtlebot_gym.systems import Outcome, Parameters

if TYPE_CHECKING:
    from torch import Tensor

ON_PROCESSOR = "torch-cpu"
"""Name of the device on which the kernels of a GPU run on this processor."""
CHECKED = 100
"""Steps after which the device is asked whether all actions were finite."""
_REWARD, _DISTANCE = map(Outcome._fields.index, ("reward", "distance"))


def find_device(device: str) -> str:
    """Return the name of a device that is there, as torch knows it."""
    if device != ON_PROCESSOR and not (isinstance(device, str) and re.fullmatch(r"cuda(:\d+)?", device)):
        raise refusal("device", f"'cpu', 'cuda', 'cuda:1' and so on, or {ON_PROCESSOR!r}", device)
    try:
        import torch
    except ImportError as error:
        raise ImportError(f"device={device!r} needs torch: pip install torch ({error}).") from error
    if device == ON_PROCESSOR:
        return "cpu"
    count, number = torch.cuda.device_count(), int(device.partition(":")[2] or 0)
    if count <= number:
        raise ValueError(
            f"device={device!r} is not there: torch finds {count or 'no'} CUDA device{'s'[: count != 1]}. "
            "Leave device out, and the engine runs on this processor."
        )
    return f"cuda:{number}"


class NavigationDeviceEnv(SeededVectorEnv):
    """A `NavigationVectorEnv` on open ground whose numbers are tensors on a GPU; row *i* has the same trajectory, to the bit.

    Actions are a tensor of shape (N, 2) on the device. `reset` and `step` return new tensors each time: observations (N, K) in
    float32, rewards (N,) in float64, and flags (N,). Only one step in `CHECKED` waits for the device, so an action that is not
    finite is an error of one of the next `CHECKED` steps, or of the next reset.

    ``info`` holds ``distance`` and ``is_success``, shape (N,), with a mask of each. In the mode SAME_STEP every step has
    ``final_obs``, shape (N, K), and ``final_info``, with the masks ``_final_obs`` and ``_final_info`` of the environments whose
    episode has ended; their other rows mean nothing.

    Args:
        num_envs: Number of environments.
        device: "cuda", "cuda:1" and so on; or "torch-cpu", the same kernels on this processor, slowly, for tests.
        max_episode_steps: Steps after which an episode is truncated; None for the task's own.
        autoreset_mode: NEXT_STEP or SAME_STEP of `gymnasium.vector.AutoresetMode`, or its name.
        info: "default"; others need the engine, like `render_mode`.
        render_mode: None.
        **options: See `NavigationEnv`, whose errors are raised, too; rooms need the engine.

    Raises:
        ValueError: If the device is not there or cannot do what is asked.
        ImportError: If torch is not installed.
    """

    metadata: dict[str, Any] = SeededVectorEnv.metadata | {"render_modes": []}

    def __init__(
        self,
        num_envs: int = 1,
        *,
        device: str = "cuda",
        max_episode_steps: int | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        info: str = "default",
        render_mode: str | None = None,
        **options: Any,
    ) -> None:
        super().__init__(num_envs, max_episode_steps, autoreset_mode, render_mode, options)
        choose("info", info, dict.fromkeys(("default", "rewards", "full")))
        parameters, waypoints, _, system = self._setup
        asked = {
            "rooms": system.in_room,
            "a filter in plain Python": not system.compiled,
            "an observation of past values": any(term.length > 1 for term in system.terms),
            f"info={info!r}": info != "default",
            f"render_mode={render_mode!r}": render_mode is not None,
            "autoreset_mode='Disabled'": self.autoreset_mode is AutoresetMode.DISABLED,
        }
        for what, is_asked in asked.items():
            if is_asked:
                raise ValueError(f"device={device!r} cannot do {what}: leave device out, and the engine does.")
        name = find_device(device)
        try:
            self._batch = DeviceBatch(self.num_envs, parameters, waypoints, system=system, device=name)
        except Untraceable as error:
            raise ValueError(f"device={device!r} cannot do this: {error}. Leave device out, and the engine does.") from error
        self.device = self._batch.device
        """The device, as torch names it."""
        self.parameters = parameters
        """Everything that the environments' transitions depend on."""
        self._everywhere = self._tensor(np.ones(self.num_envs, np.bool_))
        self._done = ~self._everywhere
        self._steps = 0

    def set_parameters(self, parameters: Parameters | Sequence[Parameters]) -> None:
        """Refuse other parameters, since they are part of the kernels."""
        raise ValueError("parameters are part of a device's kernels: make another environment with them, or leave device out.")

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Tensor, dict[str, Any]]:
        """Start episodes.

        Args:
            seed: As in `NavigationVectorEnv.reset`.
            options: ``reset_mask``, a boolean tensor on the device, shape (N,): reset only these.

        Returns:
            Observations of all environments, and infos; those outside the mask are zero.
        """
        mask, batch = self._mask(options), self._batch
        self._check_actions()
        is_seeded, seeds = (self._tensor(array) for array in self._seed(seed))
        is_seeded = is_seeded & mask
        batch.seeds.copy_(seeds.where(is_seeded, batch.seeds))
        batch.episodes.copy_((batch.episodes + mask) * ~is_seeded)
        observations, outcomes = batch.empty()
        batch.reset(self._everywhere, observations, outcomes, begins=False)
        batch.reset(mask, observations, outcomes)
        self._begun = True
        self._done = self._done & ~mask
        return observations, self._info(outcomes.masked_fill(~mask, 0.0), mask)

    def step(  # pyright: ignore[reportIncompatibleMethodOverride]  # tensors
        self, actions: Tensor
    ) -> tuple[Tensor, Tensor, Tensor, Tensor, dict[str, Any]]:
        """Advance all environments by one control interval.

        Args:
            actions: Shape (N, 2), on the device: shares of the speed and turning rate limits; values beyond 1 are clipped.
        """
        values = self._read_actions(actions)
        if not self._begun:
            raise ResetNeeded("Call reset() before step().")
        self._steps += 1
        if self._steps % CHECKED == 0:
            self._check_actions()
        observations, outcomes = self._batch.step(values)
        if self.autoreset_mode is AutoresetMode.NEXT_STEP:
            self._begin(self._done, observations, outcomes)
            _, terminated, truncated = outcomes[FLAGS] != 0.0
            self._done = terminated | truncated
            return observations, outcomes[_REWARD], terminated, truncated, self._info(outcomes, self._everywhere)
        _, terminated, truncated = outcomes[FLAGS] != 0.0
        self._done, last_observations, last = terminated | truncated, observations.clone(), outcomes.clone()
        self._begin(self._done, observations, outcomes)
        final = {"final_obs": last_observations, "_final_obs": self._done}
        final |= {"final_info": self._info(last.masked_fill(~self._done, 0.0), self._done), "_final_info": self._done}
        return observations, last[_REWARD], terminated, truncated, self._info(outcomes, self._everywhere) | final

    def _begin(self, mask: Tensor, observations: Tensor, outcomes: Tensor) -> None:
        """Begin the next episode of some environments, and overwrite their values."""
        self._batch.episodes += mask
        self._batch.reset(mask, observations, outcomes)

    def _tensor(self, array: Any) -> Tensor:
        import torch

        return torch.as_tensor(array, device=self.device)

    def _info(self, outcomes: Tensor, mask: Tensor) -> dict[str, Any]:
        is_success = outcomes[FLAGS][0] != 0.0
        return {"distance": outcomes[_DISTANCE], "is_success": is_success, "_distance": mask, "_is_success": mask}

    def _read_actions(self, actions: Any) -> Tensor:
        import torch

        shape = (self.num_envs, 2)
        if not (isinstance(actions, torch.Tensor) and actions.device == self.device and actions.shape == shape):
            raise InvalidAction(f"Actions are a tensor of shape {shape} on {self.device}, got {short_repr(actions)}.")
        return actions.detach().to(torch.float32).contiguous()

    def _check_actions(self) -> None:
        row = self._batch.take_wrong()
        if row is not None:
            raise InvalidAction(f"Environment {row}: an action of the last {CHECKED} steps was not finite.")

    def _mask(self, options: dict[str, Any] | None) -> Tensor:
        import torch

        mask = read_options(options, ["reset_mask"]).get("reset_mask", self._everywhere)
        is_mask = isinstance(mask, torch.Tensor) and mask.dtype is torch.bool and mask.shape == (self.num_envs,)
        if not is_mask or not mask.any():
            raise refusal("reset_mask", f"a boolean tensor of shape ({self.num_envs},) that is true somewhere", mask)
        self._require_begun(mask)
        return mask.to(self.device).contiguous()
