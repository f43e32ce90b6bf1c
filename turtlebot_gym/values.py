"""Value types of the closed loop.

Conventions: SI units and radians; the world frame unless said; angles in [-pi, pi). Values are ``NamedTuple``s of floats, so
that the same functions take them in plain Python and in compiled code.
"""

from __future__ import annotations

from typing import NamedTuple


class Pose(NamedTuple):
    """Planar pose in the world frame."""

    x: float
    """m"""
    y: float
    """m"""
    theta: float
    """Heading, rad, in [-pi, pi)."""


class Command(NamedTuple):
    """Planar twist in the body frame: what a robot is asked for."""

    v: float
    """Forward speed, m/s."""
    omega: float
    """Turning rate, rad/s."""


class State(NamedTuple):
    """Pose in the world frame and the twist, in the body frame, that moves it during the next control interval."""

    x: float
    y: float
    theta: float
    v: float
    omega: float


class Senses(NamedTuple):
    """What a robot knows of its own motion after a step."""

    odometry: Pose
    """The last pose that arrived; the world frame."""
    twist: Command
    """The twist that the wheels executed, in the body frame."""
    measured: bool
    """Whether the pose arrived in this step; if not, it is that of an earlier one."""


class Covariance(NamedTuple):
    """The 15 independent entries of the symmetric 5 x 5 covariance of a `State`, row by row from the diagonal on."""

    xx: float
    xy: float
    xt: float
    xv: float
    xw: float
    yy: float
    yt: float
    yv: float
    yw: float
    tt: float
    tv: float
    tw: float
    vv: float
    vw: float
    ww: float


class Belief(NamedTuple):
    """What a filter holds true: a Gaussian over the state."""

    mean: State
    covariance: Covariance


STOP = Command(0.0, 0.0)
"""The command that stops a robot."""
