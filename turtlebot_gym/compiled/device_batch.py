"""A batch of environments on a device of NVIDIA Warp: tensors of torch that stay there, and the kernels that work on them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from turtlebot_gym.compiled.device import FLAGS, NUMBERS, kernels_of
from turtlebot_gym.compiled.ground import Case
from turtlebot_gym.compiled.packing import as_tuple, flatten, layout_of
from turtlebot_gym.observations import size_of
from turtlebot_gym.systems import Parameters, System
from turtlebot_gym.values import Pose

THREADS = 64
"""Threads of a block on a GPU: a step takes so many registers that larger blocks leave a multiprocessor half empty."""


class Results(NamedTuple):
    """Tensors of one or two copies of all environments; the second is that of the end of an episode."""

    observations: Any
    """Shape (c, N, K), float32."""
    numbers: Any
    """Shape (c, 2, N), float64, with a row for each of `NUMBERS`."""
    flags: Any
    """Shape (c, 4, N), boolean, with a row for each of `FLAGS`."""


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
        self._nowhere = torch.zeros(num_envs, dtype=torch.bool, device=device)
        self._wrong = torch.zeros(1, dtype=torch.int32, device=device)
        self._held = {
            "state": torch.zeros(self._kernels.size * num_envs, **real),
            "keys": torch.zeros(num_envs, **whole),
            "waypoints": torch.tensor(waypoints, **real).reshape(-1, 1).repeat(1, num_envs).reshape(-1),
            "seeds": self.seeds,
            "episodes": self.episodes,
            "wrong": self._wrong,
        }
        self._launches: dict[Any, Any] = {}
        self._memory = self._kernels.memory()
        for name, tensor in self._held.items():
            setattr(self._memory, name, wp.from_torch(tensor))

    def step(self, actions: Any, mask: Any = None) -> Results:
        """Advance all environments by one step, and begin the next episode of some.

        Args:
            actions: Shape (N, 2), float32, contiguous, on the device; clipped to [-1, 1].
            mask: Where an episode begins, shape (N,), boolean; None for where one has ended.

        Returns:
            New tensors, without a mask two copies; last distances and successes are zero where no episode has ended.
        """
        at_once = mask is None
        results = self.empty(1 + at_once)
        self._launch(self._kernels.step, self._nowhere if at_once else mask, at_once, actions, *results)
        return results

    def reset(self, mask: Any, results: Results, *, begins: bool = True) -> None:
        """Start the episodes of ``seeds`` and ``episodes`` where a mask is true, and write their first observations.

        Args:
            mask: Shape (N,), boolean, on the device.
            results: One copy, to write to; what is outside the mask is left as it is.
            begins: Whether episodes start; otherwise those that go on are written again.
        """
        self._launch(self._kernels.reset, mask, begins, *results)

    def empty(self, copies: int = 1) -> Results:
        """Return uninitialized results."""
        import torch

        count, device = self.num_envs, self.device
        return Results(
            torch.empty((copies, count, self._width), dtype=torch.float32, device=device),
            torch.empty((copies, len(NUMBERS), count), dtype=torch.float64, device=device),
            torch.empty((copies, len(FLAGS), count), dtype=torch.bool, device=device),
        )

    def take_wrong(self) -> int | None:
        """Return an environment whose action was not finite since the last call, or None; wait for the device."""
        row = int(self._wrong)
        self._wrong.zero_()
        return row - 1 if row else None

    def _launch(self, kernel: Any, *arguments: Any) -> None:
        """Run a kernel for each environment, in torch's order of work."""
        import warp as wp

        inputs = [x if isinstance(x, bool) else wp.from_torch(x, return_ctype=True) for x in arguments]
        if kernel not in self._launches:
            given = [self.num_envs, self._memory, *inputs]
            self._launches[kernel] = wp.launch(
                kernel, self.num_envs, inputs=given, device=str(self.device), block_dim=THREADS, record_cmd=True
            )
        launch = self._launches[kernel]
        for at, value in enumerate(inputs, start=2):
            launch.set_param_at_index_from_ctype(at, value)
        launch.launch(wp.stream_from_torch(self.device) if self.device.type == "cuda" else None)
