"""Values and messages: what a block computes with, and what goes over a topic.

World frames are checked by the shell; a value that is not finite or a quaternion that is no rotation is refused here, with
a ``ValueError`` that says why, in both directions.

`Senses`, what a robot knows of its own motion, travel on ``/odom``. Where the pose did not arrive in this step, the message
repeats the last one and says so by ``pose.covariance[0] = -1``, the convention of ``sensor_msgs/Imu`` for what is not known.
The twist is valid in either case. A robot's own odometry, with zeros or variances in the covariance, counts as measured.

A `Fix` states its variances; -1 for the heading's says that it was not measured. Terms off the diagonal are not used.

Headings survive their quaternion to the bit, see `quaternion_of`.

Covariances are row-major 6 x 6, in the order x y z roll pitch yaw. What a planar robot does not know, height, roll, pitch and
the sideways speed, has the variance -1 there, by the same convention; RViz then draws an ellipse instead of an ellipsoid. An
`Odometry` message has no place for the normalized innovation squared, which a policy observes: it has a topic of its own, see
`innovation`. What is read from the message of an estimate has the value 0 for it.

The resolution of a map travels in single precision, and is read as the shortest decimal that is nearest to it: 0.05 m.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Callable, Iterable, Iterator
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, Quaternion, Twist, TwistStamped
from nav_msgs.msg import OccupancyGrid, Odometry
from sensor_msgs.msg import LaserScan, Range
from std_msgs.msg import Header
from visualization_msgs.msg import MarkerArray

from turtlebot_gym.estimation.ekf import Estimate
from turtlebot_gym.rooms.grid import GridMap
from turtlebot_gym.rooms.scan import Clearance, Obstacles, Scan
from turtlebot_gym.values import Belief, Command, Covariance, Fix, Pose, Senses, State
from turtlebot_gym_ros.node.innovation import read_nis, write_nis
from turtlebot_gym_ros.node.obstacles import read_obstacles, write_obstacles
from turtlebot_gym_ros.node.scans import read_clearance, read_scan, write_clearance, write_scan
from turtlebot_gym_ros.node.values import Nis

# The diagonal places in the order x y z roll pitch yaw, row-major: what a planar robot knows, and what it does not.
_PLANAR_POSE, _UNUSED_IN_POSE, _UNUSED_IN_TWIST = (0, 7, 35), (14, 21, 28), (7, 14, 21, 28)
_NUDGES = (0, 1, -1, 2, -2, 3, -3, 4, -4)
_PAIRS = sorted(product(range(len(_NUDGES)), repeat=2), key=sum)
_NOT_KNOWN = -1.0


class Conversion(NamedTuple):
    """How a type of value travels."""

    message: type
    """Its message type."""
    read: Callable[[Any], Any]
    """``read(message)`` returns the value."""
    write: Callable[[Any, Header], Any]
    """``write(value, header)`` returns the message."""
    in_world: bool
    """Whether it is stated in the world frame, which the header must then name."""


CONVERSIONS: dict[type, Conversion] = {}


def register(
    value_type: type,
    message_type: type,
    read: Callable[[Any], Any],
    write: Callable[[Any, Header], Any],
    *,
    in_world: bool = False,
) -> None:
    """Teach the shell how a type of value travels.

    Args:
        value_type: What blocks take and return.
        message_type: What goes over a topic.
        read: ``read(message)`` returns the value, or raises ``ValueError`` where the message is refused.
        write: ``write(value, header)`` returns the message, or raises ``ValueError``.
        in_world: Whether the header must name the world frame.
    """
    CONVERSIONS[value_type] = Conversion(message_type, read, write, in_world)


def conversion(value_type: type, *, stamped: bool = True) -> Conversion:
    """Return how a type of value travels.

    Args:
        value_type: What blocks take and return.
        stamped: Whether a `Command` travels as TwistStamped, as on a Jazzy robot, or as Twist.

    Raises:
        ValueError: If the type was never registered.
    """
    if value_type is Command and not stamped:
        return _UNSTAMPED
    if value_type not in CONVERSIONS:
        raise ValueError(f"No message is known for values of type {value_type.__name__}: call register(...) first.")
    return CONVERSIONS[value_type]


def yaw_of(q: Quaternion) -> float:
    """Return the heading of a rotation, rad, in [-pi, pi).

    Raises:
        ValueError: If the quaternion is no rotation: its norm is not 1 within 1 %.
    """
    norm = math.sqrt(q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w)
    if not abs(norm - 1.0) < 0.01:  # also refuses NaN
        raise ValueError(f"the quaternion ({q.x}, {q.y}, {q.z}, {q.w}) has norm {norm:.3g} instead of 1")
    if q.x == q.y == 0.0:
        return _planar_yaw(q.z, q.w)
    yaw = math.atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y * q.y + q.z * q.z))
    return -math.pi if yaw >= math.pi else yaw


def _planar_yaw(z: float, w: float) -> float:
    """Return the heading of a rotation about the vertical axis, rad, in [-pi, pi)."""
    yaw = 2.0 * (math.atan2(z, w) if w >= 0.0 else math.atan2(-z, -w))  # q and -q are the same rotation
    return -math.pi if yaw >= math.pi else yaw


def quaternion_of(yaw: float) -> Quaternion:
    """Return the rotation about the vertical axis by a heading, rad.

    Sine and cosine round; where that would change the heading, both are moved by a few units in the last place until `yaw_of`
    gives back the very same number. So a heading in [-pi, pi) is the same float at the other end of a topic.
    """
    z, w = math.sin(0.5 * yaw), math.cos(0.5 * yaw)
    if _planar_yaw(z, w) != yaw and -math.pi <= yaw < math.pi:
        z, w = next(((a, b) for a, b in _neighbours(z, w) if _planar_yaw(a, b) == yaw), (z, w))
    return Quaternion(x=0.0, y=0.0, z=z, w=w)


def _neighbours(z: float, w: float) -> Iterator[tuple[float, float]]:
    """Yield the pairs of numbers close to a pair, the nearest first."""
    near_z, near_w = ([value + k * math.ulp(value) for k in _NUDGES] for value in (z, w))
    return ((near_z[i], near_w[j]) for i, j in _PAIRS)


def _finite(what: str, numbers: Iterable[float]) -> None:
    values = tuple(numbers)
    if not all(map(math.isfinite, values)):
        raise ValueError(f"{what} must be finite, got {', '.join(f'{value:g}' for value in values)}")


def _read_pose(message: Any) -> Pose:
    pose = Pose(message.position.x, message.position.y, yaw_of(message.orientation))
    _finite("the pose", pose)
    return pose


def _write_pose(message: Any, pose: Iterable[float]) -> None:
    x, y, theta = pose
    _finite("the pose", (x, y, theta))
    message.position.x, message.position.y, message.orientation = float(x), float(y), quaternion_of(theta)


def _read_twist(message: Twist) -> Command:
    command = Command(message.linear.x, message.angular.z)
    _finite("the twist", command)
    return command


def _write_twist(message: Twist, v: float, omega: float) -> None:
    _finite("the twist", (v, omega))
    message.linear.x, message.angular.z = float(v), float(omega)


def _pose_to_message(pose: Pose, header: Header) -> PoseStamped:
    message = PoseStamped(header=header)
    _write_pose(message.pose, pose)
    return message


def _state_of(message: Odometry) -> State:
    return State(*_read_pose(message.pose.pose), *_read_twist(message.twist.twist))


def _state_to_message(state: State, header: Header) -> Odometry:
    message = Odometry(header=header)
    _write_pose(message.pose.pose, state[:3])
    _write_twist(message.twist.twist, state.v, state.omega)
    return message


def _senses_of(message: Odometry) -> Senses:
    measured = float(message.pose.covariance[0]) >= 0.0
    return Senses(_read_pose(message.pose.pose), _read_twist(message.twist.twist), measured)


def _senses_to_message(senses: Senses, header: Header) -> Odometry:
    message = _state_to_message(State(*senses.odometry, *senses.twist), header)
    if not senses.measured:
        message.pose.covariance[0] = _NOT_KNOWN
    return message


def _estimate_of(message: Odometry) -> Estimate:
    pose, twist = message.pose.covariance.tolist(), message.twist.covariance.tolist()  # floats are faster than NumPy's
    _finite("the covariance", (*pose, *twist))
    P = Covariance(
        pose[0], pose[1], pose[5], 0.0, 0.0, pose[7], pose[11], 0.0, 0.0, pose[35], 0.0, 0.0, twist[0], twist[5], twist[35]
    )
    if min(P.xx, P.yy, P.tt, P.vv, P.ww) < 0.0:
        raise ValueError(f"variances must not be negative, got {P.xx:g}, {P.yy:g}, {P.tt:g}, {P.vv:g}, {P.ww:g}")
    return Estimate(Belief(_state_of(message), P), 0.0, 0.0)


def state_covariance(message: Odometry, P: Covariance) -> None:
    """Write a covariance where ROS looks for it; the message holds that of the pose and that of the twist.

    A message that says its pose was not measured keeps saying so.

    Raises:
        ValueError: If it is not finite.
    """
    _finite("the covariance", P)
    pose, twist = message.pose.covariance, message.twist.covariance
    measured = pose[0] >= 0.0
    pose[0], pose[7], pose[35] = P.xx, P.yy, P.tt
    pose[1] = pose[6] = P.xy
    pose[5] = pose[30] = P.xt
    pose[11] = pose[31] = P.yt
    twist[0], twist[35] = P.vv, P.ww
    twist[5] = twist[30] = P.vw
    if not measured:
        pose[:] = 0.0
    for at in _UNUSED_IN_POSE if measured else (*_PLANAR_POSE, *_UNUSED_IN_POSE):
        pose[at] = _NOT_KNOWN
    for at in _UNUSED_IN_TWIST:
        twist[at] = _NOT_KNOWN


def _estimate_to_message(estimate: Estimate, header: Header) -> Odometry:
    mean, P = estimate.belief
    message = _state_to_message(mean, header)
    state_covariance(message, P)
    return message


def _fix_of(message: PoseWithCovarianceStamped) -> Fix:
    covariance = message.pose.covariance
    x, y, heading = (float(covariance[at]) for at in (0, 7, 35))
    if not (0.0 < x < math.inf and 0.0 < y < math.inf):
        raise ValueError(f"a fix must state positive variances of x and y, got {x:g} and {y:g}")
    if heading == 0.0 or math.isnan(heading):
        raise ValueError(f"a fix must state the heading's variance, or -1 where it was not measured, got {heading:g}")
    measured, position = heading > 0.0, message.pose.pose.position
    pose = _read_pose(message.pose.pose) if measured else Pose(position.x, position.y, 0.0)
    _finite("the pose", pose)
    return Fix(pose, (x, y, heading if measured else math.inf), 0.0, True)


def _fix_to_message(fix: Fix, header: Header) -> PoseWithCovarianceStamped:
    message = PoseWithCovarianceStamped(header=header)
    _write_pose(message.pose.pose, fix.pose)
    covariance, (x, y, heading) = message.pose.covariance, fix.R
    covariance[0], covariance[7], covariance[35] = x, y, heading if heading < math.inf else _NOT_KNOWN
    return message


def _command_to_stamped(command: Command, header: Header) -> TwistStamped:
    message = TwistStamped(header=header)
    _write_twist(message.twist, *command)
    return message


def _command_to_message(command: Command, header: Header) -> Twist:
    message = Twist()
    _write_twist(message, *command)
    return message


def _grid_of(message: OccupancyGrid) -> GridMap:
    info = message.info
    if len(message.data) != info.height * info.width:
        raise ValueError(f"the map has {len(message.data)} cells, but {info.height} rows of {info.width}")
    cells = np.array(message.data, np.int8).reshape(info.height, info.width)
    return GridMap(cells=cells, resolution=float(str(np.float32(info.resolution))), origin=_read_pose(info.origin))


def _grid_to_message(grid: GridMap, header: Header) -> OccupancyGrid:
    message = OccupancyGrid(header=header, data=array("b", grid.cells.tobytes()))
    info = message.info
    info.map_load_time, info.resolution = header.stamp, float(grid.resolution)
    info.height, info.width = grid.cells.shape
    _write_pose(info.origin, grid.origin)
    return message


_UNSTAMPED = Conversion(Twist, _read_twist, _command_to_message, False)

register(Command, TwistStamped, lambda message: _read_twist(message.twist), _command_to_stamped)
register(Pose, PoseStamped, lambda message: _read_pose(message.pose), _pose_to_message, in_world=True)
register(State, Odometry, _state_of, _state_to_message, in_world=True)
register(Senses, Odometry, _senses_of, _senses_to_message, in_world=True)
register(Estimate, Odometry, _estimate_of, _estimate_to_message, in_world=True)
register(
    Belief,
    Odometry,
    lambda message: _estimate_of(message).belief,
    lambda belief, header: _estimate_to_message(Estimate(belief, 0.0, 0.0), header),
    in_world=True,
)
register(Fix, PoseWithCovarianceStamped, _fix_of, _fix_to_message, in_world=True)
register(Nis, DiagnosticArray, read_nis, write_nis)
register(Scan, LaserScan, read_scan, write_scan)
register(Obstacles, MarkerArray, read_obstacles, write_obstacles, in_world=True)
register(Clearance, Range, read_clearance, write_clearance)
register(GridMap, OccupancyGrid, _grid_of, _grid_to_message, in_world=True)
