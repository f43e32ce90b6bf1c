"""A policy is any callable from observations (..., n) to actions (..., 2); one with memory also has ``reset(mask)``.

Its attribute ``layout`` says how many numbers it observes: 1 for the 13 of open ground, 2 for the 50 of a room, 3
for the 54 of a robot that localizes itself. A policy without the attribute takes the first 13 of any.
"""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.systems import SIZES


class Policy(Protocol):
    """A callable from observations to actions."""

    def __call__(self, observations: NDArray[np.float32], /) -> NDArray[np.float32]:
        """Return actions (..., 2) in [-1, 1], shares of the robot's limits, for observations (..., n)."""
        ...


@runtime_checkable
class PolicyWithMemory(Policy, Protocol):
    """A policy with memory."""

    def reset(self, mask: NDArray[np.bool_], /) -> None:
        """Clear the memory where the mask (...) is true, because an episode begins there."""
        ...


@runtime_checkable
class ShrinkingPolicy(PolicyWithMemory, Protocol):
    """A policy with memory that can drop some of its rows: evaluations drop the episodes that have ended."""

    def keep(self, mask: NDArray[np.bool_], /) -> None:
        """Drop the rows of the memory where the mask (n,) is false."""
        ...


def layout_of(policy: object) -> int | None:
    """Return the observation layout of a policy, or of a class of policies; None if it has none.

    Raises:
        ValueError: If the layout is unknown.
    """
    layout = getattr(policy, "layout", None)
    if layout is not None and layout not in SIZES:
        raise ValueError(f"a policy's layout must be one of {', '.join(map(str, SIZES))}, got {layout!r}.")
    return layout
