"""Sensors of a step: small values, put together to the senses, each with its own value in the field of its name.

So a sensor knows nothing of the others, and wrapping a system or a filter keeps what it wraps, in any order.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

from turtlebot_gym.kernel import kernel
from turtlebot_gym.models import odometry
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


@kernel
def _sense_odometry(body, before, key, at, p):
    """Return a measured pose, unless it is lost, and the twist that the wheels were set to, as it is counted."""
    truth, (v, omega), noise = body.true_state, body.command, p.noise.odometry
    pose = Pose(truth.x, truth.y, truth.theta)
    twist = Command(-v if odometry.miscounts(v, noise, key, at + 1, p.dt) else v, omega)  # which moves in the next step
    return odometry.sense(pose, body.wheels, twist, before, noise, key, at)


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
