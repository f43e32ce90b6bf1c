"""Homogeneous transforms, shape (4, 4), as SDF states them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.config import LARGEST


class MalformedError(ValueError):
    """A number, a shape or a frame in a file is missing or malformed."""


def numbers_of(text: str | None, count: int, default: Sequence[float] = ()) -> list[float]:
    """Return the finite numbers of a text; the default if there is no text.

    Raises:
        MalformedError: If there is another count of numbers, or one is malformed or not finite.
    """
    if text is None or not text.strip():
        if default:
            return list(default)
        raise MalformedError(f"{count} numbers are missing")
    try:
        values = [float(word) for word in text.split()]
    except ValueError as error:
        raise MalformedError(str(error)) from error
    if len(values) != count or not all(abs(value) <= LARGEST for value in values):
        raise MalformedError(f"{' '.join(text.split())!r} must be {count} finite numbers of at most {LARGEST:g}")
    return values


def from_rpy(place: Sequence[float], angles: Sequence[float]) -> NDArray[np.float64]:
    """Return a transform by its place, m, and roll, pitch and yaw about fixed axes, rad."""
    (sr, sp, sy), (cr, cp, cy) = np.sin(angles), np.cos(angles)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr, place[0]],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr, place[1]],
            [-sp, cp * sr, cp * cr, place[2]],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )
