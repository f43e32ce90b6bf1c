"""A robot in a room that localizes itself: wheel odometry moves the belief, and each complete scan corrects it in its own step.

The localizer's map is that of the room: the cells of a given map, or the drawn room as cells of 5 cm, in which rules may leave
out and move obstacles.
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
from turtlebot_gym.models.random import MAP, sub_key
from turtlebot_gym.models.unicycle import execution_variances
from turtlebot_gym.parameters import REFERENCE_PERIOD
from turtlebot_gym.rooms.charting import chart, extent
from turtlebot_gym.rooms.lidar import beams_by, time_of_beam
from turtlebot_gym.rooms.rules import GIVEN
from turtlebot_gym.rooms.scene import Scene
from turtlebot_gym.systems.parameters import Parameters
from turtlebot_gym.systems.system import System


@kernel
def drift_of(twist: Any, tuning: Any, dt: float) -> tuple[float, float]:
    """Return the variances of way and turn that a twist adds in an interval, m^2 and rad^2; none at rest."""
    var_v, var_omega = execution_variances(twist, tuning.process, dt)
    share, moves = dt / REFERENCE_PERIOD, twist.v != 0.0 or twist.omega != 0.0
    along, turning = max(var_v, tuning.Q[3] * share) * dt * dt, max(var_omega, tuning.Q[4] * share) * dt * dt
    return along if moves else 0.0, turning if moves else 0.0


@kernel
def _first_estimate(senses, p):
    """Begin at the first measurement if the start is known."""
    return locate(senses.odometry.pose, p.tuning.R, p.localizer) if p.task.start_known else nowhere(p.localizer)


@kernel
def _estimate(estimate, before, senses, p, room, scene):
    """Move the belief as the wheels moved, and correct it where a scan is complete."""
    at, lidar, memory, q = int(estimate.moves) + 1, p.room.lidar, scene.memory, p.localizer
    odometry, was = senses.odometry, before.odometry
    moved = move(estimate, was.pose, odometry.pose, odometry.twist, drift_of(was.twist, p.tuning, p.dt), p.dt, q)
    if odometry.measured:
        remember(memory.trail, at * p.dt, odometry.pose)
    beams, done = int(lidar.beams), beams_by(at, lidar, p.dt)
    if done // beams > beams_by(at - 1, lidar, p.dt) // beams:
        last = time_of_beam(done // beams * beams - 1.0, lidar)
        interval = 1.0 / (lidar.rate * lidar.beams) if lidar.turning else 0.0
        timing = Timing(last, interval, lidar.x, lidar.y, lidar.range_max)
        ranges = scene.lidar.ranges[1][:beams]
        moved = correct_by_scan(
            moved, ranges, scene.lidar.beams, timing, memory.trail, memory.bank, memory.field, memory.field_frame, q
        )
    return moved


def _trail(p: Parameters) -> int:
    """Return the number of poses that reach back to the first beam of a revolution."""
    return math.ceil(1.0 / (p.room.lidar.rate * p.dt) - 1e-9) + 2


@cache
def localizing(system: System) -> System:
    """Return a system of rooms whose belief is the localizer's."""
    around, lay_out_before = system.surroundings, system.lay_out
    assert around is not None
    make_before, first_look_before = around.make, around.first_look

    def make(parameters: Sequence[Parameters]) -> Scene:
        scenes, number = make_before(parameters), len(parameters)
        rules = [row.room.rules for row in parameters]
        rows, columns = extent(max(2.0 * rule.half_length for rule in rules), max(2.0 * rule.half_width for rule in rules))
        memory = scenes.memory._replace(
            field=np.zeros((number, rows, columns), np.float32),
            trail=np.zeros((number, max(map(_trail, parameters)), 4)),
            bank=np.zeros((number, ROWS, COLUMNS)),
        )
        return scenes._replace(memory=memory)

    @kernel
    def lay_out(key, p, scene):
        start, goal = lay_out_before(key, p, scene)
        if p.room.rules.kind != GIVEN:
            chart(scene, p.room.rules, sub_key(key, MAP))
        return start, goal

    @kernel
    def first_look(world, key, p, scene):
        rest(scene.memory.trail, 0.0, world.senses.odometry.pose)
        return first_look_before(world, key, p, scene)

    return system._replace(
        lay_out=lay_out,
        first_estimate=_first_estimate,
        estimate=_estimate,
        reads_scan=True,
        surroundings=around._replace(make=make, first_look=first_look),
        example=system.example._replace(localizer=LocalizerTuning()),
    )
