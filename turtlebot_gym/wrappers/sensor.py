"""An additional sensor, the same for a scalar environment and for many rows."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray

from turtlebot_gym.compiled.cache import compiled
from turtlebot_gym.models.random import MAX_SEED, SENSOR, episode_key, normals, sub_key
from turtlebot_gym.wrappers.transition import ask, require_box

_MOST = 32
"""Most draws in a step: two from each of 16 streams."""


class Sensor:
    """Values that are appended to observations; their noise depends only on the seed, the episode and the step of a row.

    Args:
        observations: Space of one environment's observations.
        rows: Number of environments.
        measure: See `wrappers.AppendSensor`, as for the other arguments.
        low: See there.
        high: See there.
        draws: See there.

    Raises:
        ValueError: If the observations are no Box of one dimension, or the bounds or the number of draws are invalid.
    """

    def __init__(
        self, observations: spaces.Space, rows: int, measure: Callable[..., Any], low: ArrayLike, high: ArrayLike, draws: int
    ) -> None:
        box = require_box(observations, "observation", 1)
        self.low, self.high = (np.atleast_1d(np.asarray(bound, np.float32)) for bound in (low, high))
        if self.low.shape != self.high.shape or self.low.ndim != 1 or not (self.low <= self.high).all():
            raise ValueError(f"low and high must be numbers of a sensor, low at most high, got {low!r} and {high!r}.")
        if not 0 <= draws <= _MOST:
            raise ValueError(f"draws must be from 0 to {_MOST}, got {draws!r}.")
        bottom, top = np.concatenate([box.low, self.low]), np.concatenate([box.high, self.high])
        self.space = spaces.Box(bottom.astype(np.float32), top.astype(np.float32))
        """Space of the longer observations."""
        self._measure, self._draws, self._seeded = measure, draws, False
        self._seeds, self._episodes, self._steps = np.zeros((3, rows), np.int64)

    def reset(self, env: Any, seed: Any, mask: NDArray[np.bool_]) -> None:
        """Begin the episodes of some rows after a reset of their environment, whose own seeds are used where none is given."""
        rows = len(self._seeds)
        seeds = _seeds_of(seed, rows)
        if not self._seeded and None in seeds:
            own = _seeds_of(env.unwrapped.np_random_seed, rows)
            seeds = [drawn if given is None else given for given, drawn in zip(seeds, own, strict=True)]
        self.begin(mask)
        for row, given in enumerate(seeds):
            if mask[row] and given is not None:
                self._seeds[row], self._episodes[row] = int(given) & MAX_SEED, 0
        self._seeded = True

    def begin(self, mask: NDArray[np.bool_]) -> None:
        """Begin the next episodes of some rows."""
        self._episodes[mask] += 1
        self._steps[mask] = 0

    def advance(self, mask: NDArray[np.bool_]) -> None:
        """Advance some rows to their next step."""
        self._steps[mask] += 1

    def values(self, info: dict[str, Any], *, alone: bool = False) -> NDArray[np.float32]:
        """Return the values of all rows, shape (N, k), or of the only one, shape (k,), clipped to the bounds.

        Raises:
            ValueError: If the function returns another shape.
        """
        draws = np.empty((len(self._seeds), self._draws + self._draws % 2))
        if self._draws:
            _filler()(self._seeds, self._episodes, self._steps, draws)
        draws = draws[0, : self._draws] if alone else draws[:, : self._draws]
        numbers, shape = ask(self._measure, info, draws), (*draws.shape[:-1], len(self.low))
        if numbers.shape != shape:
            raise ValueError(f"measure must return shape {shape}, as low and high say, got {numbers.shape}.")
        return np.clip(numbers, self.low, self.high).astype(np.float32)


def _seeds_of(seed: Any, rows: int) -> list[int | None]:
    """Return the seed of each row: a number stands for ``seed + i``."""
    if seed is None:
        return [None] * rows
    return [seed + row for row in range(rows)] if isinstance(seed, (int, np.integer)) else list(seed)


def _fill(seeds, episodes, steps, draws):
    for row in range(len(seeds)):
        key = sub_key(episode_key(int(seeds[row]), int(episodes[row])), SENSOR)
        for stream in range(draws.shape[1] // 2):
            draws[row, 2 * stream], draws[row, 2 * stream + 1] = normals(key, int(steps[row]), stream)


@cache
def _filler() -> Callable[..., None]:
    return compiled(_fill, "noise of wrappers")
