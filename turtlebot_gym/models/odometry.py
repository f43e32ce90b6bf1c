"""Odometry: a measured pose, or a pose integrated from the wheels."""

from __future__ import annotations

from turtlebot_gym.kernel import kernel, sqrt
from turtlebot_gym.models.angles import PI, TWO_PI, sincos, wrap
from turtlebot_gym.models.random import COUNT, EVENTS, HEADING, LEAP, POSITION, normals, uniforms
from turtlebot_gym.parameters import REFERENCE_PERIOD, OdometryNoise
from turtlebot_gym.values import Command, Odometry, Pose


@kernel
def measure(
    pose: Pose, wheels: Pose, noise: OdometryNoise, position: tuple[float, float], heading: float, event: float
) -> Pose:
    """Measure the true pose, or the one integrated from the wheels.

    ``position`` and ``heading`` are standard normal numbers, ``event`` is a uniform one in (0, 1) that decides on a heading
    spike and its sign.
    """
    half = 0.5 * noise.spike_probability
    spike = noise.spike if event < half else (-noise.spike if event < noise.spike_probability else 0.0)
    x, y, theta = wheels if noise.wheel else pose
    return Pose(
        x + noise.bias[0] + sqrt(noise.R[0]) * position[0],
        y + noise.bias[1] + sqrt(noise.R[1]) * position[1],
        wrap(theta + noise.bias[2] + sqrt(noise.R[2]) * heading + spike),
    )


@kernel
def miscounts(v: float, noise: OdometryNoise, key: int, at: int, dt: float) -> bool:
    """Return whether the wheels' speed v, m/s, is backwards in step ``at`` and counted as forwards."""
    draw, _ = uniforms(key, at, COUNT)
    return (v < 0.0) & (draw < noise.reverse_probability * (dt / REFERENCE_PERIOD))


@kernel
def counted(before: Pose, after: Pose, v: float, noise: OdometryNoise, key: int, at: int, dt: float) -> Pose:
    """Return the pose that the wheels integrate in a step, with what goes wrong: wrong directions, leaps and resets.

    ``before`` and ``after`` are the integrated poses at its start and end, by the wheels' motion; ``v`` is their speed, m/s.
    """
    share, wrong = dt / REFERENCE_PERIOD, miscounts(v, noise, key, at, dt)
    x, y = (2.0 * before.x - after.x if wrong else after.x), (2.0 * before.y - after.y if wrong else after.y)
    event, to = uniforms(key, at, LEAP)
    sine, cosine = sincos(TWO_PI * to - PI)
    leaps, resets = event < noise.leap_probability * share, event >= 1.0 - noise.reset_probability * share
    turn = noise.leap_turn if to < 0.5 else -noise.leap_turn
    x, y = (x + noise.leap * cosine if leaps else x), (y + noise.leap * sine if leaps else y)
    theta = wrap(after.theta + turn) if leaps else after.theta
    return Pose(0.0, 0.0, 0.0) if resets else Pose(x, y, theta)


@kernel
def sense(pose: Pose, wheels: Pose, twist: Command, before: Odometry, noise: OdometryNoise, key: int, at: int) -> Odometry:
    """Return the odometry at a step: if a measurement is lost, the last pose that arrived; that of step 0 always arrives.

    ``pose`` is the true one, ``wheels`` that of the wheels, and ``before`` the odometry one step earlier.
    """
    heading, _ = normals(key, at, HEADING)
    event, dropout = uniforms(key, at, EVENTS)
    z = measure(pose, wheels, noise, normals(key, at, POSITION), heading, event)
    goes_on = (dropout < 1.0 - noise.gap_end) & (not before.measured)
    measured = ((dropout >= noise.dropout_probability) & (not goes_on)) | (at == 0)  # without the branch of an `or`
    return Odometry(z if measured else before.pose, twist, measured)


@kernel
def increment(pose: Pose, before: Pose, after: Pose, sincos_turn: tuple[float, float]) -> Pose:
    """Move a pose as the odometry moved from ``before`` to ``after``; so it changes frames, too.

    ``sincos_turn`` has sine and cosine of ``pose.theta - before.theta``, the turn from odometry's frame into the pose's.
    """
    (sine, cosine), dx, dy = sincos_turn, after.x - before.x, after.y - before.y
    theta = wrap(pose.theta + (after.theta - before.theta))
    return Pose(pose.x + cosine * dx - sine * dy, pose.y + sine * dx + cosine * dy, theta)
