"""A robot in a room that reads its scans: it localizes itself by each complete one, or tracks what moves.

The localizer's map is that of the room: the cells of a given map, or the drawn room as cells of 5 cm.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np

from turtlebot_gym.kernel import kernel
from turtlebot_gym.localization.bank import COLUMNS, ROWS
from turtlebot_gym.localization.hypotheses import correct_by_scan, nowhere
from turtlebot_gym.localization.localizer import locate, move
from turtlebot_gym.localization.points import Timing, remember, rest
from turtlebot_gym.localization.tuning import LocalizerTuning
from turtlebot_gym.models.angles import TWO_PI
from turtlebot_gym.models.unicycle import execution_variances
from turtlebot_gym.parameters import REFERENCE_PERIOD
from turtlebot_gym.rooms.grid import chart, extent
from turtlebot_gym.rooms.lidar import beams_by, time_of_beam
from turtlebot_gym.rooms.rules import GIVEN
from turtlebot_gym.systems.parameters import Parameters
from turtlebot_gym.systems.system import System
from turtlebot_gym.tracking.sweep import Sweep
from turtlebot_gym.tracking.tracker import begin, look, make_memory, memory_at, on_odometry, on_scan, poses_for

UNIFORM = 1.0 / math.sqrt(3.0)
"""Standard deviation of a number that is uniform in [-1, 1]."""


@kernel
def _newest_scan(at: int, lidar: Any, dt: float) -> tuple[bool, float]:
    """Return whether a step completes a scan, and the time of its last beam, s."""
    beams = int(lidar.beams)
    scans = beams_by(at, lidar, dt) // beams
    return scans > beams_by(at - 1, lidar, dt) // beams, time_of_beam(scans * beams - 1.0, lidar)


@kernel
def _interval(lidar: Any) -> float:
    """Return the time between two beams, s; 0 if all are measured at once."""
    return 1.0 / (lidar.rate * lidar.beams) if lidar.turning else 0.0


@kernel
def sweep_of(lidar: Any, last: float, dt: float) -> Sweep:
    """Return how a simulated LiDAR measured the scan whose last beam was at a time, s; what walks moves once in each step."""
    number, step, interval = int(lidar.beams), TWO_PI / lidar.beams, _interval(lidar)
    return Sweep(lidar, number, lidar.yaw, step, last, interval, lidar.x, lidar.y, lidar.range_max, dt)


@kernel
def drift_of(twist: Any, tuning: Any, dt: float) -> tuple[float, float]:
    """Return the variances of way and turn that a twist adds in an interval, m^2 and rad^2; none at rest."""
    var_v, var_omega = execution_variances(twist, tuning.process, dt)
    share, moves = dt / REFERENCE_PERIOD, twist.v != 0.0 or twist.omega != 0.0
    along, turning = max(var_v, tuning.Q[3] * share) * dt * dt, max(var_omega, tuning.Q[4] * share) * dt * dt
    return along if moves else 0.0, turning if moves else 0.0


@kernel
def _estimate(estimate, before, senses, p, room, scene):
    """Move the belief as the wheels moved, and correct it where a scan is complete."""
    at, lidar, memory, q = int(estimate.moves) + 1, p.room.lidar, scene.memory, p.localizer
    odometry, was = senses.odometry, before.odometry
    moved = move(estimate, was.pose, odometry.pose, odometry.twist, drift_of(was.twist, p.tuning, p.dt), p.dt, q)
    if odometry.measured:
        remember(memory.trail, at * p.dt, odometry.pose)
    is_complete, last = _newest_scan(at, lidar, p.dt)
    if is_complete:
        timing, ranges = Timing(last, _interval(lidar), lidar.x, lidar.y, lidar.range_max), scene.lidar.ranges[1]
        moved = correct_by_scan(moved, ranges[: int(lidar.beams)], scene.lidar.beams, timing, memory, q)
    return moved


@cache
def localizing(system: System) -> System:
    """Return a system of rooms whose belief is the localizer's."""
    around, lay_out_before = system.surroundings, system.lay_out
    make_before, first_look_before = around.make, around.first_look

    def make(parameters: Sequence[Parameters]) -> Any:
        scenes, number = make_before(parameters), len(parameters)
        rules = [row.room.rules for row in parameters]
        rows, columns = extent(max(2.0 * rule.half_length for rule in rules), max(2.0 * rule.half_width for rule in rules))
        poses = max(math.ceil(1.0 / (row.room.lidar.rate * row.dt) - 1e-9) + 2 for row in parameters)
        return scenes._replace(
            memory=scenes.memory._replace(
                field=np.zeros((number, rows, columns), np.float32),
                trail=np.zeros((number, poses, 4)),  # back to the first beam of a revolution
                bank=np.zeros((number, ROWS, COLUMNS)),
            )
        )

    @kernel
    def first_estimate(senses, p):
        return locate(senses.odometry.pose, p.tuning.R, p.localizer) if p.task.start_known else nowhere(p.localizer)

    @kernel
    def lay_out(key, p, scene):
        start, goal = lay_out_before(key, p, scene)
        if p.room.rules.kind != GIVEN:
            chart(scene)
        return start, goal

    @kernel
    def first_look(world, key, p, scene):
        rest(scene.memory.trail, 0.0, world.senses.odometry.pose)
        return first_look_before(world, key, p, scene)

    return system._replace(
        lay_out=lay_out,
        first_estimate=first_estimate,
        estimate=_estimate,
        reads_scan=True,
        surroundings=around._replace(make=make, first_look=first_look),
        example=system.example._replace(localizer=LocalizerTuning()),
    )


@cache
def tracking(system: System) -> System:
    """Return a system of rooms with a tracker, which the term `observations.TRACKS` reads."""
    around = system.surroundings
    make_before, at_before, first_look_before, look_before = around.make, around.at, around.first_look, around.look

    def make(parameters: Sequence[Parameters]) -> Any:
        beams = max(int(row.room.lidar.beams) for row in parameters)
        poses = max(poses_for(1.0 / row.room.lidar.rate, row.dt) for row in parameters)
        return make_before(parameters)._replace(tracker=make_memory(len(parameters), beams=beams, poses=poses))

    @kernel
    def at(scenes, index):
        return at_before(scenes, index)._replace(tracker=memory_at(scenes.tracker, index))

    @kernel
    def first_look(world, key, p, scene):
        begin(scene.tracker, 0.0, world.senses.odometry.pose)
        return first_look_before(world, key, p, scene)

    @kernel
    def look_round(world, key, p, scene):
        room, lidar, odometry, tracker = look_before(world, key, p, scene), p.room.lidar, world.senses.odometry, scene.tracker
        step = int(world.steps)
        if odometry.measured:
            on_odometry(tracker, step * p.dt, odometry.pose)
        is_complete, last = _newest_scan(step, lidar, p.dt)
        if is_complete:
            stamp = math.floor(last * 1e9 + 0.5) / 1e9
            on_scan(tracker, scene.lidar.ranges[1], sweep_of(lidar, stamp, p.dt))
        look(tracker.tracks, tracker.seen, step * p.dt, odometry.pose, odometry.twist, UNIFORM * lidar.accuracy)
        return room

    return system._replace(surroundings=around._replace(make=make, at=at, first_look=first_look, look=look_round))
