"""Stages between an environment's observation and a network: normalization by statistics, and a stack of observations.

Each is a torch module, which becomes a part of the bundle. One with ``memory`` also maps the numbers that it carries from a
step to the next; they are zeros where an episode begins.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from turtlebot_gym.observations import OPEN_GROUND, ROOM, size_of
from turtlebot_gym_agents.policies.fit import MISSIONS, OPEN, ROOMS


def other_size(size: int, env: str, got: object) -> ValueError:
    """Return the error for a model that does not read observations of so many numbers."""
    tasks = {size_of(OPEN_GROUND): OPEN, size_of(ROOM): (ROOMS, MISSIONS)}
    fits = f" ({got} are those of {', '.join(tasks[got])})" if isinstance(got, int) and got in tasks else ""
    return ValueError(
        f"model must map observations ({size},) of {env}, or a stack of them, to actions (2,), got observations "
        f"({got},){fits}: name the task that it was trained in with --env, and its terms with --observation."
    )


class Normalization(nn.Module):
    """Shift, scale and clip observations by statistics of `VecNormalize` or of Gymnasium's `NormalizeObservation`.

    Both compute in the precision of their statistics: in that of the observations, constant ones would be scaled to rounding
    errors.
    """

    memory = 0
    mean: torch.Tensor
    scale: torch.Tensor

    def __init__(self, mean: NDArray[Any], scale: NDArray[Any], clip: float) -> None:
        super().__init__()
        self.clip, self.size = clip, len(mean)
        self.register_buffer("mean", torch.from_numpy(mean))
        self.register_buffer("scale", torch.from_numpy(scale))

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        scaled = (observation.to(self.mean.dtype) - self.mean) / self.scale
        return (scaled.clamp(-self.clip, self.clip) if np.isfinite(self.clip) else scaled).float()


def normalization_of(source: Any) -> Normalization | None:
    """Return the normalization of observations by an object with statistics; None if it only normalizes rewards.

    Args:
        source: A `VecNormalize` of Stable-Baselines3, or a `NormalizeObservation` of Gymnasium.

    Raises:
        ValueError: If it holds no statistics of one-dimensional observations.
    """
    if not getattr(source, "norm_obs", True):
        return None
    statistics, name = getattr(source, "obs_rms", None), type(source).__name__
    mean = np.asarray(getattr(statistics, "mean", None))
    if mean.ndim != 1 or mean.dtype.kind != "f":
        raise ValueError(
            f"vec_normalize must hold statistics of one-dimensional observations, as VecNormalize of Stable-Baselines3 and "
            f"NormalizeObservation of Gymnasium do, got {name}."
        )
    scale = np.sqrt(np.asarray(statistics.var) + source.epsilon).astype(mean.dtype)  # pyright: ignore[reportOptionalMemberAccess]
    if not (np.isfinite(mean).all() and np.isfinite(scale).all() and (scale > 0.0).all()):
        raise ValueError(f"vec_normalize must hold finite statistics, got a {name} whose mean or variance is not.")
    return Normalization(mean.copy(), scale, float(getattr(source, "clip_obs", np.inf)))


class FrameStack(nn.Module):
    """The last ``count`` observations as one, the newest last, as `VecFrameStack` of Stable-Baselines3 has them."""

    def __init__(self, count: int, size: int) -> None:
        super().__init__()
        self.count, self.size = count, size
        self.memory = (count - 1) * size

    def forward(self, observation: torch.Tensor, past: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        stack = torch.cat((past, observation), dim=-1)
        return stack, stack[:, self.size :]


class Staged(nn.Module):
    """A network behind its stages, with actions clipped to [-1, 1] and one memory of all numbers that a part carries."""

    def __init__(self, stages: Sequence[nn.Module], network: nn.Module, memory: int) -> None:
        super().__init__()
        self.parts = nn.ModuleList([*stages, network])
        widths = [int(stage.memory) for stage in stages]  # pyright: ignore[reportArgumentType]
        self.widths = [*widths, memory]
        self.memory = sum(self.widths)

    def forward(self, observation: torch.Tensor, memory: torch.Tensor | None = None) -> Any:
        past = [] if memory is None else list(memory.split([width for width in self.widths if width], dim=-1))
        after: list[torch.Tensor] = []
        for part, width in zip(self.parts, self.widths, strict=True):
            if width:
                observation, rest = part(observation, past.pop(0))
                after.append(rest)
            else:
                observation = part(observation)
        action = observation.clamp(-1.0, 1.0)
        return (action, torch.cat(after, dim=-1)) if after else action
