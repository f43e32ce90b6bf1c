"""The rules by which rooms are drawn, and their presets."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

from turtlebot_gym.config import (
    LARGEST,
    NON_NEGATIVE,
    POSITIVE,
    POSITIVE_OR_INFINITE,
    PROBABILITY,
    Numbers,
    Range,
    check_fields,
    choose,
    refusal,
)

GIVEN, SCATTERED, OFFICE, CELLULAR = 0.0, 1.0, 2.0, 3.0
"""Kinds of rooms: a given one, obstacles at random places, rooms with doors, and caves by a cellular automaton."""
KINDS = {"given": GIVEN, "scattered": SCATTERED, "office": OFFICE, "cellular": CELLULAR}
MAX_CIRCLES, MAX_BOXES = 384, 80
"""Most obstacles drawn in a room; each takes its own draws, see `drawing`."""
MAX_HALF = 20.0
"""Greatest half extent of a drawn room, m: paths are found on a grid with cells of a few centimetres."""
ANYWHERE = (math.nan, math.nan, math.nan)
"""Placeholder for a pose to be drawn."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RoomRules:
    """Rules for drawing a room: its obstacles and walkers, and the robot's start and goal."""

    kind: float = SCATTERED
    """Kind of room, a value of `KINDS`."""
    half_length: Annotated[float, POSITIVE] = 2.5
    """Half the room's extent along x, m."""
    half_width: Annotated[float, POSITIVE] = 2.5
    """Half its extent along y, m."""
    circles: Annotated[tuple[float, ...], Numbers(NON_NEGATIVE, 2)] = (6.0, 14.0)
    """Fewest and most circles; the number is drawn uniformly."""
    boxes: Annotated[tuple[float, ...], Numbers(NON_NEGATIVE, 2)] = (0.0, 4.0)
    """Fewest and most boxes."""
    radius: Annotated[tuple[float, ...], Numbers(POSITIVE, 2)] = (0.1, 0.3)
    """Least and greatest radius of a circle, and half extent of a box, m."""
    total: Annotated[float, POSITIVE_OR_INFINITE] = math.inf
    """Most circles and boxes together; circles are left out beyond it."""
    speed: Annotated[tuple[float, ...], Numbers(NON_NEGATIVE, 2)] = (0.0, 0.0)
    """Least and greatest speed of circles that walk, m/s; 0 for static ones."""
    courtesy: Annotated[float, NON_NEGATIVE] = 0.0
    """Distance from a robot's centre within which walkers wait instead of coming nearer, m."""
    people: bool = False
    """Whether circles that walk are people, who walk back and forth between two places by the social force model, see
    `walking`. A person who touches a robot that stands is not counted as a collision."""
    blind: Annotated[float, PROBABILITY] = 0.0
    """Share of people who do not see the robot."""
    fill: Annotated[float, PROBABILITY] = 0.2
    """Share of cells filled before the automaton smooths them, for the kind "cellular"."""
    through: bool = False
    """Whether the robot starts in the first fifth of the room's length and its goal is in the last fifth."""
    min_distance: Annotated[float, NON_NEGATIVE] = 1.5
    """Least distance between start and goal, m."""
    max_distance: Annotated[float, POSITIVE_OR_INFINITE] = math.inf
    """Greatest distance between start and goal along each axis, m, if the start is known before the goal is drawn."""
    start: tuple[float, ...] = ANYWHERE
    """Start pose of the robot; NaN to draw it."""
    goal: tuple[float, ...] = ANYWHERE
    """Goal pose of the robot; NaN to draw it."""

    def __post_init__(self) -> None:
        check_fields(self)
        choose("RoomRules.kind", self.kind, dict.fromkeys(KINDS.values()))
        is_drawn = self.kind != GIVEN
        for name in ("circles", "boxes", "radius", "speed"):
            low, high = getattr(self, name)
            most = {"circles": MAX_CIRCLES, "boxes": MAX_BOXES}.get(name) if is_drawn else None
            if low > high or (most and (low % 1.0 or high % 1.0 or high > most)):
                limit = f" whole number, at most {most}" if most else " value"
                raise refusal(f"RoomRules.{name}", f"a least and a greatest{limit}", (low, high))
        for name in ("half_length", "half_width") if is_drawn else ():
            Range(0.0, MAX_HALF, unit="m").check(f"RoomRules.{name}", getattr(self, name))
        for name in ("start", "goal"):
            pose = getattr(self, name)
            if len(pose) != 3 or not (all(map(math.isnan, pose)) or all(abs(value) <= LARGEST for value in pose)):
                raise refusal(f"RoomRules.{name}", "a pose (x, y, theta), or NaN where it is drawn", pose)


ROOMS = {
    "clutter": RoomRules(),
    "dense": RoomRules(circles=(14.0, 14.0), boxes=(0.0, 4.0), total=14.0),
    "corridor": RoomRules(
        half_length=4.0, half_width=0.9, circles=(3.0, 7.0), boxes=(0.0, 2.0), radius=(0.08, 0.2), through=True
    ),
    "office": RoomRules(
        kind=OFFICE, half_length=3.75, half_width=2.5, circles=(0.0, 6.0), boxes=(0.0, 0.0), radius=(0.08, 0.2)
    ),
    "cellular": RoomRules(kind=CELLULAR, half_length=3.0, half_width=2.25, through=True),
    "crowd": RoomRules(circles=(4.0, 8.0), boxes=(0.0, 2.0), radius=(0.15, 0.25), speed=(0.05, 0.2), courtesy=0.4),
    "people": RoomRules(
        half_length=3.0,
        circles=(3.0, 6.0),
        boxes=(0.0, 3.0),
        radius=(0.2, 0.3),
        speed=(0.5, 1.4),
        min_distance=2.5,
        people=True,
        blind=0.25,
    ),
}
"""Rules by name."""
