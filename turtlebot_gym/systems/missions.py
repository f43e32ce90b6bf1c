"""Missions: goals in a room, one after another, each of which is reached or given up before the next is drawn."""

from __future__ import annotations

from functools import cache

from turtlebot_gym.kernel import kernel
from turtlebot_gym.rewards import ON_MISSIONS
from turtlebot_gym.rooms.drawing import draw_next
from turtlebot_gym.rooms.geodesic import spread, way_left
from turtlebot_gym.systems.system import System
from turtlebot_gym.systems.world import Course, Judgement
from turtlebot_gym.tasks import distance_to, overdue


@kernel
def _renew(world, judgement, key, p, scene):
    """Give the next goal where one was reached or given up."""
    if not judgement.reached or judgement.terminated or judgement.truncated:
        return world, judgement
    visited, truth = world.course.visited, world.body.true_state
    goal = draw_next(scene, p.room.rules, world.course.reference, key, int(visited))
    spread(scene, goal.x, goal.y)
    room = world.room._replace(way=way_left(scene, truth.x, truth.y), given=world.steps)
    return world._replace(course=Course(goal, goal, visited), room=room), judgement._replace(distance=distance_to(truth, goal))


@cache
def on_missions(system: System) -> System:
    """Return a system of rooms whose episodes have `Task.laps` goals in turn."""
    judge_one = system.judge

    @kernel
    def judge(world, body, senses, estimate, waypoints, p):
        visited, (distance, success, _, truncated, reached) = judge_one(world, body, senses, estimate, waypoints, p)
        late = overdue(world.steps + 1.0 - world.room.given, p.task, p.dt) and not reached
        visited = visited + (1.0 if late else 0.0)
        over = visited >= waypoints * p.task.laps
        return visited, Judgement(distance, success, over, truncated and not over, reached or late)

    return system._replace(
        judge=judge,
        rewards=ON_MISSIONS,
        surroundings=system.surroundings._replace(renew=_renew),
    )
