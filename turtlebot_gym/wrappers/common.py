"""What wrappers of scalar and of vector environments share: the arguments of users' functions, and an additional sensor."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray

from turtlebot_gym.compiled.cache import in_machine_code
from turtlebot_gym.models.random import MAX_SEED, SENSOR, episode_key, normals, sub_key
from turtlebot_gym.validation import Range, whole

_MOST = 32
"""Most draws in a step: two from each of 16 streams."""
SHARE = Range(0.0, 1.0, open_low=True)
"""What the share of an action that is carried out in a step may be."""


class Moment(NamedTuple):
    """Observation and info between two steps."""

    observation: Any
    """The observation, or those of all rows, in float64."""
    info: dict[str, Any]
    """Contents of ``info``."""


class Transition(NamedTuple):
    """A step; for a vector environment, one step of each row, and the arrays have a leading axis."""

    before: Moment
    """Observation and info before the step."""
    action: Any
    """The action, in float64."""
    after: Moment
    """Observation and info after the step; the final ones if an episode ended."""
    reward: Any
    """Reward of the environment."""
    terminated: Any
    """Whether the episode terminated."""
    truncated: Any
    """Whether the episode was truncated."""


def doubled(value: Any) -> Any:
    """Return an array of floats in float64, and other values unchanged."""
    return value.astype(np.float64) if isinstance(value, np.ndarray) and value.dtype.kind == "f" else value


def moment(observation: Any, info: dict[str, Any]) -> Moment:
    """Return copies, since the originals may be overwritten before the next step."""
    return Moment(doubled(observation), _copied(info))


def _copied(info: dict[str, Any]) -> dict[str, Any]:
    copies = {dict: _copied, np.ndarray: np.copy}
    return {key: copies[type(value)](value) if type(value) in copies else value for key, value in info.items()}


def ask(function: Callable[..., Any], *arguments: Any) -> NDArray[np.float64]:
    """Return the numbers that a user's function computes.

    Raises:
        KeyError: If the function reads a key that ``info`` does not have.
    """
    try:
        return np.asarray(function(*arguments), np.float64)
    except KeyError as error:
        raise KeyError(f"info has no {error.args[0]!r}; vector environments tell more with info='full'.") from error


def require_box(space: spaces.Space, what: str, dimensions: int | None = None) -> spaces.Box:
    """Return a space if it is a box, with a given number of dimensions if any.

    Raises:
        ValueError: If it is not.
    """
    if not isinstance(space, spaces.Box) or dimensions not in (None, len(space.shape)):
        kind = "a Box" if dimensions is None else f"a Box of {dimensions} dimension"
        raise ValueError(f"The {what} space must be {kind}, got {space}.")
    return space


class Sensor:
    """Values that are appended to observations; their noise depends only on the seed, the episode and the step of a row.

    Args:
        observations: Space of one environment's observations.
        rows: Number of environments.
        measure: See `wrappers.AppendSensor`, as for the other arguments.

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
        whole("draws", draws, 0, _MOST)
        bottom, top = np.concatenate([box.low, self.low]), np.concatenate([box.high, self.high])
        self.space = spaces.Box(bottom.astype(np.float32), top.astype(np.float32))
        """Space of the longer observations."""
        self._measure, self._draws, self._seeded = measure, draws, False
        self._seeds, self._episodes, self._steps = np.zeros((3, rows), np.int64)

    def reset(self, env: Any, seed: Any, mask: NDArray[np.bool_]) -> None:
        """Begin the episodes of some rows; without seeds, with the environment's."""
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
        # Normal numbers are drawn in pairs.
        draws = np.empty((len(self._seeds), self._draws + self._draws % 2))
        if self._draws:
            _fill(self._seeds, self._episodes, self._steps, draws)
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


@in_machine_code("noise of wrappers")
def _fill(seeds, episodes, steps, draws):
    for row in range(len(seeds)):
        key = sub_key(episode_key(int(seeds[row]), int(episodes[row])), SENSOR)
        for stream in range(draws.shape[1] // 2):
            draws[row, 2 * stream], draws[row, 2 * stream + 1] = normals(key, int(steps[row]), stream)
