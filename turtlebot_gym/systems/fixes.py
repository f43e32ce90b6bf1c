"""Fixes: any system with an additional external pose sensor that is infrequent, noisy and late.

A fix that arrives now was measured some steps ago, so the senses include the robot's poses of the last steps.
"""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

from turtlebot_gym.estimation.fixes import filled, no_fix
from turtlebot_gym.kernel import kernel, sqrt
from turtlebot_gym.models.angles import wrap
from turtlebot_gym.models.random import EVENTS, FIX, HEADING, POSITION, normals, sub_key, uniforms
from turtlebot_gym.parameters import FixNoise
from turtlebot_gym.systems.system import System
from turtlebot_gym.values import Command, Fix, Pose


class TrackedSenses(NamedTuple):
    """The sensors' values, `estimation.fixes.FixedSenses`, and the history that later fixes need."""

    odometry: Pose
    twist: Command
    measured: bool
    fix: Fix
    passed: tuple[Pose, ...]
    """The robot's poses in the last steps, newest first."""


@kernel
def measure(passed: Any, noise: FixNoise, key: int, at: int, dt: float) -> Fix:
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
    return Fix(pose, (R[0], R[1], R[2]), late * dt, arrived)


@kernel
def _pose(body):
    truth = body.true_state
    return Pose(truth.x, truth.y, truth.theta)


@cache
def seeing_fixes(system: System, depth: int) -> System:
    """Return a system with fixes up to ``depth`` steps late; its filter must accept them."""
    sense, first_sense, fill = system.sense, system.first_sense, filled(depth + 1)

    @kernel
    def sense_more(body, before, key, at, p):
        senses = sense(body, before, key, at, p)
        passed = (_pose(body),) + before.passed[:-1]  # noqa: RUF005  # compiled code has no star expressions
        fix = measure(passed, p.fix, key, at, p.dt)
        return TrackedSenses(senses.odometry, senses.twist, senses.measured, fix, passed)

    @kernel
    def first_sense_more(body, key, p):
        senses = first_sense(body, key, p)
        return TrackedSenses(senses.odometry, senses.twist, senses.measured, no_fix(), fill(_pose(body)))

    example = system.example._replace(fix=FixNoise(R=(0.01, 0.01)))
    return system._replace(sense=sense_more, first_sense=first_sense_more, example=example)
