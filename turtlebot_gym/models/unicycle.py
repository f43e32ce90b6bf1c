"""A unicycle: its limits, how it executes a command, and how it moves.

In one control interval the pose moves with the twist of the interval before, and then the twist follows the command:
a command acts one step late, as in the reference system.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from turtlebot_gym.kernel import algebra, kernel, sqrt
from turtlebot_gym.models.angles import sincos, wrap
from turtlebot_gym.parameters import REFERENCE_PERIOD, ProcessNoise
from turtlebot_gym.robots import Robot
from turtlebot_gym.values import Command, Pose

INTEGRATORS = {"euler": 0.0, "midpoint": 0.5}
"""Share of the interval at which the motion's heading is taken: at its start, as in the tutorial, or in its middle."""


@kernel
def command_of(forward: float, turn: float, robot: Robot) -> Command:
    """Return the command of an action: shares of the speed limits, clipped to [-1, 1]."""
    return Command(min(max(forward, -1.0), 1.0) * robot.max_linear, min(max(turn, -1.0), 1.0) * robot.max_angular)


ROUNDING = 1e-12  # share of a limit below which an excess is rounding, so that limiting a command twice changes no bit


@kernel
def limit(command: Command, robot: Robot) -> Command:
    """Scale a command into a robot's limits per axis and per wheel, without changing the curvature of its path.

    A robot that must not reverse only turns when it is commanded backwards.
    """
    forward = command.v if robot.reverse else max(command.v, 0.0)
    v, omega = abs(forward), abs(command.omega)
    wheel = v + omega * robot.wheel_separation * 0.5
    excess = max(max(v / robot.max_linear, omega / robot.max_angular), wheel / robot.max_wheel)
    excess = excess if excess > 1.0 + ROUNDING else 1.0
    return Command(forward / excess + 0.0, command.omega / excess + 0.0)  # adding 0 makes no zero negative


@kernel
def accelerate(before: Command, command: Command, robot: Robot, dt: float) -> Command:
    """Return the command as limited by acceleration within an interval, from the command in force before it."""
    dv, domega = robot.max_linear_acceleration * dt, robot.max_angular_acceleration * dt
    v = min(max(command.v, before.v - dv), before.v + dv) if dv < math.inf else command.v
    omega = min(max(command.omega, before.omega - domega), before.omega + domega) if domega < math.inf else command.omega
    return Command(v, omega)


class _Displacement(NamedTuple):
    """A displacement, m, m, rad; and the derivatives of x and y with respect to heading, speed and turning rate."""

    x: float
    y: float
    theta: float
    x_theta: float
    x_v: float
    x_omega: float
    y_theta: float
    y_v: float
    y_omega: float


@algebra
def motion(theta: float, v: float, omega: float, dt: float, integrator: float) -> _Displacement:
    """Return how a twist moves a pose with the heading ``theta`` in one interval, by a rule of `INTEGRATORS`."""
    sine, cosine = sincos(theta + integrator * omega * dt)
    x_theta, y_theta = -v * sine * dt, v * cosine * dt
    of_x, of_y = (x_theta, cosine * dt, integrator * dt * x_theta), (y_theta, sine * dt, integrator * dt * y_theta)
    return _Displacement(v * cosine * dt, v * sine * dt, omega * dt, *of_x, *of_y)


@kernel
def advance(pose: Pose, v: float, omega: float, dt: float, integrator: float) -> Pose:
    """Move a pose with a twist for one interval; see `motion`."""
    moved = motion(pose.theta, v, omega, dt, integrator)
    return Pose(pose.x + moved.x, pose.y + moved.y, wrap(pose.theta + moved.theta))


@algebra
def execution_variances(command: Command, noise: ProcessNoise, dt: float) -> tuple[float, float]:
    """Return the variances of the executed speed and turning rate around the command; m^2/s^2, rad^2/s^2.

    They are scaled by 0.1 s / dt, which makes the drift per metre the same at every control rate.
    """
    v2, omega2 = command.v * command.v, command.omega * command.omega
    scale = REFERENCE_PERIOD / dt
    return (noise.alpha1 * v2 + noise.alpha2 * omega2) * scale, (noise.alpha3 * v2 + noise.alpha4 * omega2) * scale


@algebra
def execute(command: Command, noise: ProcessNoise, slipping: bool, draws: tuple[float, float], dt: float) -> Command:
    """Return the twist that the robot actually executes for a command within its limits; draws are standard normal numbers."""
    var_v, var_omega = execution_variances(command, noise, dt)
    share = noise.scale * (1.0 - noise.slip if slipping else 1.0)
    turn = (command.omega + sqrt(var_omega) * draws[1]) * noise.turn_scale + noise.veer * command.v
    return Command((command.v + sqrt(var_v) * draws[0]) * share, turn * share)


@algebra
def expected(command: Command, noise: ProcessNoise, dt: float) -> tuple[Command, float, float]:
    """Return the mean of the executed twist without slip, and the variances of its speed and turning rate; see `execute`."""
    var_v, var_omega = execution_variances(command, noise, dt)
    turn = noise.scale * noise.turn_scale
    mean = Command(command.v * noise.scale, (command.omega * noise.turn_scale + noise.veer * command.v) * noise.scale)
    return mean, var_v * noise.scale * noise.scale, var_omega * turn * turn


@algebra
def slips(slipping: bool, noise: ProcessNoise, draw: float, dt: float) -> bool:
    """Return whether the wheels slip in the next step, by a uniform number in (0, 1): a two-state Markov chain."""
    scale = dt / REFERENCE_PERIOD
    return draw >= noise.slip_end * scale if slipping else draw < noise.slip_start * scale
