"""Conversion between poses with a covariance and their messages, ``PoseWithCovarianceStamped``.

A `Fix` states its covariance, of which the entries above the diagonal count; the variance -1 of the heading means that it was
not measured, and its covariances then do not count. An `InitialPose` may state none: Nav2's clients send zeros.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

from geometry_msgs.msg import PoseWithCovarianceStamped
from std_msgs.msg import Header

from turtlebot_gym.config import LARGEST, LEAST
from turtlebot_gym.localization.localizer import Located
from turtlebot_gym.parameters import is_covariance
from turtlebot_gym.values import Fix
from turtlebot_gym_ros.node.block import InitialPose
from turtlebot_gym_ros.node.geometry import read_pose, write_pose
from turtlebot_gym_ros.node.places import finite, place

PLANAR_POSE = (0, 7, 35)
"""Places of the variances of x, y and heading in a row-major covariance of x y z roll pitch yaw."""
_BESIDE = (1, 6), (5, 30), (11, 31)  # of x and y, x and yaw, y and yaw
NOT_KNOWN = -1.0
"""Variance of what is not known."""
BY_EYE = (0.25, 0.25, (math.pi / 12.0) ** 2)
"""Variances of x, y and heading of an initial pose that states none, m^2, m^2, rad^2: those of RViz's 2D Pose Estimate
(rviz_default_plugins, ``initial_pose_tool.cpp``)."""


def write_pose_covariance(covariance: Any, variances: Iterable[float], cross: Iterable[float]) -> None:
    """Write the variances of x, y and heading, and the covariances of x and y, x and heading, y and heading."""
    for at, value in zip(PLANAR_POSE, variances, strict=True):
        covariance[at] = value
    for (above, below), value in zip(_BESIDE, cross, strict=True):
        covariance[above] = covariance[below] = value


def fix_of(message: PoseWithCovarianceStamped) -> Fix:
    """Return a fix; raise `ValueError` if it states no covariance, or no pose."""
    covariance = message.pose.covariance
    x, y, heading = (float(covariance[at]) for at in PLANAR_POSE)
    if not (LEAST <= x <= LARGEST and LEAST <= y <= LARGEST):
        got = f"got {x:g} and {y:g}, not {LEAST:g} to {LARGEST:g}"
        raise ValueError(f"a fix must state positive variances of x and y, {got}")
    if not (heading < 0.0 or LEAST <= heading <= LARGEST or heading == math.inf):
        raise ValueError(f"a fix must state the heading's variance, or -1 where it was not measured, got {heading:g}")
    measured, position = heading > 0.0, message.pose.pose.position
    xy, xt, yt = (float(covariance[at]) for at, _ in _BESIDE)
    R, cross = (x, y, heading if measured else math.inf), (xy, xt, yt) if measured else (xy, 0.0, 0.0)
    if not is_covariance(R, cross):
        raise ValueError(f"a fix must state a covariance, but no errors have {xy:g}, {xt:g} and {yt:g} off its diagonal")
    pose = read_pose(message.pose.pose) if measured else place(position.x, position.y, 0.0)
    return Fix(pose, R, 0.0, True, cross)


def initial_pose_of(message: PoseWithCovarianceStamped) -> InitialPose:
    """Return the pose that a person or program shows; raise `ValueError` if its covariance is neither one nor all zeros."""
    if any(message.pose.covariance):
        return InitialPose(*fix_of(message))
    return InitialPose(read_pose(message.pose.pose), BY_EYE, 0.0, True)


def _pose_and_covariance(
    pose: Iterable[float], variances: Iterable[float], cross: Iterable[float], header: Header
) -> PoseWithCovarianceStamped:
    message = PoseWithCovarianceStamped(header=header)
    write_pose(message.pose.pose, pose)
    write_pose_covariance(message.pose.covariance, variances, cross)
    return message


def fix_to_message(fix: Fix, header: Header) -> PoseWithCovarianceStamped:
    """Return the message of a fix."""
    x, y, heading = fix.R
    return _pose_and_covariance(fix.pose, (x, y, heading if heading < math.inf else NOT_KNOWN), fix.cross, header)


def located_to_message(located: Located, header: Header) -> PoseWithCovarianceStamped:
    """Return the message of a localizer's belief; raise `ValueError` if the covariance is not finite."""
    mean, P = located.belief
    finite("the covariance", P)
    return _pose_and_covariance(mean[:3], (P.xx, P.yy, P.tt), (P.xy, P.xt, P.yt), header)
