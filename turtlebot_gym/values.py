"""Value types of the closed loop.

Conventions: SI units and radians; the world frame unless stated; angles in [-pi, pi). Values are ``NamedTuple``s of floats, so
that the same functions take them in plain Python and in compiled code.
"""

from __future__ import annotations

from collections import namedtuple
from functools import cache
from typing import Any, NamedTuple


class Pose(NamedTuple):
    """Planar pose in the world frame: x and y, m, and the heading theta, rad, in [-pi, pi)."""

    x: float
    y: float
    theta: float


ORIGIN = Pose(0.0, 0.0, 0.0)


class Command(NamedTuple):
    """Planar twist in the body frame, as commanded: forward speed v, m/s, and turning rate omega, rad/s."""

    v: float
    omega: float


STOP = Command(0.0, 0.0)


class State(NamedTuple):
    """Pose in the world frame and the twist, in the body frame, that moves it during the next control interval."""

    x: float
    y: float
    theta: float
    v: float
    omega: float


class Odometry(NamedTuple):
    """The robot's odometry."""

    pose: Pose
    """The last measured pose that arrived."""
    twist: Command
    """The twist of the wheels, before slip: the one that they were set to, or on a robot the one that they measured."""
    measured: bool
    """Whether a pose arrived in this step."""


class SidewaysOdometry(Odometry):
    """Odometry whose twist also has a speed to the left, m/s, which a robot with two wheels does not have."""

    across: float


class Senses(NamedTuple):
    """The values of all sensors in a step; with further sensors a type from `senses_of`, whose fields are their names."""

    odometry: Odometry


@cache
def senses_of(names: tuple[str, ...]) -> Any:
    """Return the type of the values of sensors: `Senses` for odometry alone, or a NamedTuple with a field for each name."""
    return Senses if names == Senses._fields else namedtuple("Senses", names)  # noqa: PYI024  # a type for each set of names


class Fix(NamedTuple):
    """An external pose measurement, which may be late."""

    pose: Pose
    R: tuple[float, float, float]
    """Variances of x, y and heading; m^2, m^2, rad^2. Infinite for a heading that was not measured."""
    age: float
    """Time since the measurement, s."""
    arrived: bool
    """Whether a fix arrived in this step."""
    cross: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Covariances of x and y, x and heading, y and heading; m^2, m rad, m rad; 0 for a heading that was not measured."""


class Covariance(NamedTuple):
    """The covariance of a pose, and the variances of the twist, which each command replaces: nothing correlates the two."""

    xx: float
    xy: float
    xt: float
    yy: float
    yt: float
    tt: float
    vv: float = 0.0
    ww: float = 0.0


class Belief(NamedTuple):
    """A filter's belief: a Gaussian over the state."""

    mean: State
    covariance: Covariance
