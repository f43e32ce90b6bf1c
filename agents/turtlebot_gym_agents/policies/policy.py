"""What a policy is: any callable from observations (..., 13) to actions (..., 2); one with memory also has ``reset(mask)``."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray


class Policy(Protocol):
    """What drives: a callable from observations, layout 1, to actions."""

    def __call__(self, observations: NDArray[np.float32], /) -> NDArray[np.float32]:
        """Return actions (..., 2) in [-1, 1], shares of the robot's limits, for observations (..., 13)."""
        ...


@runtime_checkable
class PolicyWithMemory(Policy, Protocol):
    """A policy that remembers."""

    def reset(self, mask: NDArray[np.bool_], /) -> None:
        """Forget what was observed where the mask (...) is true: an episode begins there."""
        ...
