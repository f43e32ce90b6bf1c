"""Missions: goals in a room, one after another, each of which is reached or given up before the next is drawn."""

from __future__ import annotations

from functools import cache

from turtlebot_gym.kernel import kernel
from turtlebot_gym.rewards import ON_MISSIONS
from turtlebot_gym.rooms.drawing import draw_next
from turtlebot_gym.rooms.geodesic import spread, way_left
from turtlebot_gym.systems.system import System
from turtlebot_gym.systems.world import Course
from turtlebot_gym.tasks import distance_to, overdue


@kernel
def _renew(world, outcome, key, p, scene):
    """Give the next goal where one was reached or given up."""
    if not outcome.reached or outcome.terminated or outcome.truncated:
        return world, outcome
    visited, truth = world.course.visited, world.body.true_state
    goal = draw_next(scene, p.room.rules, world.course.reference, key, int(visited))
    spread(scene, goal.x, goal.y)
    room = world.room._replace(way=way_left(scene, truth.x, truth.y), given=world.steps)
    return world._replace(course=Course(goal, goal, visited), room=room), outcome._replace(distance=distance_to(truth, goal))


@cache
def on_missions(system: System) -> System:
    """Return a system of rooms whose episodes have `Task.laps` goals in turn."""
    judge_one = system.judge

    @kernel
    def judge(world, after, waypoints, p):
        visited, outcome = judge_one(world, after, waypoints, p)
        late = overdue(after.steps - world.room.given, p.task, p.dt) and not outcome.reached
        visited = visited + (1.0 if late else 0.0)
        over = visited >= waypoints * p.task.laps
        truncated, reached = outcome.truncated and not over, outcome.reached or late
        return visited, outcome._replace(terminated=outcome.terminated or over, truncated=truncated, reached=reached)

    return system._replace(
        judge=judge,
        rewards=ON_MISSIONS,
        surroundings=system.surroundings._replace(renew=_renew),
    )
