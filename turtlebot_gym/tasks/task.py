"""Tasks: the waypoints to reach, when they count as reached, and when an episode ends."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

from turtlebot_gym.models.angles import PI, wrap
from turtlebot_gym.validation import NON_NEGATIVE, ONE_OR_MORE, POSITIVE, POSITIVE_OR_INFINITE, typed
from turtlebot_gym.values import Pose


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """Conditions for reaching waypoints and for the end of an episode."""

    random: bool = True
    """Whether start pose and goal are drawn in the arena; if not, the robot starts at the origin and has given waypoints."""
    arena: Annotated[float, POSITIVE] = 2.0
    """Half the side of the square in which starts and goals are drawn, m."""
    min_distance: Annotated[float, NON_NEGATIVE] = 0.5
    """Least distance between a drawn start and its goal, m."""
    radius: Annotated[float, POSITIVE] = 0.15
    """A waypoint is reached within this distance, m ..."""
    heading_tolerance: Annotated[float, POSITIVE_OR_INFINITE] = math.inf
    """... this heading error, rad ..."""
    turn_tolerance: Annotated[float, POSITIVE_OR_INFINITE] = math.inf
    """... and at most this turning rate, rad/s."""
    on_belief: bool = False
    """Whether the pose that the policy observes, instead of the true one, decides on arrival, as in a node ..."""
    margin: Annotated[float, NON_NEGATIVE] = 0.05
    """... and this margin by which it must be inside, m, at most a third of the radius: a robot whose belief is only just
    inside is outside half of the time."""
    start_known: bool = True
    """Whether a localizer knows where the robot starts."""
    switch_period: Annotated[float, POSITIVE_OR_INFINITE] = math.inf
    """Time after which the next waypoint becomes current, reached or not, s; infinite to switch on arrival."""
    laps: Annotated[int, ONE_OR_MORE] = 1
    """Number of rounds through the waypoints; in a room, number of goals that are drawn in turn ..."""
    patience: Annotated[float, POSITIVE_OR_INFINITE] = math.inf
    """... and the time after which one of several that the robot does not reach is given up for the next, s."""
    max_steps: Annotated[float, POSITIVE_OR_INFINITE] = math.inf
    """Steps after which an episode is truncated; infinite to leave that to the environment."""

    def __post_init__(self) -> None:
        typed(self)
        if not self.min_distance <= self.arena:
            raise ValueError(f"Task.min_distance must be at most arena, got {self.min_distance!r} > {self.arena!r}.")


NAV = Task(max_steps=300.0)
"""A goal point: its heading is observed but not judged."""
POSE = Task(heading_tolerance=0.2, turn_tolerance=0.5, max_steps=300.0)
"""A goal pose, to be reached with the right heading and without spinning."""
SQUARE = Task(random=False, radius=0.3, max_steps=600.0)
"""Given waypoints, to be reached in order."""

ROOM = Task(radius=0.2, max_steps=600.0)
"""A goal point in a room, which determines start and goal."""
MISSION = Task(radius=0.2, on_belief=True, laps=1000, patience=60.0, max_steps=6000.0)
"""Goals in a room, one after another until the time is over."""

SQUARE_WAYPOINTS = (
    Pose(2.0, 0.0, 0.0),
    Pose(2.0, 2.0, PI / 2.0),
    Pose(0.0, 2.0, wrap(PI)),
    Pose(0.0, 0.0, -PI / 2.0),
)
"""The tutorial's square of 2 m."""
SQUARE_PERIOD = 15.0
"""The tutorial's time for each of its waypoints, s."""


TASKS: dict[str, Task] = {"nav": NAV, "pose": POSE, "square": SQUARE, "room": ROOM, "mission": MISSION}
"""Tasks by name."""
