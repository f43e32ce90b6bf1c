"""Networks of any library that computes with torch: modules, and callables of tensors."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from numpy.typing import NDArray
from torch import nn

from turtlebot_gym_agents.training.stages import Normalization


class Called(nn.Module):
    """A callable of tensors as a module."""

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__()
        self.function = function

    def forward(self, *tensors: torch.Tensor) -> Any:
        return self.function(*tensors)


class TorchPolicy:
    """A torch network as a policy with memory, computed by torch itself.

    Args:
        network: A map from float32 observations (n, k) to actions (n, 2); with memory, from observations and memory (n, m) to
            both. It is left in evaluation mode.
        normalization: Normalization of observations before it; None for none.
        memory: Numbers of its memory.
    """

    def __init__(self, network: nn.Module, normalization: Normalization | None, memory: int) -> None:
        self._network, self._normalization = network.cpu().eval(), normalization
        self._width, self._memory = memory, torch.zeros(0, memory)

    def reset(self, mask: NDArray[np.bool_]) -> None:
        if len(self._memory) != len(mask):
            self._memory = torch.zeros(len(mask), self._width)
        self._memory[torch.from_numpy(mask)] = 0.0

    def try_on(self, space: spaces.Box) -> None:
        """Raise ValueError unless it gives reproducible actions for observations of a space."""
        rows, answers = np.stack([space.sample() for _ in range(3)]).astype(np.float32), list[NDArray[np.float32]]()
        for _ in range(2):
            self.reset(np.ones(len(rows), np.bool_))
            answers.append(self(rows))
        if not np.array_equal(answers[0], answers[1]):
            raise ValueError("model must act reproducibly, but gives two actions for one observation: export its mean action.")

    def __call__(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return actions (n, 2).

        Raises:
            ValueError: If the network fails, or returns something else.
        """
        rows, layer = torch.from_numpy(np.asarray(observations, np.float32)), self._normalization
        with torch.no_grad():
            seen = rows if layer is None else layer(rows)
            try:
                answer = self._network(seen, self._memory) if self._width else self._network(seen)
            except Exception as error:  # it is somebody else's
                reason = " ".join(f"{type(error).__name__}: {error}".split())[:200]
                raise ValueError(
                    f"model must be a map from observations (n, {rows.shape[1]}) to actions (n, 2), but fails: {reason}: "
                    "name the part that acts, such as export(agent.actor_mean, ...)."
                ) from error
        if self._width and isinstance(answer, (tuple, list)) and len(answer) == 2:
            answer, self._memory = answer
            if self._memory.shape != (len(rows), self._width):
                raise ValueError(f"network must give a memory (n, {self._width}), got {tuple(self._memory.shape)}.")
        if isinstance(answer, (tuple, list)):
            raise ValueError(
                f"network must give actions alone, got {len(answer)} values: choose one, as export(lambda o: network(o)[0], "
                "...) does; a recurrent one needs memory=..., the size of its state."
            )
        if not isinstance(answer, torch.Tensor) or answer.shape != (len(rows), 2):
            shape = tuple(answer.shape) if isinstance(answer, torch.Tensor) else type(answer).__name__
            raise ValueError(f"network must give actions (n, 2), got {shape} for {len(rows)} observations.")
        return np.clip(answer.float().numpy(), -1.0, 1.0)
