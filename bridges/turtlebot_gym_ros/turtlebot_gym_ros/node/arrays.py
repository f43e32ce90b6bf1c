"""Messages as arrays of their numbers, in the order of their fields, as pykal's ``ROSNode`` passes them to callbacks.

A stamp is one number, the seconds; 0 is sent as the present. Covariances and names of frames are left out. `register_array`
adds a type.

References:
    pykal, ``src/pykal/ros/ros2py_py2ros.py``, the tables ``ROS2PY_DEFAULT`` and ``PY2ROS_DEFAULT``:
    https://github.com/nehalsinghmangat/pykal
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from std_msgs.msg import Header

from turtlebot_gym.config import did_you_mean, refusal
from turtlebot_gym_ros.base.names import type_name
from turtlebot_gym_ros.node.convert import register

_XYZ = ("x", "y", "z")
_VECTORS = {"orientation": (*_XYZ, "w"), "rotation": (*_XYZ, "w")}
ARRAYS: dict[str, tuple[str, ...]] = {
    "geometry_msgs/msg/Pose": ("position", "orientation"),
    "geometry_msgs/msg/PoseStamped": ("header.stamp", "pose.position", "pose.orientation"),
    "geometry_msgs/msg/TransformStamped": ("header.stamp", "transform.translation", "transform.rotation"),
    "geometry_msgs/msg/Twist": ("linear", "angular"),
    "geometry_msgs/msg/TwistStamped": ("header.stamp", "twist.linear", "twist.angular"),
    "geometry_msgs/msg/Vector3Stamped": ("header.stamp", "vector"),
    "geometry_msgs/msg/Wrench": ("force", "torque"),
    "geometry_msgs/msg/Accel": ("linear", "angular"),
    "geometry_msgs/msg/AccelStamped": ("header.stamp", "accel.linear", "accel.angular"),
    "nav_msgs/msg/Odometry": ("pose.pose.position", "pose.pose.orientation", "twist.twist.linear", "twist.twist.angular"),
    "sensor_msgs/msg/Imu": ("orientation", "angular_velocity", "linear_acceleration"),
    "std_msgs/msg/Float64": (".data",),
    "std_msgs/msg/Float64MultiArray": ("[data]",),
    "std_msgs/msg/Int32MultiArray": ("[data]",),
    "std_msgs/msg/UInt8MultiArray": ("[data]",),
    "turtlesim/msg/Pose": (".x", ".y", ".theta"),
}
"""The fields of each type: a vector, a quaternion or a stamp; after a dot one number; in brackets a sequence of any length."""


def register_array(message_type: type, fields: Sequence[str]) -> None:
    """Add a message type to `ARRAYS`; see there for its fields."""
    ARRAYS[type_name(message_type)] = tuple(fields)
    value_of.cache_clear()


def fields_of(message_type: type) -> tuple[str, ...]:
    """Return the fields of a message type.

    Raises:
        ValueError: If it is not known, or no message type.
    """
    try:
        name = type_name(message_type)
    except (AttributeError, ValueError):
        raise refusal("a message type", "a class of messages, such as geometry_msgs.msg.Twist", message_type) from None
    if name not in ARRAYS:
        known = ", ".join(one.rpartition("/")[2] for one in ARRAYS)
        raise ValueError(
            f"There is no array for {name}: there are {known}; add it by "
            f"turtlebot_gym_ros.node.arrays.register_array.{did_you_mean(name, ARRAYS)}"
        )
    return ARRAYS[name]


def read_array(message: Any, fields: Sequence[str]) -> NDArray[np.float64]:
    """Return the numbers of a message's fields."""
    numbers: list[float] = []
    for field in fields:
        if field.startswith("["):
            return np.asarray(getattr(message, field[1:-1]), np.float64)
        part = _part(message, field)
        numbers += [part] if field.startswith(".") else _numbers(part, field)
    return np.array(numbers, np.float64)


def _part(message: Any, field: str) -> Any:
    for name in field.removeprefix(".").split("."):
        message = getattr(message, name)
    return message


def _numbers(part: Any, field: str) -> list[float]:
    """Return the numbers of a vector, a quaternion or a stamp."""
    name = field.rpartition(".")[2]
    if name == "stamp":
        return [part.sec + 1e-9 * part.nanosec]
    return [getattr(part, axis) for axis in _VECTORS.get(name, _XYZ)]


def write_array(numbers: NDArray[np.float64], message: Any, fields: Sequence[str]) -> Any:
    """Write numbers, as `checked` returns them, into a message's fields, and return it."""
    left = iter(numbers.tolist())
    for field in fields:
        if field.startswith("["):
            whole = "Float" not in type(message).__name__
            setattr(message, field[1:-1], [round(one) if whole else one for one in left])
        elif field.startswith("."):
            setattr(message, field[1:], next(left))
        elif field.endswith("stamp"):
            seconds = next(left)
            if seconds != 0.0:
                message.header.stamp.sec = math.floor(seconds)
                message.header.stamp.nanosec = min(round((seconds - math.floor(seconds)) * 1e9), 999_999_999)
        else:
            part = _part(message, field)
            for axis in _VECTORS.get(field.rpartition(".")[2], _XYZ):
                setattr(part, axis, next(left))
    return message


def size_of(fields: Sequence[str]) -> int | None:
    """Return the number of numbers of some fields; None for any."""
    if any(field.startswith("[") for field in fields):
        return None
    sizes = {"stamp": 1, **{name: len(axes) for name, axes in _VECTORS.items()}}
    return sum(1 if field.startswith(".") else sizes.get(field.rpartition(".")[2], 3) for field in fields)


def checked(name: str, given: ArrayLike, fields: Sequence[str]) -> NDArray[np.float64]:
    """Return numbers for some fields as a flat array.

    Raises:
        ValueError: If they are not as many, or not finite.
    """
    numbers, size = np.asarray(given, np.float64).ravel(), size_of(fields)
    if size not in (None, len(numbers)) or not np.isfinite(numbers).all():
        raise refusal(name, f"{'' if size is None else f'{size} '}finite numbers", given)
    return numbers


@cache
def value_of(message_type: type) -> type:
    """Return the type of value that a block returns for a message type: its array."""
    fields = fields_of(message_type)

    def write(numbers: NDArray[np.float64], header: Header) -> Any:
        message = message_type(header=header) if hasattr(message_type, "header") else message_type()
        return write_array(numbers, message, fields)

    value_type = type(f"{message_type.__name__}Array", (np.ndarray,), {})
    in_world = not type_name(message_type).startswith("sensor_msgs/")
    register(value_type, message_type, lambda message: read_array(message, fields), write, in_world=in_world)
    return value_type
