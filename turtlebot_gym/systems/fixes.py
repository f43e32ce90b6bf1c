"""Fixes: an external pose sensor that is infrequent, noisy and late.

A fix that arrives now was measured some steps ago, so the sensor remembers the robot's poses of the last steps.
"""

from __future__ import annotations

import math
from functools import cache
from typing import NamedTuple

from turtlebot_gym.estimation.fixes import NO_FIX
from turtlebot_gym.estimation.update import inverse_of
from turtlebot_gym.kernel import kernel, sqrt
from turtlebot_gym.models.angles import wrap
from turtlebot_gym.models.random import EVENTS, FIX, HEADING, POSITION, normals, sub_key, uniforms
from turtlebot_gym.parameters import FixNoise
from turtlebot_gym.systems.sensors import Sensor
from turtlebot_gym.values import Pose


class TrackedFix(NamedTuple):
    """A `values.Fix`, the last one that arrived, and what the sensor remembers for later ones, which no filter may read."""

    pose: Pose
    R: tuple[float, float, float]
    age: float
    arrived: bool
    cross: tuple[float, float, float]
    passed: tuple[Pose, ...]
    """The robot's poses in the last steps, newest first."""


@kernel
def _measure(was: Pose, noise: FixNoise, key: int, stamp: int) -> Pose:
    """Return a pose as it is measured; without a heading, it is 0."""
    R, (xy, xt, yt) = noise.R, noise.cross
    first, second = normals(key, stamp, POSITION)
    turn, _ = normals(key, stamp, HEADING)
    sees_heading = R[2] < 1e300
    # Correlated draws, by the lower triangular root of the covariance.
    of_x = sqrt(R[0])
    y_by_x, t_by_x = xy / of_x, xt / of_x
    of_y = sqrt(max(R[1] - y_by_x * y_by_x, 0.0))
    t_by_y = (yt - t_by_x * y_by_x) * inverse_of(of_y)
    root = sqrt(max((R[2] if sees_heading else 0.0) - t_by_x * t_by_x - t_by_y * t_by_y, 0.0))
    theta = wrap(was.theta + t_by_x * first + t_by_y * second + root * turn) if sees_heading else 0.0
    return Pose(was.x + of_x * first, was.y + y_by_x * first + of_y * second, theta)


@kernel
def _pose(body):
    truth = body.true_state
    return Pose(truth.x, truth.y, truth.theta)


@cache
def fix_sensor(late: int) -> Sensor:
    """Return the sensor of fixes that come ``late`` steps late."""
    places = tuple(range(late + 1))

    @kernel
    def first(body, key, p):
        return TrackedFix(*NO_FIX, passed=tuple(_pose(body) for _ in places))

    @kernel
    def sense(body, before, key, at, p):
        passed = (_pose(body), *before.passed[:-1])
        own_key, stamp, every = sub_key(key, FIX), at - late, max(math.floor(p.fix.period / p.dt + 0.5), 1)
        event, _ = uniforms(own_key, stamp, EVENTS)
        arrived = (stamp > 0) & (stamp == every * math.floor(stamp / every)) & (event >= p.fix.dropout_probability)
        fix = before._replace(arrived=arrived, passed=passed)
        if arrived:
            pose = _measure(passed[late], p.fix, own_key, stamp)
            fix = fix._replace(pose=pose, R=p.fix.R, age=late * p.dt, cross=p.fix.cross)
        return fix

    return Sensor("fix", first, sense, FixNoise(R=(0.01, 0.01)))
