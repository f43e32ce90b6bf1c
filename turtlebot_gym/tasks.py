"""Tasks: where a robot starts, which waypoints it has to reach, what it observes, and what that is worth."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from turtlebot_gym.kernel import kernel, sqrt
from turtlebot_gym.models.angles import PI, sincos, wrap
from turtlebot_gym.models.random import GOAL, START, uniforms
from turtlebot_gym.parameters import Reward
from turtlebot_gym.robots import Robot
from turtlebot_gym.validation import choose, require
from turtlebot_gym.values import Command, Covariance, Pose, State

OBSERVATION_LAYOUT = 1
"""Version of `Observation`: a policy that was trained on another one must be refused."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """When waypoints count as reached, and when an episode ends."""

    random: bool = True
    """Whether start pose and goal are drawn in the arena; else the robot starts at the origin and has given waypoints."""
    arena: float = 2.0
    """Half the side of the square in which starts and goals are drawn, m."""
    min_distance: float = 0.5
    """Least distance between a drawn start and its goal, m."""
    radius: float = 0.15
    """A waypoint is reached within this distance, m ..."""
    heading_tolerance: float = math.inf
    """... this heading error, rad ..."""
    turn_tolerance: float = math.inf
    """... and at most this turning rate, rad/s."""
    on_belief: bool = False
    """Whether the pose that the policy observes decides on arrival, as in a node, instead of the true one."""
    switch_period: float = math.inf
    """Time after which the next waypoint is taken, reached or not, s; infinite to switch on arrival."""
    laps: float = 1.0
    """How often the waypoints are to be visited in turn."""
    max_steps: float = 300.0
    """Steps after which an episode is truncated."""

    def __post_init__(self) -> None:
        positive = ("arena", "radius", "heading_tolerance", "turn_tolerance", "switch_period", "laps", "max_steps")
        require(self, "positive", *positive)
        require(self, "non-negative", "min_distance")
        if not self.min_distance <= self.arena:
            raise ValueError(f"Task.min_distance must be at most arena, got {self.min_distance!r} > {self.arena!r}.")


NAV = Task()
"""A goal point: its heading is observed, not judged."""
POSE = Task(heading_tolerance=0.2, turn_tolerance=0.5)
"""A goal pose: reached with the right heading and without spinning."""
SQUARE = Task(random=False, radius=0.3, max_steps=600.0)
"""Waypoints that are given, to be reached in order."""

SQUARE_WAYPOINTS = (
    Pose(2.0, 0.0, 0.0),
    Pose(2.0, 2.0, PI / 2.0),
    Pose(0.0, 2.0, wrap(PI)),
    Pose(0.0, 0.0, -PI / 2.0),
)
"""The tutorial's square of 2 m."""
SQUARE_PERIOD = 15.0
"""The tutorial's time for each of its waypoints, s."""


TASKS: dict[str, Task] = {"nav": NAV, "pose": POSE, "square": SQUARE}
"""Tasks by name."""


def make_task(
    task: str | Task,
    *,
    waypoints: Sequence[Pose] | None = None,
    arrival: str | None = None,
    switch: str | None = None,
    laps: int | None = None,
    max_steps: float | None = None,
) -> tuple[Task, tuple[Pose, ...]]:
    """Return a task and its waypoints, changed as asked.

    Args:
        task: A name in `TASKS`, or a task.
        waypoints: The poses to visit; None for the tutorial's square, or for what the task draws.
        arrival: Who says that a waypoint is reached: "truth", or "belief", the pose that the policy observes.
        switch: When the next waypoint is taken: on "arrival", or after a "time" of 15 s, reached or not.
        laps: How often the waypoints are visited in turn.
        max_steps: Steps after which an episode is truncated.

    Raises:
        ValueError: If a name is unknown, or waypoints, ``switch`` or ``laps`` are given for a task that draws its goal.
    """
    chosen = task if isinstance(task, Task) else choose("task", task, TASKS)
    if chosen.random and (waypoints is not None or switch == "time" or laps not in (None, 1)):
        raise ValueError("waypoints, switch='time' and laps are for tasks with given waypoints: this one draws its goal.")
    changes: dict[str, Any] = {}
    if arrival is not None:
        changes["on_belief"] = choose("arrival", arrival, {"truth": False, "belief": True})
    if switch is not None:
        changes["switch_period"] = choose("switch", switch, {"arrival": math.inf, "time": SQUARE_PERIOD})
    if laps is not None:
        if not (isinstance(laps, int) and laps > 0):
            raise ValueError(f"laps must be a positive whole number, got {laps!r}.")
        changes["laps"] = float(laps)
    if max_steps is not None:
        changes["max_steps"] = float(max_steps)
    try:
        given = tuple(Pose(*map(float, waypoint)) for waypoint in (SQUARE_WAYPOINTS if waypoints is None else waypoints))
    except (TypeError, ValueError):
        given = ()
    if not given or not all(math.isfinite(number) for waypoint in given for number in waypoint):
        raise ValueError(f"waypoints must be one or more finite poses (x, y, theta), got {waypoints!r}.")
    poses = tuple(Pose(waypoint.x, waypoint.y, wrap(waypoint.theta)) for waypoint in given)
    return replace(chosen, **changes), poses[:1] if chosen.random else poses


class Observation(NamedTuple):
    """What a policy is given, layout 1. "Believed" is odometric or true where the environment observes that instead."""

    distance: float
    """Believed distance to the goal, m."""
    cos_bearing: float
    """Cosine of the goal's bearing in the body frame; 1 at distance 0."""
    sin_bearing: float
    """Its sine."""
    cos_turn: float
    """Cosine of the heading still to turn until the reference's."""
    sin_turn: float
    """Its sine."""
    v: float
    """Speed, as a share of the robot's limit."""
    omega: float
    """Turning rate, as a share of the robot's limit."""
    std_position: float
    """Stated standard deviation of the position (root of the trace), m."""
    std_heading: float
    """Stated standard deviation of the heading, rad."""
    nis: float
    """Normalized innovation squared of the last measurement."""
    next_distance: float
    """Distance to the waypoint after this one; to the goal again where there is none, m."""
    cos_next: float
    """Cosine of its bearing."""
    sin_next: float
    """Its sine."""


MAX_DISTANCE, MAX_TWIST, MAX_STD_POSITION, MAX_STD_HEADING, MAX_NIS = 20.0, 2.0, 5.0, PI, 25.0
_ONES = (1.0, 1.0, 1.0, 1.0)
OBSERVATION_HIGH = Observation(
    MAX_DISTANCE, *_ONES, MAX_TWIST, MAX_TWIST, MAX_STD_POSITION, MAX_STD_HEADING, MAX_NIS, MAX_DISTANCE, 1.0, 1.0
)
"""Upper bounds; observations are clipped to them."""
OBSERVATION_LOW = Observation(*(0.0 if at in (0, 7, 8, 9, 10) else -high for at, high in enumerate(OBSERVATION_HIGH)))
"""Lower bounds."""


@kernel
def _towards(pose_x: float, pose_y: float, sine: float, cosine: float, to: Pose) -> tuple[float, float, float]:
    """Return distance, cosine and sine of the bearing of a point, seen from a pose with that sine and cosine of heading."""
    dx, dy = to.x - pose_x, to.y - pose_y
    distance = sqrt(dx * dx + dy * dy)
    scale = 1.0 / (distance if distance > 0.0 else 1.0)
    ahead, left = (dx * cosine + dy * sine) * scale, (dy * cosine - dx * sine) * scale
    return distance, (max(min(ahead, 1.0), -1.0) if distance > 0.0 else 1.0), max(min(left, 1.0), -1.0)


@kernel
def observe(state: State, std: tuple[float, float], nis: float, reference: Pose, following: Pose, robot: Robot) -> Observation:
    """Return what a policy observes.

    Args:
        state: Believed pose and twist.
        std: Standard deviations of position and heading; m, rad.
        nis: Normalized innovation squared of the last measurement.
        reference: The waypoint to reach.
        following: The one after it.
        robot: The limits that scale the twist.
    """
    sine, cosine = sincos(state.theta)
    distance, cos_bearing, sin_bearing = _towards(state.x, state.y, sine, cosine, reference)
    next_distance, cos_next, sin_next = _towards(state.x, state.y, sine, cosine, following)
    sin_turn, cos_turn = sincos(reference.theta - state.theta)
    return Observation(
        min(distance, MAX_DISTANCE),
        cos_bearing,
        sin_bearing,
        max(min(cos_turn, 1.0), -1.0),
        max(min(sin_turn, 1.0), -1.0),
        max(min(state.v / robot.max_linear, MAX_TWIST), -MAX_TWIST),
        max(min(state.omega / robot.max_angular, MAX_TWIST), -MAX_TWIST),
        min(std[0], MAX_STD_POSITION),
        min(std[1], MAX_STD_HEADING),
        min(nis, MAX_NIS),
        min(next_distance, MAX_DISTANCE),
        cos_next,
        sin_next,
    )


@kernel
def stated_deviations(P: Covariance) -> tuple[float, float]:
    """Return the standard deviations of position (root of the trace) and heading that a covariance states; m, rad."""
    return sqrt(P.xx + P.yy), sqrt(P.tt)


@kernel
def distance_to(state: State, to: Pose) -> float:
    """Return the distance from a state to a point, m."""
    dx, dy = to.x - state.x, to.y - state.y
    return sqrt(dx * dx + dy * dy)


@kernel
def arrived(state: State, reference: Pose, task: Task) -> bool:
    """Return whether a (true or believed) state satisfies the task at a waypoint."""
    turn = abs(wrap(reference.theta - state.theta))
    close = distance_to(state, reference) < task.radius
    return close and turn <= task.heading_tolerance and abs(state.omega) <= task.turn_tolerance


@kernel
def reward_of(before: float, after: float, command: Command, success: bool, weights: Reward, robot: Robot, dt: float) -> float:
    """Return the reward of a step.

    Args:
        before: True way left before the step, m.
        after: And after it, m.
        command: The limited command of the step.
        success: Whether the episode ends in success.
        weights: What counts how much.
        robot: Its limits scale progress and effort.
        dt: Control interval, s.
    """
    progress = (before - after) / (robot.max_linear * dt)
    v, omega = command.v / robot.max_linear, command.omega / robot.max_angular
    effort = v * v + omega * omega
    bonus = weights.success if success else 0.0
    return weights.progress * progress - weights.time - weights.effort * effort + bonus


@kernel
def draw_start(key: int, task: Task) -> Pose:
    """Draw a start pose in the arena."""
    u1, u2 = uniforms(key, 0, START)
    u3, _ = uniforms(key, 1, START)
    return Pose((2.0 * u1 - 1.0) * task.arena, (2.0 * u2 - 1.0) * task.arena, wrap(2.0 * PI * u3))


@kernel
def draw_goal(key: int, number: int, start: Pose, task: Task) -> Pose:
    """Draw a goal pose in the arena, at least `Task.min_distance` from the pose before it; ``number`` counts goals.

    That distance is at most the arena's half side, so a draw is refused with probability below pi/4, and all of 64 with less
    than 2e-7; the last one then stands.
    """
    x, y = start.x, start.y
    for attempt in range(64):
        u1, u2 = uniforms(key, 64 * number + attempt, GOAL)
        x, y = (2.0 * u1 - 1.0) * task.arena, (2.0 * u2 - 1.0) * task.arena
        dx, dy = x - start.x, y - start.y
        if dx * dx + dy * dy >= task.min_distance * task.min_distance:
            break
    u3, _ = uniforms(key, number + 2, START)
    return Pose(x, y, wrap(2.0 * PI * u3))
