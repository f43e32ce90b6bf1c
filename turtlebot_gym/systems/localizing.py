"""A robot in a room that localizes itself: wheel odometry moves the belief, and each complete scan corrects it in its own step.

The localizer's map is that of the room: the cells of a given map, or the drawn room as cells of 5 cm, in which rules may leave
out and move obstacles.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from turtlebot_gym.kernel import kernel, sqrt
from turtlebot_gym.localization.hypotheses import ROWS, correct_by_scan, nowhere
from turtlebot_gym.localization.localizer import locate, move
from turtlebot_gym.localization.points import Timing, remember, rest
from turtlebot_gym.localization.tuning import LocalizerTuning
from turtlebot_gym.models.angles import sincos
from turtlebot_gym.models.random import MAP, sub_key
from turtlebot_gym.models.unicycle import execution_variances
from turtlebot_gym.parameters import REFERENCE_PERIOD
from turtlebot_gym.rooms.charting import chart, extent
from turtlebot_gym.rooms.lidar import beams_by, time_of_beam
from turtlebot_gym.rooms.rules import GIVEN
from turtlebot_gym.rooms.scene import Scene
from turtlebot_gym.systems.parameters import Parameters
from turtlebot_gym.systems.system import System
from turtlebot_gym.tasks import MAX_STD_POSITION
from turtlebot_gym.values import Covariance


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
    at, lidar, q = int(estimate.moves) + 1, p.room.lidar, p.localizer
    odometry, was = senses.odometry, before.odometry
    moved = move(estimate, was.pose, odometry.pose, odometry.twist, drift_of(was.twist, p.tuning, p.dt), q)
    if odometry.measured:
        remember(scene.trail, at * p.dt, odometry.pose)
    beams, done = int(lidar.beams), beams_by(at, lidar, p.dt)
    if done // beams > beams_by(at - 1, lidar, p.dt) // beams:
        last = time_of_beam(done // beams * beams - 1.0, lidar)
        interval = 1.0 / (lidar.rate * lidar.beams) if lidar.turning else 0.0
        timing = Timing(last, interval, lidar.x, lidar.y, lidar.range_max)
        ranges = scene.ranges[1][:beams]
        moved = correct_by_scan(moved, ranges, scene.beams, timing, scene.trail, scene.bank, scene.field, scene.field_frame, q)
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
        return scenes._replace(
            field=np.zeros((number, rows, columns), np.float32),
            trail=np.zeros((number, max(map(_trail, parameters)), 4)),
            bank=np.zeros((number, ROWS, 4)),
        )

    @kernel
    def lay_out(key, p, scene):
        start, goal = lay_out_before(key, p, scene)
        if p.room.rules.kind != GIVEN:
            chart(scene, p.room.rules, sub_key(key, MAP))
        return start, goal

    @kernel
    def first_look(world, key, p, scene):
        rest(scene.trail, 0.0, world.senses.odometry.pose)
        return first_look_before(world, key, p, scene)

    return system._replace(
        lay_out=lay_out,
        first_estimate=_first_estimate,
        estimate=_estimate,
        reads_scan=True,
        surroundings=around._replace(make=make, first_look=first_look),
        example=system.example._replace(localizer=LocalizerTuning()),
    )


class Evidence(NamedTuple):
    """What a localizer says of its belief beyond a `tasks.Observation`, in layout 3."""

    std_ahead: float
    """Stated standard deviation of the position in the direction of the believed heading, m: in a corridor without ends it
    grows."""
    std_aside: float
    """The same across that direction, m."""
    fits: float
    """Share of the last scan's beams that end near a surface of the map."""
    weight: float
    """Weight of the best hypothesis of where the robot is; 1 while there is only one."""


EVIDENCE_LOW = Evidence(0.0, 0.0, 0.0, 0.0)
"""Lower bounds; observations are clipped to them."""
EVIDENCE_HIGH = Evidence(MAX_STD_POSITION, MAX_STD_POSITION, 1.0, 1.0)
"""Upper bounds."""


@kernel
def evidence_of(theta: float, P: Covariance, fits: float, weight: float) -> Evidence:
    """Return what a localizer says of its belief.

    Args:
        theta: Believed heading, rad.
        P: Covariance of the belief.
        fits: Share of the last scan's beams that fit.
        weight: Weight of the best hypothesis.
    """
    sine, cosine = sincos(theta)
    cross = 2.0 * sine * cosine * P.xy
    ahead = cosine * cosine * P.xx + cross + sine * sine * P.yy
    aside = sine * sine * P.xx - cross + cosine * cosine * P.yy
    return Evidence(
        min(sqrt(max(ahead, 0.0)), MAX_STD_POSITION),
        min(sqrt(max(aside, 0.0)), MAX_STD_POSITION),
        max(min(fits, 1.0), 0.0),
        max(min(weight, 1.0), 0.0),
    )
