"""Faults of a part of a LiDAR: a sector that returns nothing, for good or now and then, or stands still; see `faults_kinds`.

A LiDAR that is covered says so nowhere: its driver sends 0, or infinity, as for a free hall.
"""

from __future__ import annotations

import math
import random
import time
from collections.abc import Callable
from typing import Any

from faults_robot import Fault, Robot
from faults_walls import AHEAD, post_beside, towards_wall, within
from faults_world import ROUGHNESS

WIDTHS = math.radians(40.0), math.radians(180.0)
"""Least and greatest width of a sector, rad."""


def silent(center: float, rng: random.Random) -> Callable[[Any], Any]:
    """Return the change by which a sector around a direction, rad, returns nothing, as 0 or as infinity."""
    inside, nothing = within(center, rng.uniform(*WIDTHS)), rng.choice([0.0, math.inf])

    def cover(message: Any) -> Any:
        message.ranges = [nothing if there else distance for distance, there in zip(message.ranges, inside, strict=True)]
        return message

    return cover


def silent_ahead(robot: Robot, rng: random.Random) -> list[str]:
    """The sector ahead returns nothing, and the robot drives towards a wall."""
    return towards_wall(robot, silent(AHEAD, rng))


def silent_beside(side: float) -> Fault:
    """Return the fault in which a sector to a side, 1 for the left, is silent, and a person drives around a post there."""

    def fault(robot: Robot, rng: random.Random) -> list[str]:
        post_beside(robot, rng, side)
        return towards_wall(robot, silent(side * 0.5 * math.pi, rng))

    return fault


def silent_now_and_then(robot: Robot, rng: random.Random) -> list[str]:
    """The sector ahead returns nothing for 0.5 to 3 s, measures for as long, and so on."""
    cover, period, since = silent(AHEAD, rng), rng.uniform(0.5, 3.0), time.time()
    return towards_wall(robot, lambda message: message if (time.time() - since) // period % 2 else cover(message))


def frozen_ahead(robot: Robot, rng: random.Random) -> list[str]:
    """The sector ahead repeats its last ranges, in half of the cases with a noise, and the rest of the scan is true."""
    inside, noise, kept = within(AHEAD, rng.uniform(*WIDTHS)), rng.choice([0.0, ROUGHNESS]), list[Any]()

    def freeze(message: Any) -> Any:
        kept.append(message.ranges)
        message.ranges = [
            old + rng.gauss(0.0, noise) if there else new
            for old, new, there in zip(kept[0], message.ranges, inside, strict=True)
        ]
        return message

    return towards_wall(robot, freeze)
