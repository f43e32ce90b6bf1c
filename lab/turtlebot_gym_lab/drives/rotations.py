"""How messages state places and rotations, and whether their quaternions are rotations."""

from __future__ import annotations

import math
from typing import Any

ROUNDED = 0.05
"""Difference from 1 that the length of a quaternion may have."""


def place_of(message: Any) -> Any:
    """Return what of a message states a place; None if nothing does, or it is marked as not measured."""
    outer = getattr(message, "pose", None) or getattr(message, "transform", None) or getattr(message, "point", None)
    covariance = getattr(outer, "covariance", None)
    return None if covariance is not None and covariance[0] < 0.0 else getattr(outer, "pose", outer)  # so are lost ones marked


def rotation_of(place: Any) -> Any:
    """Return the quaternion of a place, or None."""
    return getattr(place, "orientation", None) or getattr(place, "rotation", None)


def is_unit(q: Any) -> bool:
    """Return whether a quaternion is a rotation: of length 1, but for rounding."""
    return q is not None and abs(math.hypot(q.w, q.x, q.y, q.z) - 1.0) < ROUNDED


class Rotations:
    """How the rotations of a topic's messages are stated."""

    def __init__(self) -> None:
        self.count = 0
        """Number of messages with a rotation."""
        self.bad = 0
        """Number of those that are none."""
        self.has_w = False
        """Whether any has a scalar part."""

    def hear(self, message: Any) -> None:
        """Take a message."""
        if (q := rotation_of(place_of(message))) is not None:
            self.count, self.bad, self.has_w = self.count + 1, self.bad + (not is_unit(q)), self.has_w or q.w != 0.0

    @property
    def are_unset(self) -> bool:
        """Whether those that look right do so by accident."""
        return 2 * self.bad > self.count or (self.bad > 0 and not self.has_w)
