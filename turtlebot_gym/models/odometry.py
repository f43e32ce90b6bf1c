"""Odometry: a measured pose, or a pose integrated from the wheels."""

from __future__ import annotations

import math

from turtlebot_gym.kernel import kernel, sqrt
from turtlebot_gym.models.angles import wrap
from turtlebot_gym.models.random import EVENTS, HEADING, POSITION, normals, uniforms
from turtlebot_gym.parameters import OdometryNoise
from turtlebot_gym.values import Command, Odometry, Pose


@kernel
def quantize(value: float, resolution: float) -> float:
    """Round to a multiple of the resolution; a resolution of zero leaves the value as it is."""
    rounded = resolution * math.floor(value / (resolution if resolution > 0.0 else 1.0) + 0.5)
    return rounded if resolution > 0.0 else value


@kernel
def measure(
    pose: Pose,
    wheels: Pose,
    noise: OdometryNoise,
    position: tuple[float, float],
    heading: float,
    event: float,
) -> Pose:
    """Measure a pose.

    Args:
        pose: The true pose.
        wheels: The pose integrated from the wheels.
        noise: The odometry's errors.
        position: Two standard normal numbers.
        heading: A standard normal number.
        event: A uniform number in (0, 1) that decides on a heading spike and its sign.
    """
    half = 0.5 * noise.spike_probability
    spike = noise.spike if event < half else (-noise.spike if event < noise.spike_probability else 0.0)
    x, y, theta = (wheels.x, wheels.y, wheels.theta) if noise.wheel else (pose.x, pose.y, pose.theta)
    return Pose(
        quantize(x + noise.bias[0] + sqrt(noise.R[0]) * position[0], noise.quantization[0]),
        quantize(y + noise.bias[1] + sqrt(noise.R[1]) * position[1], noise.quantization[0]),
        wrap(quantize(theta + noise.bias[2] + sqrt(noise.R[2]) * heading + spike, noise.quantization[1])),
    )


@kernel
def sense(pose: Pose, wheels: Pose, twist: Command, before: Odometry, noise: OdometryNoise, key: int, at: int) -> Odometry:
    """Return the odometry at a step; if a measurement is lost, the last pose that arrived is kept.

    Args:
        pose: The true pose.
        wheels: The pose that the wheels have integrated.
        twist: The executed twist.
        before: The odometry one step earlier.
        noise: The odometry's errors.
        key: The episode's key, from `models.random.episode_key`.
        at: The step's number; the measurement of step 0 always arrives.
    """
    heading, _ = normals(key, at, HEADING)
    event, dropout = uniforms(key, at, EVENTS)
    z = measure(pose, wheels, noise, normals(key, at, POSITION), heading, event)
    measured = (dropout >= noise.dropout_probability) | (at == 0)  # without the branch of an `or`
    last = before.pose
    newest = Pose(z.x if measured else last.x, z.y if measured else last.y, z.theta if measured else last.theta)
    return Odometry(newest, twist, measured)


@kernel
def increment(pose: Pose, before: Pose, after: Pose, sincos_turn: tuple[float, float]) -> Pose:
    """Move a pose as the odometry moved from ``before`` to ``after``.

    So it changes frames, too: if ``pose`` in one frame is ``before`` in another, ``after`` is what is returned.

    Args:
        pose: The pose to move.
        before: Odometry at the start of the interval.
        after: Odometry at its end.
        sincos_turn: Sine and cosine of ``pose.theta - before.theta``, the turn from odometry's frame into the pose's.
    """
    sine, cosine = sincos_turn
    dx, dy = after.x - before.x, after.y - before.y
    return Pose(
        pose.x + cosine * dx - sine * dy, pose.y + sine * dx + cosine * dy, wrap(pose.theta + (after.theta - before.theta))
    )
