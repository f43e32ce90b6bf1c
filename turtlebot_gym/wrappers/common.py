"""What wrappers of scalar and of vector environments share: the arguments of users' functions."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from turtlebot_gym.validation import Range

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
