"""The gyro of an inertial measurement unit: the turning rate, with white noise and a bias that drifts."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, NamedTuple

from turtlebot_gym.config import NON_NEGATIVE, check_fields
from turtlebot_gym.kernel import kernel, sqrt
from turtlebot_gym.models.random import HEADING, POSITION, normals, sub_key
from turtlebot_gym.systems.sensors import Sensor

_USE = 5  # of an episode's key, beside those in `models.random`


@dataclass(frozen=True, slots=True, kw_only=True)
class ImuNoise:
    """Difference between the measured turning rate and the true one."""

    variance: Annotated[float, NON_NEGATIVE] = 0.0
    """Variance of the white noise of a measurement, (rad/s)^2."""
    bias_deviation: Annotated[float, NON_NEGATIVE] = 0.0
    """Standard deviation of the bias at the start of an episode, rad/s."""
    bias_walk: Annotated[float, NON_NEGATIVE] = 0.0
    """Standard deviation that the bias gains in the first second, rad/s; it grows with the root of time."""

    def __post_init__(self) -> None:
        check_fields(self)


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
def _read(body, bias, white, p):
    return Imu(body.true_state.omega + bias + sqrt(p.imu.variance) * white, bias)


@kernel
def _first(body, key, p):
    """Return the turning rate at the start, with the bias that the episode begins with."""
    own_key = sub_key(key, _USE)
    white, _ = normals(own_key, 0, POSITION)
    start, _ = normals(own_key, 0, HEADING)
    return _read(body, p.imu.bias_deviation * start, white, p)


@kernel
def _sense(body, before, key, at, p):
    """Return the executed turning rate, after the bias has drifted."""
    white, drift = normals(sub_key(key, _USE), at, POSITION)
    return _read(body, before.bias + p.imu.bias_walk * sqrt(p.dt) * drift, white, p)


IMU = Sensor("imu", _first, _sense, ImuNoise())
