"""Open ground's machine code, chosen for parameters and called on arrays."""

from __future__ import annotations

import ctypes
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.compiled.ground import Case, Ground, ground_of
from turtlebot_gym.compiled.memory import BLOCK
from turtlebot_gym.compiled.packing import TILE, layout_of
from turtlebot_gym.compiled.threads import Threads
from turtlebot_gym.systems.system import System

_ACTIONS, _OBSERVATIONS, _OUTCOMES, _FIRST, _END, _FLAGGED, _BEGINS = map(
    BLOCK.index, ("actions", "observations", "outcomes", "first", "end", "flagged", "begins")
)
FEW = 16
"""Most environments of `GroundTracks.step_few`."""
FOLDED_FROM = 512
"""Batches below this size load shared parameters that are not whole numbers: code of their own would never pay for itself."""


def _allows(before: dict[str, Any], after: dict[str, Any]) -> bool:
    """Return whether numbers that are equal or constant in one case are so in another, so that episodes may go on there."""
    return all(
        before[name] == (before[what] if isinstance(what, str) else what) for name, what in after.items() if what != name
    )


def find_ground(
    system: System, num_envs: int, numbers: NDArray[np.float64], waypoints: int, before: Case | None, begun: bool
) -> tuple[Ground, Case]:
    """Return machine code for parameters, shape (1, K) or (N, K), and its case.

    Args:
        system: The system.
        num_envs: Number of environments.
        numbers: The parameters of all environments, or of one that stands for all, in the order of the layout.
        waypoints: Number of waypoints.
        before: The case of the present code, if there is one: what differs now and then, differs from now on.
        begun: Whether episodes go on.

    Raises:
        Untraceable: If a kernel cannot be traced.
    """
    names, first = layout_of(system).parameters.names, numbers[0].tolist()
    differing = {name for name, column in zip(names, numbers.T, strict=True) if (column != column[0]).any()}
    if num_envs < FOLDED_FROM:
        differing |= {name for name, value in zip(names, first, strict=True) if not value.is_integer()}
    if before is not None:
        known = dict(before.fixed)
        differing |= {name for name, value in zip(names, first, strict=True) if known.get(name, math.nan) != value}
    fixed = tuple((name, value) for name, value in zip(names, first, strict=True) if name not in differing)
    case = Case(fixed, tuple(name for name in names if name in differing), waypoints)
    ground = ground_of(system, case)
    if before is not None and begun:
        classes = ground_of(system, before).classes
        if not _allows(dict(classes), dict(ground.classes)):
            case = case._replace(before=classes)
            ground = ground_of(system, case)
    return ground, case


def _address(array: NDArray[Any]) -> int:
    """Return the address of a new array, in a third of the time of ``array.ctypes``."""
    return ctypes.addressof(ctypes.c_char.from_buffer(array))  # pyright: ignore[reportArgumentType]


class GroundTracks:
    """Calls of machine code for some environments.

    Args:
        ground: The machine code.
        shapes: Shapes of observations and of outcomes.
        shares: Whether outcomes have rows for the shares of the reward.
    """

    def __init__(self, ground: Ground, shapes: tuple[tuple[int, int], tuple[int, int]], shares: bool) -> None:
        (num_envs, _), _ = shapes
        self._ground, self._call, self._tiles = ground, ground.step, -(-num_envs // TILE)
        self._mask = np.zeros(self._tiles * TILE, np.bool_)
        self._shares, self._num_envs = shares, num_envs
        self._observations, self._outcomes = np.empty(shapes[0], np.float32), np.empty(shapes[1])

    def bind(self, tiles: Any, keys: Any, parameters: Any, stride: int, waypoints: Any, seeds: Any, episodes: Any) -> None:
        """Use some arrays from now on, see `memory.BLOCK`."""
        self._held = {
            "tiles": tiles, "keys": keys, "parameters": parameters, "waypoints": waypoints, "seeds": seeds,
            "episodes": episodes, "mask": self._mask, "observations": self._observations, "outcomes": self._outcomes,
        }  # fmt: skip
        values = {name: array.ctypes.data for name, array in self._held.items()}
        values |= {"stride": stride, "end": self._tiles, "environments": self._num_envs, "shares": int(self._shares)}
        numbers = [values.get(name, 0) for name in BLOCK]
        kind = ctypes.c_int64 * len(BLOCK)
        self._block, self._visit, self._parts = kind(*numbers), kind(*numbers), list[Any]()
        self._start, self._actions = ctypes.addressof(self._block), None

    def step_few(self, actions: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
        """Advance a few environments, whose results are faster to copy than the addresses of new arrays are to find."""
        if actions is not self._actions:
            self._actions, self._block[_ACTIONS] = actions, actions.ctypes.data
        self._call(self._start)
        return self._observations.copy(), self._outcomes.copy()

    def step(self, parts: int, actions: NDArray[np.float32], observations: Any, outcomes: Any) -> None:
        """Advance all environments, in some parts, each on a thread."""
        block = self._block
        if actions is not self._actions:
            self._actions, block[_ACTIONS] = actions, actions.ctypes.data
        block[_OBSERVATIONS], block[_OUTCOMES] = _address(observations), _address(outcomes)
        if parts == 1:
            self._call(self._start)
            return
        while len(self._parts) < parts:
            self._parts.append((ctypes.c_int64 * len(BLOCK))())
        for part, own in enumerate(self._parts[:parts]):
            own[:] = block[:]
            own[_FIRST], own[_END] = part * self._tiles // parts, (part + 1) * self._tiles // parts
        Threads.run(self._call, [ctypes.addressof(own) for own in self._parts[:parts]])

    def is_flagged(self, parts: int) -> bool:
        """Return whether the last step, in some parts, has set a flag of any environment."""
        return self._block[_FLAGGED] > 0 if parts == 1 else any(own[_FLAGGED] > 0 for own in self._parts[:parts])

    def reset(self, mask: NDArray[np.bool_], begins: bool, observations: Any, outcomes: Any) -> None:
        """Begin episodes where a mask is true, or write observations again."""
        self._mask[: self._num_envs] = mask
        block = self._visit
        block[_OBSERVATIONS], block[_OUTCOMES], block[_BEGINS] = observations.ctypes.data, outcomes.ctypes.data, int(begins)
        self._ground.reset(ctypes.addressof(block))
