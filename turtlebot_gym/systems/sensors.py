"""Sensors of a step: small values, put together to the senses, each with its own value in the field of its name.

So a sensor knows nothing of the others, and wrapping a system or a filter keeps what it wraps, in any order.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any, NamedTuple

from turtlebot_gym.config import NON_NEGATIVE, check_fields
from turtlebot_gym.estimation.fixes import NO_FIX
from turtlebot_gym.kernel import kernel, sqrt
from turtlebot_gym.models import odometry
from turtlebot_gym.models.angles import wrap
from turtlebot_gym.models.random import EVENTS, FIX, GYRO, HEADING, POSITION, normals, sub_key, uniforms
from turtlebot_gym.parameters import FixNoise
from turtlebot_gym.values import Command, Odometry, Pose, senses_of


class Sensor(NamedTuple):
    """A sensor of the robot."""

    name: str
    """Its field in the senses."""
    first: Callable[..., Any]
    """``first(body, key, p)`` returns its value at the start."""
    sense: Callable[..., Any]
    """``sense(body, before, key, at, p)`` returns its value after step ``at``; ``before`` is its own value one step
    earlier, which may hold what the sensor must remember."""
    noise: Any = None
    """Example of its parameters, which are the field of its name in `systems.parameters.Parameters`; None if it has none."""
    due: Callable[..., bool] | None = None
    """``due(at, p)`` returns whether there may be news in step ``at``; None for always."""
    wait: Callable[..., Any] | None = None
    """`sense` in a step without news, in which compiled loops leave out what a filter does with news."""


@kernel
def _pose(body):
    truth = body.true_state
    return Pose(truth.x, truth.y, truth.theta)


@kernel
def _sense_odometry(body, before, key, at, p):
    """Return a measured pose, unless it is lost, and the twist that the wheels were set to, as it is counted."""
    (v, omega), noise = body.command, p.noise.odometry
    twist = Command(-v if odometry.miscounts(v, noise, key, at + 1, p.dt) else v, omega)  # which moves in the next step
    return odometry.sense(_pose(body), body.wheels, twist, before, noise, key, at)


@kernel
def _first_odometry(body, key, p):
    """Return the odometry at the start, where a measurement always arrives."""
    return _sense_odometry(body, Odometry(body.wheels, body.command, True), key, 0, p)


ODOMETRY = Sensor("odometry", _first_odometry, _sense_odometry)


@cache
def sensing(sensors: tuple[Sensor, ...]) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """Return the kernels ``first`` and ``sense`` of a set of sensors."""
    Senses = senses_of(tuple(sensor.name for sensor in sensors))

    @kernel
    def first(body, key, p):
        return Senses(*(sensor.first(body, key, p) for sensor in sensors))

    @kernel
    def sense(body, before, key, at, p):
        return Senses(*(sensor.sense(body, getattr(before, sensor.name), key, at, p) for sensor in sensors))

    return first, sense


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


@cache
def fix_sensor(late: int) -> Sensor:
    """Return the external pose sensor whose fixes come ``late`` steps late: it remembers the poses of the last steps."""
    places = tuple(range(late + 1))

    @kernel
    def first(body, key, p):
        return TrackedFix(*NO_FIX, passed=tuple(_pose(body) for _ in places))

    @kernel
    def due(at, p):
        stamp, every = at - late, max(math.floor(p.fix.period / p.dt + 0.5), 1)
        return (stamp > 0) & (stamp == every * math.floor(stamp / every))

    @kernel
    def wait(body, before, key, at, p):
        return before._replace(arrived=False, passed=(_pose(body), *before.passed[:-1]))

    @kernel
    def sense(body, before, key, at, p):
        fix, own_key, stamp = wait(body, before, key, at, p), sub_key(key, FIX), at - late
        event, _ = uniforms(own_key, stamp, EVENTS)
        if due(at, p) & (event >= p.fix.dropout_probability):
            pose = _measure(fix.passed[late], p.fix, own_key, stamp)
            fix = fix._replace(pose=pose, R=p.fix.R, age=late * p.dt, arrived=True)
        return fix

    return Sensor("fix", first, sense, FixNoise(R=(0.01, 0.01)), due, wait)


@dataclass(frozen=True, slots=True, kw_only=True)
class ImuNoise:
    """Difference between the turning rate that a gyro measures and the true one: white noise and a bias that drifts."""

    variance: Annotated[float, NON_NEGATIVE] = 0.0
    """Variance of the white noise of a measurement, (rad/s)^2."""
    bias_deviation: Annotated[float, NON_NEGATIVE] = 0.0
    """Standard deviation of the bias at the start of an episode, rad/s."""
    bias_walk: Annotated[float, NON_NEGATIVE] = 0.0
    """Standard deviation that the bias gains in the first second, rad/s; it grows with the root of time."""

    __post_init__ = check_fields


_WHITE = math.radians(0.1) ** 2
IMUS = {
    "mpu9250": ImuNoise(variance=_WHITE, bias_deviation=math.radians(5.0 / math.sqrt(3.0))),
    "calibrated": ImuNoise(variance=_WHITE, bias_deviation=math.radians(0.1), bias_walk=math.radians(0.5) / math.sqrt(600.0)),
}
"""Gyros by name, from the data sheet of the MPU-9250 on TurtleBot3's board (InvenSense PS-MPU-9250A-01, table 1): white noise
of 0.1 degrees/s, and a bias within 5 degrees/s when it is switched on. Calibrated: the bias was measured at rest and taken off,
and comes back with the temperature, by up to 30 degrees/s in 60 K, so by half a degree/s for each kelvin; one kelvin in 10
minutes is assumed."""


class Imu(NamedTuple):
    """Measured turning rate."""

    omega: float
    """rad/s"""
    bias: float
    """Its bias, rad/s, which the sensor remembers and no filter may read."""


@kernel
def _rate(body, bias, white, p):
    return Imu(body.true_state.omega + bias + sqrt(p.imu.variance) * white, bias)


@kernel
def _first_rate(body, key, p):
    """Return the turning rate at the start, with the bias that the episode begins with."""
    own_key = sub_key(key, GYRO)
    white, _ = normals(own_key, 0, POSITION)
    start, _ = normals(own_key, 0, HEADING)
    return _rate(body, p.imu.bias_deviation * start, white, p)


@kernel
def _sense_rate(body, before, key, at, p):
    """Return the executed turning rate, after the bias has drifted."""
    white, drift = normals(sub_key(key, GYRO), at, POSITION)
    return _rate(body, before.bias + p.imu.bias_walk * sqrt(p.dt) * drift, white, p)


IMU = Sensor("imu", _first_rate, _sense_rate, ImuNoise())
