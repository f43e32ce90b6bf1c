"""Conversion between the values of blocks and the messages on topics.

The shell checks world frames. Values that are not finite and quaternions that are not rotations are refused here, in both
directions, with a ``ValueError`` that gives the reason.

`values.Odometry` is sent on ``/odom``. If no pose arrived in this step, the message repeats the last one and marks
it by ``pose.covariance[0] = -1``, the convention of ``sensor_msgs/Imu`` for unknown values. The twist is valid in either case.
A robot's own odometry, with zeros or variances in the covariance, counts as measured.

Headings survive the conversion to a quaternion bit-exactly, see `geometry.half_turn`.

Covariances are row-major 6 x 6, in the order x y z roll pitch yaw. Quantities that a planar robot does not know, height, roll,
pitch and sideways speed, have the variance -1 by the same convention; RViz then draws an ellipse instead of an ellipsoid. An
`Odometry` message has no field for the normalized innovation squared, which a policy observes, so an estimate read from a
message has the value 0 for it, and it has a topic of its own, ``nis``: x is the number, y and z are what a localizer says
besides, or NaN. The common packages have no message for a stamped number.

A `Fix` states its covariance, of which the entries above the diagonal count; the variance -1 of the heading means that it was
not measured, and its covariances then do not count. An `InitialPose` may state none: Nav2's clients send zeros.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Any

from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, Twist, TwistStamped, Vector3, Vector3Stamped
from nav_msgs.msg import Odometry
from std_msgs.msg import Empty, Header, String

from turtlebot_gym import values
from turtlebot_gym.config import LARGEST, LEAST
from turtlebot_gym.estimation.ekf import Estimate
from turtlebot_gym.localization.localizer import Located
from turtlebot_gym.parameters import is_covariance
from turtlebot_gym.values import Belief, Command, Covariance, Fix, Pose, State
from turtlebot_gym_ros.base.names import message_type
from turtlebot_gym_ros.node.block import Disagreement, InitialPose, Input, Nis, Resume, Transform
from turtlebot_gym_ros.node.geometry import (
    FASTEST,
    Conversion,
    finite,
    place,
    read_pose,
    read_twist,
    unread,
    write_pose,
    write_twist,
)
from turtlebot_gym_ros.node.rooms import ROOM_CONVERSIONS

# Diagonal places in the order x y z roll pitch yaw, row-major: those that a planar robot knows, and those that it does not.
_UNUSED_IN_POSE, _UNUSED_IN_TWIST = (14, 21, 28), (7, 14, 21, 28)
_PLANAR = (0, 7, 35)
"""Places of the variances of x, y and heading in a row-major covariance of x y z roll pitch yaw."""
_BESIDE = (1, 6), (5, 30), (11, 31)  # of x and y, x and yaw, y and yaw
_NOT_KNOWN = -1.0
_BY_EYE = (0.25, 0.25, (math.pi / 12.0) ** 2)
"""Variances of x, y and heading of an initial pose that states none, m^2, m^2, rad^2: those of RViz's 2D Pose Estimate
(rviz_default_plugins, ``initial_pose_tool.cpp``)."""
_NO_TF = "publish_tf needs tf2_msgs, which PyPI lacks: source a ROS installation, or take ROS from RoboStack with pixi."

CONVERSIONS: dict[type, Conversion] = dict(ROOM_CONVERSIONS)


def register(
    value_type: type,
    message_type: type,
    read: Callable[[Any], Any],
    write: Callable[[Any, Header], Any],
    *,
    in_world: bool = False,
) -> None:
    """Register the conversion of a type of value, that blocks take and return, to a type of message.

    ``read(message)`` returns the value, ``write(value, header)`` the message; either raises `ValueError` to refuse. With
    ``in_world`` the header must name the world frame.
    """
    CONVERSIONS[value_type] = Conversion(message_type, read, write, in_world)


def conversion(value_type: type, *, stamped: bool = True) -> Conversion:
    """Return the conversion of a type of value, of a `Command` as TwistStamped or Twist; raise `ValueError` without one."""
    if value_type is Command and not stamped:
        return _UNSTAMPED
    if value_type is Transform and value_type not in CONVERSIONS:
        raise ValueError(_NO_TF)
    if value_type not in CONVERSIONS:
        raise ValueError(f"No message is known for values of type {value_type.__name__}: call register(...) first.")
    return CONVERSIONS[value_type]


def conversion_of(source: Input, *, stamped: bool = True) -> Conversion:
    """Return the conversion of an input's values; raise `ValueError` if there is no such type of value or message."""
    if not source.message:
        return conversion(source.type, stamped=stamped)
    assert source.read is not None
    return Conversion(message_type(source.message), source.read, lambda value, header: unread(value), False)


def _pose_to_message(pose: Pose, header: Header) -> PoseStamped:
    message = PoseStamped(header=header)
    write_pose(message.pose, pose)
    return message


def _state_of(message: Odometry) -> State:
    return State(*read_pose(message.pose.pose), *read_twist(message.twist.twist))


def _state_to_message(state: State, header: Header) -> Odometry:
    message = Odometry(header=header)
    write_pose(message.pose.pose, state[:3])
    write_twist(message.twist.twist, state.v, state.omega)
    return message


def _odometry_of(message: Odometry) -> values.Odometry:
    first = float(message.pose.covariance[0])
    if math.isnan(first):
        raise ValueError("pose.covariance[0] is NaN: it states a variance, 0 if none is known, or -1 if there is no pose")
    said = read_pose(message.pose.pose), read_twist(message.twist.twist), first >= 0.0
    across = float(message.twist.twist.linear.y)
    if across == 0.0:
        return values.Odometry(*said)
    finite("the twist", (across,), most=FASTEST)
    odometry = values.SidewaysOdometry(*said)
    odometry.across = across
    return odometry


def _odometry_to_message(odometry: values.Odometry, header: Header) -> Odometry:
    message = _state_to_message(State(*odometry.pose, *odometry.twist), header)
    if not odometry.measured:
        message.pose.covariance[0] = _NOT_KNOWN
    return message


def _estimate_of(message: Odometry) -> Estimate:
    pose, twist = (tuple(map(float, part.covariance)) for part in (message.pose, message.twist))  # faster than NumPy's
    finite("the covariance", (*pose, *twist), most=LARGEST)
    P = Covariance(pose[0], pose[1], pose[5], pose[7], pose[11], pose[35], twist[0], twist[35])
    if min(P.xx, P.yy, P.tt, P.vv, P.ww) < 0.0:
        raise ValueError(f"variances must not be negative, got {P.xx:g}, {P.yy:g}, {P.tt:g}, {P.vv:g}, {P.ww:g}")
    return Estimate(Belief(_state_of(message), P), 0.0, 0.0)


def _estimate_to_message(estimate: Estimate, header: Header) -> Odometry:
    mean, P = estimate.belief
    message = _state_to_message(mean, header)
    finite("the covariance", P)
    pose, twist = message.pose.covariance, message.twist.covariance
    _write_pose_covariance(pose, (P.xx, P.yy, P.tt), (P.xy, P.xt, P.yt))
    twist[0], twist[35] = P.vv, P.ww
    twist[5] = twist[30] = 0.0
    for covariance, unused in ((pose, _UNUSED_IN_POSE), (twist, _UNUSED_IN_TWIST)):
        for at in unused:
            covariance[at] = _NOT_KNOWN
    return message


def _write_pose_covariance(covariance: Any, variances: Iterable[float], cross: Iterable[float]) -> None:
    """Write the variances of x, y and heading, and the covariances of x and y, x and heading, y and heading."""
    for at, value in zip(_PLANAR, variances, strict=True):
        covariance[at] = value
    for (above, below), value in zip(_BESIDE, cross, strict=True):
        covariance[above] = covariance[below] = value


def _fix_of(message: PoseWithCovarianceStamped) -> Fix:
    """Return a fix; raise `ValueError` if it states no covariance, or no pose."""
    covariance = message.pose.covariance
    x, y, heading = (float(covariance[at]) for at in _PLANAR)
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


def _initial_pose_of(message: PoseWithCovarianceStamped) -> InitialPose:
    """Return the pose that a person or program shows; raise `ValueError` if its covariance is neither one nor all zeros."""
    if any(message.pose.covariance):
        return InitialPose(*_fix_of(message))
    return InitialPose(read_pose(message.pose.pose), _BY_EYE, 0.0, True)


def _pose_and_covariance(
    pose: Iterable[float], variances: Iterable[float], cross: Iterable[float], header: Header
) -> PoseWithCovarianceStamped:
    message = PoseWithCovarianceStamped(header=header)
    write_pose(message.pose.pose, pose)
    _write_pose_covariance(message.pose.covariance, variances, cross)
    return message


def _fix_to_message(fix: Fix, header: Header) -> PoseWithCovarianceStamped:
    """Return the message of a fix."""
    x, y, heading = fix.R
    return _pose_and_covariance(fix.pose, (x, y, heading if heading < math.inf else _NOT_KNOWN), fix.cross, header)


def _located_to_message(located: Located, header: Header) -> PoseWithCovarianceStamped:
    """Return the message of a localizer's belief; raise `ValueError` if the covariance is not finite."""
    mean, P = located.belief
    finite("the covariance", P)
    return _pose_and_covariance(mean[:3], (P.xx, P.yy, P.tt), (P.xy, P.xt, P.yt), header)


def _command_to_stamped(command: Command, header: Header) -> TwistStamped:
    message = TwistStamped(header=header)
    write_twist(message.twist, *command)
    return message


def _command_to_message(command: Command, header: Header) -> Twist:
    message = Twist()
    write_twist(message, *command)
    return message


def _nis_of(message: Vector3Stamped) -> Nis:
    said = message.vector
    fits, weight = (None if math.isnan(number) else number for number in (said.y, said.z))
    finite("the NIS", [number for number in (said.x, fits, weight) if number is not None])
    return Nis(said.x, fits, weight)


def _nis_to_message(nis: Nis, header: Header) -> Vector3Stamped:
    finite("the NIS", [number for number in nis if number is not None])
    x, y, z = (math.nan if number is None else float(number) for number in nis)
    return Vector3Stamped(header=header, vector=Vector3(x=x, y=y, z=z))


_UNSTAMPED = Conversion(Twist, read_twist, _command_to_message, False)

register(Command, TwistStamped, lambda message: read_twist(message.twist), _command_to_stamped)
register(Pose, PoseStamped, lambda message: read_pose(message.pose), _pose_to_message, in_world=True)
register(State, Odometry, _state_of, _state_to_message, in_world=True)
register(values.Odometry, Odometry, _odometry_of, _odometry_to_message, in_world=True)
register(Estimate, Odometry, _estimate_of, _estimate_to_message, in_world=True)
register(Fix, PoseWithCovarianceStamped, _fix_of, _fix_to_message, in_world=True)
register(InitialPose, PoseWithCovarianceStamped, _initial_pose_of, _fix_to_message, in_world=True)
register(Located, PoseWithCovarianceStamped, unread, _located_to_message, in_world=True)
register(Nis, Vector3Stamped, _nis_of, _nis_to_message)
register(
    Disagreement,
    String,
    lambda message: Disagreement(message.data),
    lambda disagreement, header: String(data=disagreement.cause),
)
register(Resume, Empty, lambda message: Resume(), lambda resume, header: Empty())
