"""Messages between odometry and command as the bytes that DDS carries, in CDR.

rclpy makes a Python object of each part of a message, fifteen for an Odometry, and to receive one and to send one takes it
longer than a filter's step. Here a message is a namespace with the same fields, and its bytes are those that rclpy would send.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from operator import attrgetter
from types import SimpleNamespace
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import Odometry
from rclpy.serialization import deserialize_message

from turtlebot_gym_ros.node.triggers import SECOND

_LITTLE = b"\0\1\0\0"
"""How the bytes of a message begin: little-endian CDR."""
_STAMP, _COUNT, _TWIST, _ODOMETRY = (struct.Struct(form) for form in ("<iI", "<I", "<6d", "<85d"))
_SPEEDS = attrgetter(*(f"{part}.{axis}" for part in ("linear", "angular") for axis in "xyz"))
_PLACE = attrgetter(*(f"position.{axis}" for axis in "xyz"), *(f"orientation.{axis}" for axis in "xyzw"))


def header(stamp: int, frame: str) -> Any:
    """Return a header with a stamp, ns."""
    seconds, nanoseconds = divmod(stamp, SECOND)
    return SimpleNamespace(stamp=SimpleNamespace(sec=seconds, nanosec=nanoseconds), frame_id=frame)


def blank(kind: type, head: Any) -> Any:
    """Return an Odometry or a TwistStamped with a header: a namespace if the header is one, else rclpy's message."""
    if not isinstance(head, SimpleNamespace):
        return kind(header=head)
    if kind is TwistStamped:
        return SimpleNamespace(header=head, twist=_twist((0.0,) * 6))
    return _odometry(head, "", (*(0.0,) * 6, 1.0, *(0.0,) * 78))


def _twist(numbers: Sequence[float]) -> SimpleNamespace:
    x, y, z, roll, pitch, yaw = numbers
    return SimpleNamespace(linear=SimpleNamespace(x=x, y=y, z=z), angular=SimpleNamespace(x=roll, y=pitch, z=yaw))


def _odometry(head: Any, child: str, numbers: Sequence[float]) -> SimpleNamespace:
    position, (x, y, z, w) = numbers[:3], numbers[3:7]
    pose = SimpleNamespace(
        position=SimpleNamespace(x=position[0], y=position[1], z=position[2]), orientation=SimpleNamespace(x=x, y=y, z=z, w=w)
    )
    return SimpleNamespace(
        header=head,
        child_frame_id=child,
        pose=SimpleNamespace(pose=pose, covariance=list(numbers[7:43])),
        twist=SimpleNamespace(twist=_twist(numbers[43:49]), covariance=list(numbers[49:])),
    )


class _Reader:
    """Reads the fields of a message one after the other; positions are aligned from the end of the first four bytes."""

    def __init__(self, data: bytes) -> None:
        self._data, self._at = data, len(_LITTLE)

    def numbers(self, form: struct.Struct, align: int) -> tuple[Any, ...]:
        at = self._at + (4 - self._at) % align
        self._at = at + form.size
        return form.unpack_from(self._data, at)

    def count(self) -> int:
        return self.numbers(_COUNT, 4)[0]

    def text(self) -> str:
        n = self.count()
        begin, self._at = self._at, self._at + n
        if self._at > len(self._data):
            raise struct.error("a text ends early")
        return self._data[begin : begin + max(0, n - 1)].decode(errors="replace")

    def byte(self) -> bytes:
        self._at += 1
        return self._data[self._at - 1 : self._at]

    def header(self) -> SimpleNamespace:
        seconds, nanoseconds = self.numbers(_STAMP, 4)
        return SimpleNamespace(stamp=SimpleNamespace(sec=seconds, nanosec=nanoseconds), frame_id=self.text())


def _read_diagnostics(data: _Reader) -> SimpleNamespace:
    head, status = data.header(), []
    for _ in range(data.count()):
        level, name, message, hardware = data.byte(), data.text(), data.text(), data.text()
        values = [SimpleNamespace(key=data.text(), value=data.text()) for _ in range(data.count())]
        status.append(SimpleNamespace(level=level, name=name, message=message, hardware_id=hardware, values=values))
    return SimpleNamespace(header=head, status=status)


def _aligned(data: bytes, align: int) -> bytes:
    return data + bytes((4 - len(data)) % align)


def _with_text(data: bytes, *texts: str) -> bytes:
    for text in texts:
        letters = text.encode() + b"\0"
        data = _aligned(data, 4) + _COUNT.pack(len(letters)) + letters
    return data


def _begin(head: Any) -> bytes:
    return _with_text(_LITTLE + _STAMP.pack(head.stamp.sec, head.stamp.nanosec), head.frame_id)


def _write_odometry(message: Any) -> bytes:
    pose, twist = message.pose, message.twist
    numbers = (*_PLACE(pose.pose), *pose.covariance, *_SPEEDS(twist.twist), *twist.covariance)
    return _aligned(_with_text(_begin(message.header), message.child_frame_id), 8) + _ODOMETRY.pack(*numbers)


def _write_diagnostics(message: Any) -> bytes:
    data = _aligned(_begin(message.header), 4) + _COUNT.pack(len(message.status))
    for status in message.status:
        data = _with_text(data + status.level, status.name, status.message, status.hardware_id)
        data = _aligned(data, 4) + _COUNT.pack(len(status.values))
        for pair in status.values:
            data = _with_text(data, pair.key, pair.value)
    return data


_READERS: dict[type, Callable[[_Reader], SimpleNamespace]] = {
    Odometry: lambda data: _odometry(data.header(), data.text(), data.numbers(_ODOMETRY, 8)),
    TwistStamped: lambda data: SimpleNamespace(header=data.header(), twist=_twist(data.numbers(_TWIST, 8))),
    DiagnosticArray: _read_diagnostics,
}
_WRITERS: dict[type, Callable[[Any], bytes]] = {
    Odometry: _write_odometry,
    TwistStamped: lambda message: _aligned(_begin(message.header), 8) + _TWIST.pack(*_SPEEDS(message.twist)),
    DiagnosticArray: _write_diagnostics,
}
KINDS = frozenset(_READERS)
"""The message types that are read and written here."""


def read(kind: type, data: bytes) -> Any:
    """Return the message of some bytes.

    Raises:
        ValueError: If they end too early.
    """
    try:
        if data[:2] != _LITTLE[:2]:  # another machine may send big-endian numbers
            return deserialize_message(data, kind)
        return _READERS[kind](_Reader(data))
    except (struct.error, RuntimeError) as error:  # the latter is rclpy's
        raise ValueError(f"its {len(data)} bytes are no {kind.__name__}: {error}") from None


def write(kind: type, message: Any) -> bytes:
    """Return the bytes of a namespace with the fields of a message."""
    return _WRITERS[kind](message)
