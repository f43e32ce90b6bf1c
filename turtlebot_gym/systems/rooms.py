"""Rooms: open ground with walls and obstacles, and a LiDAR that sees them.

Body, odometry, filter and arrival are those of open ground. Rooms add beams, measured while the robot moves; contact, judged by
the true pose; and a reward for progress along the shortest path instead of the straight line.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

from turtlebot_gym.estimation.interface import Filter
from turtlebot_gym.kernel import kernel, sqrt
from turtlebot_gym.models.random import SCAN, sub_key
from turtlebot_gym.observations import ROOM
from turtlebot_gym.rewards import IN_ROOMS
from turtlebot_gym.rooms.drawing import capacity, draw
from turtlebot_gym.rooms.geodesic import way_left
from turtlebot_gym.rooms.lidar import LIDARS, age_of_scan, aim, beams_by
from turtlebot_gym.rooms.rules import ROOMS
from turtlebot_gym.rooms.scene import Scene, make_scenes, scene_at
from turtlebot_gym.rooms.sectors import divide
from turtlebot_gym.rooms.sensing import clearance, measure
from turtlebot_gym.rooms.walking import STANDS, walk
from turtlebot_gym.systems.open_ground import open_ground
from turtlebot_gym.systems.parameters import Parameters, RoomParameters
from turtlebot_gym.systems.system import RoomParts, System
from turtlebot_gym.systems.world import RoomState
from turtlebot_gym.values import Pose


@kernel
def _lay_out(key, p, scene):
    return draw(scene, p.room.rules, p.robot.radius, key, p.dt)


@kernel
def _pose(world):
    truth = world.body.true_state
    return Pose(truth.x, truth.y, truth.theta)


@kernel
def _first_look(world, key, p, scene):
    """Measure a revolution at rest, before the start."""
    pose, lidar = _pose(world), p.room.lidar
    aim(scene.lidar.beams, lidar)
    divide(scene.lidar.spans, scene.lidar.beams, lidar.yaw, int(lidar.beams))
    measure(scene, pose, pose, -int(lidar.beams), 0, 0.0, sub_key(key, SCAN), lidar, p.dt)
    near = clearance(scene, pose.x, pose.y) - p.robot.radius
    return RoomState(pose, way_left(scene, pose.x, pose.y), near, near, 0.0, age_of_scan(0, lidar, p.dt), near < 0.0, 0.0)


@kernel
def _look_round(world, key, p, scene):
    """Move walkers, and measure the beams of the interval.

    Contact is a collision, unless a person walks into a robot that stands.
    """
    before, pose, lidar, rules, at = world.room, _pose(world), p.room.lidar, p.room.rules, int(world.steps)
    walk(scene, before.pose, pose, p.robot.radius, rules, p.dt)
    first, last = beams_by(at - 1, lidar, p.dt), beams_by(at, lidar, p.dt)
    measure(scene, before.pose, pose, first, last, (at - 1) * p.dt, sub_key(key, SCAN), lidar, p.dt)
    near = clearance(scene, pose.x, pose.y) - p.robot.radius
    dx, dy = pose.x - before.pose.x, pose.y - before.pose.y
    moved, way = sqrt(dx * dx + dy * dy), way_left(scene, pose.x, pose.y)
    return RoomState(
        pose,
        way if way >= 0.0 else before.way,
        near,
        min(before.least, near),
        before.path_length + moved,
        age_of_scan(at, lidar, p.dt),
        near < 0.0 and not (rules.people and moved <= STANDS),
        before.given,
    )


def _make(parameters: Sequence[Parameters]) -> Scene:
    """Return arrays for the largest room and LiDAR of some parameters."""
    rules, lidars = {row.room.rules for row in parameters}, {row.room.lidar for row in parameters}
    circles, boxes = (max(sizes) for sizes in zip(*map(capacity, rules), strict=True))
    return make_scenes(
        len(parameters),
        circles=circles,
        boxes=boxes,
        length=max(2.0 * rule.half_length for rule in rules),
        width=max(2.0 * rule.half_width for rule in rules),
        beams=max(lidar.beams for lidar in lidars),
        same_lidar=len(lidars) == 1,
        people=circles if any(rule.people for rule in rules) else 0,
    )


@cache
def rooms(filter: Filter) -> System:
    """Return the system of rooms with a filter."""
    plain = open_ground(filter)
    judge_arrival = plain.judge

    @kernel
    def judge(world, after, waypoints, p):
        visited, outcome = judge_arrival(world, after, waypoints, p)
        collided = after.room.collided
        terminated = outcome.terminated or collided
        success, truncated = outcome.is_success and not collided, outcome.truncated and not terminated
        return visited, outcome._replace(is_success=success, terminated=terminated, truncated=truncated)

    return plain._replace(
        lay_out=_lay_out,
        judge=judge,
        terms=ROOM,
        rewards=IN_ROOMS,
        example=plain.example._replace(room=RoomParameters(ROOMS["clutter"], LIDARS["ideal"])),
        surroundings=RoomParts(_make, scene_at, _first_look, _look_round),
    )
