"""Tasks: the waypoints to reach, and when they count as reached. Their rules are pure functions."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any

from turtlebot_gym.config import FINITE, NON_NEGATIVE, POSITIVE, POSITIVE_OR_INFINITE, Numbers, Range, check_fields, refusal
from turtlebot_gym.kernel import algebra, kernel, sqrt
from turtlebot_gym.models.angles import PI, wrap
from turtlebot_gym.models.random import GOAL, START, uniforms
from turtlebot_gym.values import Pose, State


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
    laps: Annotated[int, Range(1, 10**9, whole=True)] = 1
    """Number of rounds through the waypoints; in a room, number of goals that are drawn in turn ..."""
    patience: Annotated[float, POSITIVE_OR_INFINITE] = math.inf
    """... and the time after which one of several that the robot does not reach is given up for the next, s."""
    max_steps: Annotated[float, POSITIVE_OR_INFINITE] = math.inf
    """Steps after which an episode is truncated; infinite to leave that to the environment."""

    def __post_init__(self) -> None:
        check_fields(self)
        if self.min_distance > self.arena:
            raise refusal("Task.min_distance", f"at most Task.arena, {self.arena:g} m", self.min_distance)


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

SQUARE_WAYPOINTS = (Pose(2.0, 0.0, 0.0), Pose(2.0, 2.0, PI / 2.0), Pose(0.0, 2.0, wrap(PI)), Pose(0.0, 0.0, -PI / 2.0))
"""The tutorial's square of 2 m."""
SQUARE_PERIOD = 15.0
"""The tutorial's time for each of its waypoints, s."""

TASKS: dict[str, Task] = {"nav": NAV, "pose": POSE, "square": SQUARE, "room": ROOM, "mission": MISSION}
"""Tasks by name."""


def given_pose(name: str, value: Any) -> Pose:
    """Return a start or a goal that is given as x and y, m, and perhaps a heading, rad, which is otherwise 0."""
    numbers = Numbers(FINITE).check(name, value)
    if len(numbers) not in (2, 3):
        raise refusal(name, "x, y and perhaps a heading", value)
    x, y, theta = (*numbers, 0.0)[:3]
    return Pose(x, y, wrap(theta))


@kernel
def start_pose(key: int, task: Task) -> Pose:
    """Return an episode's start pose: drawn if the task is random, else the origin."""
    u1, u2 = uniforms(key, 0, START)
    u3, _ = uniforms(key, 1, START)
    drawn = Pose((2.0 * u1 - 1.0) * task.arena, (2.0 * u2 - 1.0) * task.arena, wrap(2.0 * PI * u3))
    return drawn if task.random else Pose(0.0, 0.0, 0.0)


@kernel
def draw_goal(key: int, start: Pose, task: Task) -> Pose:
    """Draw a goal pose in the arena, at least `Task.min_distance` from the start.

    That distance is at most the arena's half side, so a draw is refused with probability below pi/4, and all of 64 with less
    than 2e-7; the last one is then used.
    """
    x, y = 0.0, 0.0
    for attempt in range(64):
        u1, u2 = uniforms(key, attempt, GOAL)
        x, y = (2.0 * u1 - 1.0) * task.arena, (2.0 * u2 - 1.0) * task.arena
        dx, dy = x - start.x, y - start.y
        if dx * dx + dy * dy >= task.min_distance * task.min_distance:
            break
    u3, _ = uniforms(key, 2, START)
    return Pose(x, y, wrap(2.0 * PI * u3))


@kernel
def distance_to(state: State, to: Pose) -> float:
    """Return the distance from a state to a point, m."""
    dx, dy = to.x - state.x, to.y - state.y
    return sqrt(dx * dx + dy * dy)


@kernel
def _is_at(state: State, reference: Pose, radius: float, task: Task) -> bool:
    turn = abs(wrap(reference.theta - state.theta))
    close = distance_to(state, reference) < radius
    return close and turn <= task.heading_tolerance and abs(state.omega) <= task.turn_tolerance


@kernel
def arrived(truth: State, reference: Pose, task: Task) -> bool:
    """Return whether a true state satisfies the task at a waypoint."""
    return _is_at(truth, reference, task.radius, task)


@kernel
def believed_to_arrive(believed: State, reference: Pose, task: Task) -> bool:
    """Return whether a believed state counts as arrived: it must be inside by the task's margin."""
    return _is_at(believed, reference, task.radius - min(task.margin, task.radius / 3.0), task)


@kernel
def by_time(task: Task) -> bool:
    """Return whether waypoints switch by time instead of on arrival."""
    return task.switch_period < math.inf


@kernel
def due(steps: float, visited: float, task: Task, dt: float) -> bool:
    """Return whether after so many steps of ``dt`` s it is time for the waypoint after the ``visited`` ones, reached or not."""
    # Half a step off the exact time, so that the result does not depend on rounding.
    return steps * dt > (visited + 1.0) * task.switch_period - 0.5 * dt


@kernel
def overdue(steps: float, task: Task, dt: float) -> bool:
    """Return whether a goal is to be given up that has been the current one for so many steps of ``dt`` s."""
    return steps * dt > task.patience - 0.5 * dt


@algebra
def remaining(truth: State, reference: Pose, following: Pose, done_with: bool) -> float:
    """Return the remaining distance up to the reference, m; negative beyond it.

    After the reference, the robot heads for the following waypoint. A cut corner then counts as progress, and the total
    progress of a course is its length whichever way it is driven: only time and effort differ.
    """
    dx, dy = following.x - reference.x, following.y - reference.y
    leg = sqrt(dx * dx + dy * dy)
    return distance_to(truth, following) - leg if done_with else distance_to(truth, reference)
