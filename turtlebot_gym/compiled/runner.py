"""The loops of a batch: found for its parameters, and called on one thread or on several."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.compiled.loop import Loops, loops_of
from turtlebot_gym.compiled.packing import TILE, layout_of
from turtlebot_gym.compiled.program import Call, Program
from turtlebot_gym.compiled.proof import Case, case_of, own_of
from turtlebot_gym.compiled.threads import Threads
from turtlebot_gym.compiled.values import Untraceable
from turtlebot_gym.kernel import HAS_LLVM
from turtlebot_gym.systems import System

PARALLEL_FROM = 2048
"""Batches below this size run on one thread: splitting costs more than it saves."""
ROOMS_PARALLEL_FROM = 256
"""The same in rooms, where a step takes about ten times as long."""
FOLDED_FROM = 512
"""Batches below this size load shared parameters that are not whole numbers: code of their own would never pay for itself."""
CHANGING = {"step": (0, 5, 6), "reset": (0, 1, 8, 9)}
"""Arguments of the loops that differ from call to call: actions, or a mask and whether episodes begin; and results."""


class Runner:
    """The loops of a batch, which run as plain Python, after a warning, if they cannot be translated.

    Args:
        system: The kernels of a step.
        num_envs: Number of environments.
        shares: Whether outcomes have a row for the share of each term of the reward, too.

    Attributes:
        case: What the loops of open ground are made for.
        few: What `keep` has kept.
    """

    loops: Loops

    def __init__(self, system: System, num_envs: int, shares: bool) -> None:
        self._system, self._num_envs, self._shares = system, num_envs, shares
        self._n_tiles = -(-num_envs // TILE)
        self._is_compiled = system.compiled and HAS_LLVM
        self._is_parallel = num_envs >= (ROOMS_PARALLEL_FROM if system.in_room else PARALLEL_FROM)
        self.case: Case | None = None

    def find(self, numbers: NDArray[np.float64], waypoints: int, begun: bool) -> Sequence[int]:
        """Find the loops for some parameters, and return the indices of those that the loops load.

        Args:
            numbers: The parameters, shape (1, K) or (N, K).
            waypoints: Number of waypoints.
            begun: Whether an episode has begun.
        """
        if self._is_compiled and not self._system.in_room:
            small, old = self._num_envs < FOLDED_FROM, self.case if begun else None
            try:
                self.case = case_of(self._system, numbers, waypoints, small=small, old=old)
                names, own = layout_of(self._system).parameters.names, own_of(self._system, self.case)
                self._use(loops_of(self._system, self.case, self._shares))
                return [names.index(name) for name in own]
            except Untraceable as error:
                self.give_up(error)
        self._use(loops_of(self._system._replace(compiled=self._is_compiled), None, self._shares))
        return range(numbers.shape[1])

    def _use(self, loops: Loops) -> None:
        """Use other loops, or other arguments."""
        self.loops = loops
        self._calls: dict[Any, Sequence[Call]] = {}
        self._serial: Call | None = None
        self.few: tuple[Callable[[], int], NDArray[np.float32], NDArray[np.float64]] | None = None

    def give_up(self, error: Untraceable) -> None:
        """Find only loops in plain Python from now on, after a warning."""
        warnings.warn(f"turtlebot_gym: environments run as plain Python, since {error}.", RuntimeWarning, stacklevel=6)
        self._is_compiled = False

    def run(self, name: str, words: Sequence[int], *arguments: Any) -> int:
        """Run a loop over all tiles.

        Args:
            name: "step" or "reset".
            words: Numbers, and addresses of arrays, of the arguments that differ from call to call: `CHANGING`.
            *arguments: All arguments after the numbers of the tiles.

        Raises:
            Untraceable: If the loop cannot be translated; nothing has run then.
        """
        if name == "step" and self._serial is not None:  # most steps, in half the time
            return self._with(words, name, self._serial).count()
        loop = getattr(self.loops, name)
        if not isinstance(loop, Program):
            return loop(0, self._n_tiles, *arguments) or 0
        if self._is_parallel:
            with Threads.taken() as parts:
                calls = self._calls_of(name, parts, loop, words, arguments)
                return sum(Threads.run([call.count for call in calls]))
        (call,) = self._calls_of(name, 1, loop, words, arguments)
        if name == "step":
            self._serial = call
        return call.count()

    def _calls_of(
        self, name: str, parts: int, loop: Program, words: Sequence[int], arguments: tuple[Any, ...]
    ) -> Sequence[Call]:
        """Return the calls of a loop over all tiles in some parts, each for a thread."""
        *_, observations, outcomes, _ = arguments
        key = name, parts, observations.strides, outcomes.strides
        if not (calls := self._calls.get(key, ())):
            bounds = [part * self._n_tiles // parts for part in range(parts + 1)]
            calls = self._calls[key] = [Call(loop, (*bounds[part : part + 2], *arguments)) for part in range(parts)]
        return [self._with(words, name, call) for call in calls]

    @staticmethod
    def _with(words: Sequence[int], name: str, call: Call) -> Call:
        """Return a call after the words of what changes are put into it."""
        for at, word in zip(CHANGING[name], words, strict=True):
            call.put(2 + at, word)
        return call

    def keep(self, *arguments: Any) -> None:
        """Let each later step of compiled loops use the same arrays again: the fewer there are, the more finding them costs."""
        if isinstance(self.loops.step, Program):
            *_, observations, outcomes, _ = arguments
            self.few = Call(self.loops.step, (0, self._n_tiles, *arguments)).count, observations, outcomes
