"""The start of an episode, and the goal that it draws."""

from __future__ import annotations

from turtlebot_gym.kernel import kernel
from turtlebot_gym.models.angles import PI, wrap
from turtlebot_gym.models.random import GOAL, START, uniforms
from turtlebot_gym.tasks.task import Task
from turtlebot_gym.values import Pose


@kernel
def start_pose(key: int, task: Task) -> Pose:
    """Return the start pose of an episode: drawn in the arena if the task is random, otherwise the origin."""
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
