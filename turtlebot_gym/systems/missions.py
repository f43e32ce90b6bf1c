"""Missions: goals in a room, one after another, each of which is reached or given up before the next is drawn."""

from __future__ import annotations

from functools import cache

from turtlebot_gym.kernel import kernel
from turtlebot_gym.rooms.drawing import draw_next
from turtlebot_gym.rooms.geodesic import spread, way_left
from turtlebot_gym.systems.system import System
from turtlebot_gym.systems.world import Around, Course, Outcome, Snapshot
from turtlebot_gym.tasks import arrived, distance_to, overdue


@kernel
def _renew(world, outcome, key, p, scene):
    """Give the next goal where one was reached or given up."""
    if not outcome.reached or outcome.terminated or outcome.truncated:
        return world, outcome
    visited, truth = world.course.visited, world.body.true_state
    goal = draw_next(scene, p.room.rules, world.course.reference, key, int(visited))
    spread(scene, goal.x, goal.y)
    pose, _, near, least, path_length, scan_age, collided, _ = world.room
    room = Around(pose, way_left(scene, truth.x, truth.y), near, least, path_length, scan_age, collided, world.steps)
    course = Course(goal, goal, visited)
    reward, _, success, terminated, truncated, reached = outcome
    renewed = Outcome(reward, distance_to(truth, goal), success, terminated, truncated, reached)
    return Snapshot(world.body, world.senses, world.estimate, course, world.steps, room), renewed


@cache
def on_missions(system: System) -> System:
    """Return a system of rooms whose episodes have `Task.laps` goals in turn."""
    around, judge_one = system.surroundings, system.judge
    assert around is not None
    complete_one = around.complete

    @kernel
    def judge(world, body, senses, estimate, waypoints, p):
        visited, outcome = judge_one(world, body, senses, estimate, waypoints, p)
        reward, distance, success, _, truncated, reached = outcome
        late = overdue(world.steps + 1.0 - world.room.given, p.task, p.dt) and not reached
        visited = visited + (1.0 if late else 0.0)
        over = visited >= waypoints * p.task.laps
        return visited, Outcome(reward, distance, success, over, truncated and not over, reached or late)

    @kernel
    def complete(world, room, outcome, p):
        reward, distance, success, terminated, truncated, reached = complete_one(world, room, outcome, p)
        is_there = (
            reached and not success and not room.collided and arrived(world.body.true_state, world.course.reference, p.task)
        )
        reward = reward + (p.reward.success if is_there else 0.0)
        return Outcome(reward, distance, success, terminated, truncated, reached)

    return system._replace(judge=judge, surroundings=around._replace(complete=complete, renew=_renew))
