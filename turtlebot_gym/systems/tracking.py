"""A robot in a room that tracks what moves: its tracker takes the wheel odometry of each step, and each complete scan."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple

from turtlebot_gym.kernel import kernel
from turtlebot_gym.models.angles import TWO_PI
from turtlebot_gym.rooms.lidar import beams_by, time_of_beam
from turtlebot_gym.systems.parameters import Parameters
from turtlebot_gym.systems.system import System
from turtlebot_gym.tracking.sweep import Sweep
from turtlebot_gym.tracking.tracker import (
    TrackerMemory,
    begin,
    look,
    make_memory,
    memory_at,
    on_odometry,
    on_scan,
    poses_for,
)

UNIFORM = 1.0 / math.sqrt(3.0)
"""Standard deviation of a number that is uniform in [-1, 1]."""


class TrackedScene(NamedTuple):
    """The arrays of a `rooms.scene.Scene`, and a tracker's."""

    room: Any
    lidar: Any
    memory: Any
    tracker: TrackerMemory


@kernel
def sweep_of(lidar: Any, last: float, dt: float) -> Sweep:
    """Return how a simulated LiDAR measured the scan whose last beam was at a time, s; what walks moves once in each step."""
    interval = 1.0 / (lidar.rate * lidar.beams) if lidar.turning else 0.0
    return Sweep(
        int(lidar.beams),
        lidar.yaw,
        TWO_PI / lidar.beams,
        last,
        interval,
        lidar.x,
        lidar.y,
        lidar.range_min,
        lidar.range_max,
        lidar.deviation,
        lidar.deviation_share,
        UNIFORM * lidar.accuracy,
        dt,
    )


@kernel
def _follow(world, p, scene):
    """Track what moves after the look of a step."""
    at, lidar, odometry, tracker = int(world.steps), p.room.lidar, world.senses.odometry, scene.tracker
    if odometry.measured:
        on_odometry(tracker, at * p.dt, odometry.pose)
    beams, done = int(lidar.beams), beams_by(at, lidar, p.dt)
    if done // beams > beams_by(at - 1, lidar, p.dt) // beams:
        last = math.floor(time_of_beam(done // beams * beams - 1.0, lidar) * 1e9 + 0.5) / 1e9  # as a stamp says
        on_scan(tracker, scene.lidar.ranges[1], sweep_of(lidar, last, p.dt))
    look(tracker, at * p.dt, odometry.pose, odometry.twist, UNIFORM * lidar.accuracy)


@cache
def tracking(system: System) -> System:
    """Return a system of rooms with a tracker, which the term `observations.TRACKS` reads."""
    around = system.surroundings
    assert around is not None
    make_before, at_before, first_before, look_before = around.make, around.at, around.first_look, around.look

    def make(parameters: Sequence[Parameters]) -> TrackedScene:
        beams = max(int(row.room.lidar.beams) for row in parameters)
        poses = max(poses_for(1.0 / row.room.lidar.rate, row.dt) for row in parameters)
        scenes = make_before(parameters)
        memories = make_memory(len(parameters), beams=beams, poses=poses)
        return TrackedScene(scenes.room, scenes.lidar, scenes.memory, memories)

    @kernel
    def at(scenes, index):
        scene = at_before(scenes, index)
        return TrackedScene(scene.room, scene.lidar, scene.memory, memory_at(scenes.tracker, index))

    @kernel
    def first_look(world, key, p, scene):
        room = first_before(world, key, p, scene)
        begin(scene.tracker, 0.0, world.senses.odometry.pose)
        return room

    @kernel
    def look_round(world, key, p, scene):
        room = look_before(world, key, p, scene)
        _follow(world, p, scene)
        return room

    return system._replace(surroundings=around._replace(make=make, at=at, first_look=first_look, look=look_round))
