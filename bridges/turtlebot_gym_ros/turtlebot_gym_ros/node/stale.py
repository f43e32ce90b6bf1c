"""The inputs of a `rosnode.ROSNode`: their latest arrays, and what follows where one is stale."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.config import POSITIVE, choose
from turtlebot_gym_ros.node.arrays import read_array

POLICIES = {name: name for name in ("zero", "hold", "drop")}
"""What follows where an input is stale: its zeros, its last value, or nothing."""


@dataclass(frozen=True, kw_only=True)
class Stale:
    """When an input is stale, and what follows: a value of ``stale_config``."""

    after: float | None = None
    """Age from which it is stale, s; None for never."""
    policy: str = "drop"
    """One of `POLICIES`."""
    use_header_stamp: bool = False
    """Whether the age counts from the header's stamp, by the ROS clock, instead of from its arrival."""

    def __post_init__(self) -> None:
        if self.after is not None:
            POSITIVE.check("after", self.after)
        choose("policy", self.policy, POLICIES)


class Received:
    """Latest array of an input.

    Args:
        fields: Fields of its messages, see `arrays.ARRAYS`.
        stale: When it is stale.
        timeout: Age beyond which a heartbeat is missed, s; None for none.
    """

    def __init__(self, fields: tuple[str, ...], stale: Stale, timeout: float | None) -> None:
        self.fields, self.stale, self.timeout = fields, stale, timeout
        self.value: NDArray[np.float64] | None = None
        self.arrived = self.stamp = 0.0
        self.count = 0

    def read(self, message: Any) -> tuple[()]:
        """Store a message's array."""
        self.value, self.arrived = read_array(message, self.fields), time.monotonic()
        self.count += 1
        if hasattr(message, "header"):
            self.stamp = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
        return ()

    def take(self, ros_time: float) -> NDArray[np.float64] | None:
        """Return what the callback gets now; None for nothing."""
        if self.value is None:
            return None
        by_header = self.stale.use_header_stamp and self.stamp > 0.0
        age = ros_time - self.stamp if by_header else time.monotonic() - self.arrived
        if self.stale.after is None or age <= self.stale.after or self.stale.policy == "hold":
            return self.value.copy()
        return np.zeros_like(self.value) if self.stale.policy == "zero" else None
