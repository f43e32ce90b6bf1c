"""A batch of environments on a device of NVIDIA Warp: tensors of torch that stay there, and the kernels that work on them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from turtlebot_gym.compiled.device import OUTCOMES, kernels_of
from turtlebot_gym.compiled.ground import Case
from turtlebot_gym.compiled.packing import as_tuple, flatten, layout_of
from turtlebot_gym.observations import size_of
from turtlebot_gym.systems import Parameters, System
from turtlebot_gym.values import Pose


class DeviceBatch:
    """Environments that are stepped together on a device; `batch.Batch` is the same without one.

    ``seeds`` and ``episodes``, shape (N,), are the numbers of the episodes, to be changed in place.

    Args:
        num_envs: Number of environments.
        parameters: For all environments; they are part of the kernels.
        waypoints: The poses to visit; a goal that the task draws replaces the first.
        system: The kernels of a step on open ground.
        device: Name of the device, of Warp and of torch alike.

    Raises:
        Untraceable: If a kernel of the system cannot be traced; the message says why.
    """

    def __init__(
        self, num_envs: int, parameters: Parameters, waypoints: Sequence[Pose], *, system: System, device: str
    ) -> None:
        import torch
        import warp as wp

        wp.init()
        numbers = zip(layout_of(system).parameters.names, flatten(as_tuple(parameters)), strict=True)
        self._kernels = kernels_of(system, Case(tuple(numbers), (), len(waypoints)))
        self.num_envs, self.device, self._width = num_envs, torch.device(device), size_of(system.terms)
        whole, real = ({"dtype": dtype, "device": device} for dtype in (torch.int64, torch.float64))
        self.seeds, self.episodes = torch.zeros(num_envs, **whole), torch.zeros(num_envs, **whole)
        self._wrong = torch.zeros(1, dtype=torch.int32, device=device)
        self._held = {
            "state": torch.zeros(self._kernels.size * num_envs, **real),
            "keys": torch.zeros(num_envs, **whole),
            "waypoints": torch.tensor(waypoints, **real).reshape(-1, 1).repeat(1, num_envs).reshape(-1),
            "seeds": self.seeds,
            "episodes": self.episodes,
            "wrong": self._wrong,
        }
        self._memory = self._kernels.memory()
        for name, tensor in self._held.items():
            setattr(self._memory, name, wp.from_torch(tensor))

    def step(self, actions: Any) -> tuple[Any, Any]:
        """Advance all environments by one step.

        Args:
            actions: Shape (N, 2), float32, contiguous, on the device; clipped to [-1, 1].

        Returns:
            Observations, shape (N, K), and outcomes, shape (m, N), with a row for each of `OUTCOMES`: new tensors.
        """
        observations, outcomes = self.empty()
        self._launch(self._kernels.step, actions, observations, outcomes)
        return observations, outcomes

    def reset(self, mask: Any, observations: Any, outcomes: Any, *, begins: bool = True) -> None:
        """Start the episodes of ``seeds`` and ``episodes`` where a mask is true, and write their first observations.

        Args:
            mask: Shape (N,), boolean, on the device.
            observations: See `step`; what is outside the mask is left as it is.
            outcomes: The same.
            begins: Whether episodes start; otherwise those that go on are written again.
        """
        self._launch(self._kernels.reset, mask, begins, observations, outcomes)

    def empty(self) -> tuple[Any, Any]:
        """Return uninitialized observations and outcomes, in the shapes of `step`."""
        import torch

        observations = torch.empty((self.num_envs, self._width), dtype=torch.float32, device=self.device)
        return observations, torch.empty((len(OUTCOMES), self.num_envs), dtype=torch.float64, device=self.device)

    def take_wrong(self) -> int | None:
        """Return an environment whose action was not finite since the last call, or None; wait for the device."""
        row = int(self._wrong)
        self._wrong.zero_()
        return row - 1 if row else None

    def _launch(self, kernel: Any, *arguments: Any) -> None:
        """Run a kernel for each environment, in torch's order of work."""
        import warp as wp

        inputs = [x if isinstance(x, bool) else wp.from_torch(x, return_ctype=True) for x in arguments]
        stream = wp.stream_from_torch(self.device) if self.device.type == "cuda" else None
        inputs = [self.num_envs, self._memory, *inputs]
        wp.launch(kernel, self.num_envs, inputs=inputs, device=str(self.device), stream=stream)
