"""Noise for wrappers: draws that depend only on the seed, the episode and the step of a row."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.compiled.cache import compiled, fingerprint
from turtlebot_gym.models.random import MAX_SEED, SENSOR, episode_key, normals, sub_key

MOST = 32
"""Most draws in a step: two from each of 16 streams."""


def _rows(identity: str) -> Callable[..., None]:
    def fill(seeds, episodes, steps, found):
        identity  # noqa: B018  # pyright: ignore[reportUnusedExpression]  # part of the cache's key
        for row in range(len(seeds)):
            key = sub_key(episode_key(int(seeds[row]), int(episodes[row])), SENSOR)
            for stream in range(found.shape[1] // 2):
                one, other = normals(key, int(steps[row]), stream)
                found[row, 2 * stream], found[row, 2 * stream + 1] = one, other

    return fill


@cache
def _filler() -> Callable[..., None]:
    identity = fingerprint(_rows(""))
    return compiled(_rows(identity), parallel=False)


class Draws:
    """Standard normal numbers for each step of each row.

    Args:
        rows: Number of environments.
        number: Number of draws per environment and step, at most `MOST`.

    Raises:
        ValueError: If ``number`` is larger.
    """

    def __init__(self, rows: int, number: int) -> None:
        if not 0 <= number <= MOST:
            raise ValueError(f"draws must be from 0 to {MOST}, got {number!r}.")
        self._number = number
        self.seeded = False
        self._seeds, self._episodes, self._steps = np.zeros((3, rows), np.int64)

    def begin(self, mask: NDArray[np.bool_], seeds: Sequence[int | None] | None = None) -> None:
        """Begin the episodes of some rows: the first one of a given seed, otherwise the next one."""
        self._episodes[mask] += 1
        self._steps[mask] = 0
        for row, seed in enumerate(seeds or ()):
            if mask[row] and seed is not None:
                self._seeds[row], self._episodes[row] = int(seed) & MAX_SEED, 0
        self.seeded = True

    def advance(self, mask: NDArray[np.bool_]) -> None:
        """Advance some rows to their next step."""
        self._steps[mask] += 1

    def now(self) -> NDArray[np.float64]:
        """Return the draws of all rows at their current steps, shape (N, number)."""
        found = np.empty((len(self._seeds), self._number + self._number % 2))
        if self._number:
            _filler()(self._seeds, self._episodes, self._steps, found)
        return found[:, : self._number]
