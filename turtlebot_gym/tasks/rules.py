"""The rules of a task: start and goal, arrival, the switch to the next waypoint, and the reward."""

from __future__ import annotations

import math

from turtlebot_gym.kernel import algebra, kernel, sqrt
from turtlebot_gym.models.angles import PI, wrap
from turtlebot_gym.models.random import GOAL, START, uniforms
from turtlebot_gym.parameters import Reward
from turtlebot_gym.robots import Robot
from turtlebot_gym.tasks.task import Task
from turtlebot_gym.values import Command, Pose, State


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
    x, y = start.x, start.y
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
    """Return whether it is time for the next waypoint, whether or not this one is reached.

    Args:
        steps: Steps since the start.
        visited: Number of waypoints done.
        task: The task with its switch period.
        dt: Control interval, s.
    """
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


@kernel
def reward_of(before: float, after: float, command: Command, success: bool, weights: Reward, robot: Robot, dt: float) -> float:
    """Return the reward of a step.

    Args:
        before: True remaining distance before the step, m.
        after: True remaining distance after the step, m.
        command: The limited command of the step.
        success: Whether the episode ends in success.
        weights: Weights of the terms.
        robot: Robot whose limits scale progress and effort.
        dt: Control interval, s.
    """
    progress = (before - after) / (robot.max_linear * dt)
    v, omega = command.v / robot.max_linear, command.omega / robot.max_angular
    effort = v * v + omega * omega
    bonus = weights.success if success else 0.0
    return weights.progress * progress - weights.time - weights.effort * effort + bonus
