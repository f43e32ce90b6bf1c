"""Fixes: an external pose sensor that is infrequent, noisy and late.

A fix that arrives now was measured some steps ago, so the sensor remembers the robot's poses of the last steps.
"""

from __future__ import annotations

import math
from functools import cache
from typing import NamedTuple

from turtlebot_gym.estimation.fixes import NO_FIX
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
    R, sees_heading = noise.R, noise.R[2] < 1e300
    first, second = normals(key, stamp, POSITION)
    turn, _ = normals(key, stamp, HEADING)
    theta = wrap(was.theta + sqrt(R[2] if sees_heading else 0.0) * turn) if sees_heading else 0.0
    return Pose(was.x + sqrt(R[0]) * first, was.y + sqrt(R[1]) * second, theta)


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
            fix = fix._replace(pose=pose, R=p.fix.R, age=late * p.dt)
        return fix

    return Sensor("fix", first, sense, FixNoise(R=(0.01, 0.01)))
