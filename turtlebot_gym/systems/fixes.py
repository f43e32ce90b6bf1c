"""Fixes: any system with an additional external pose sensor that is infrequent, noisy and late.

A fix that comes now was measured some steps ago, so what is sensed carries where the robot was in the last steps.
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
    """What the sensors say, `estimation.fixes.FixedSenses`, and what they need to say more."""

    odometry: Pose
    twist: Command
    measured: bool
    fix: Fix
    passed: tuple[Pose, ...]
    """Where the robot was in the last steps, the newest first."""


@kernel
def measure(passed: Any, noise: FixNoise, key: int, at: int, dt: float) -> Fix:
    """Return the fix that comes in a step, if one does.

    Args:
        passed: Where the robot was, from this step on backwards.
        noise: Its noise, period and delay.
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
    """Return a system with fixes that come up to ``depth`` steps late; its filter must take them."""
    sense, first_sense, fill = system.sense, system.first_sense, filled(depth + 1)

    @kernel
    def sense_more(body, before, key, at, p):
        senses = sense(body, before, key, at, p)
        passed = (_pose(body),) + before.passed[:-1]  # noqa: RUF005  # compiled code knows no stars
        fix = measure(passed, p.fix, key, at, p.dt)
        return TrackedSenses(senses.odometry, senses.twist, senses.measured, fix, passed)

    @kernel
    def first_sense_more(body, key, p):
        senses = first_sense(body, key, p)
        return TrackedSenses(senses.odometry, senses.twist, senses.measured, no_fix(), fill(_pose(body)))

    example = system.example._replace(fix=FixNoise(R=(0.01, 0.01)))
    return system._replace(sense=sense_more, first_sense=first_sense_more, example=example)
