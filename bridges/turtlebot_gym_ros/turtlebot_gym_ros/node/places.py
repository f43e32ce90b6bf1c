"""The places that a robot, a goal or an obstacle may have. Does not depend on ROS."""

from __future__ import annotations

import math
from collections.abc import Iterable

from turtlebot_gym.values import Pose

FARTHEST = 1e5
"""Distance from the origin along an axis beyond which no robot, goal or obstacle is, m."""


def finite(what: str, numbers: Iterable[float], *, most: float = math.inf) -> None:
    """Raise a ``ValueError`` that shows the values if numbers are not finite, or larger than a limit."""
    values = tuple(numbers)
    if not all(map(math.isfinite, values)):
        shown = values if len(values) < 10 else [value for value in values if not math.isfinite(value)][:3]
        raise ValueError(f"{what} must be finite, got {', '.join(f'{value:g}' for value in shown)}")
    if (largest := max(values, key=abs)) and abs(largest) > most:
        raise ValueError(f"{what} holds {largest:g}, and nothing is beyond {most:g}: is it in SI units?")


def place(x: float, y: float, theta: float) -> Pose:
    """Return a planar pose, or raise ``ValueError``: every place that arrives or leaves is checked here."""
    pose = Pose(x, y, theta)
    finite("the pose", pose, most=FARTHEST)
    return pose
