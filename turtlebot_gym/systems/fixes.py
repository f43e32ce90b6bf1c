"""Fixes: an external pose sensor that is infrequent, noisy and late.

A fix that arrives now was measured some steps ago, so the sensor remembers the robot's poses of the last steps.
"""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

from turtlebot_gym.estimation.fixes import filled, no_fix
from turtlebot_gym.kernel import kernel, sqrt
from turtlebot_gym.models.angles import wrap
from turtlebot_gym.models.random import EVENTS, FIX, HEADING, POSITION, normals, sub_key, uniforms
from turtlebot_gym.parameters import FixNoise
from turtlebot_gym.systems.sensors import Sensor
from turtlebot_gym.values import Pose


class TrackedFix(NamedTuple):
    """A `values.Fix`, and what the sensor remembers for later ones, which no filter may read."""

    pose: Pose
    R: tuple[float, float, float]
    age: float
    arrived: bool
    passed: tuple[Pose, ...]
    """The robot's poses in the last steps, newest first."""


@kernel
def _measure(passed: Any, noise: FixNoise, key: int, at: int, dt: float) -> TrackedFix:
    """Return the fix that arrives in a step, if any.

    Args:
        passed: The robot's poses, from this step backwards.
        noise: Noise, period and delay of the sensor.
        key: The episode's key, from `models.random.episode_key`.
        at: The step's number.
        dt: Control interval, s.
    """
    late, every = int(noise.delay / dt + 0.5), max(int(noise.period / dt + 0.5), 1)
    stamp, own_key = at - late, sub_key(key, FIX)
    one, other = normals(own_key, stamp, POSITION)
    turn, _ = normals(own_key, stamp, HEADING)
    event, _ = uniforms(own_key, stamp, EVENTS)
    was, R = passed[late], noise.R
    sees_heading = R[2] < 1e300
    theta = wrap(was.theta + sqrt(R[2] if sees_heading else 0.0) * turn) if sees_heading else 0.0
    arrived = (stamp > 0) & (stamp % every == 0) & (event >= noise.dropout_probability)
    pose = Pose(was.x + sqrt(R[0]) * one, was.y + sqrt(R[1]) * other, theta)
    return TrackedFix(pose, (R[0], R[1], R[2]), late * dt, arrived, passed)


@kernel
def _pose(body):
    truth = body.true_state
    return Pose(truth.x, truth.y, truth.theta)


@cache
def fix_sensor(depth: int) -> Sensor:
    """Return the sensor of fixes up to ``depth`` steps late."""
    fill = filled(depth + 1)

    @kernel
    def first(body, key, p):
        fix = no_fix()
        return TrackedFix(fix.pose, fix.R, fix.age, fix.arrived, fill(_pose(body)))

    @kernel
    def sense(body, before, key, at, p):
        passed = (_pose(body),) + before.passed[:-1]  # noqa: RUF005  # compiled code has no star expressions
        return _measure(passed, p.fix, key, at, p.dt)

    return Sensor("fix", first, sense, FixNoise(R=(0.01, 0.01)))
