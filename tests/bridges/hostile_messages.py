"""Messages as no sender should send them: any field of a type holds any value that its type can hold."""

import math
import re
from functools import cache
from importlib import import_module

from turtlebot_gym_ros.node.block import Tracks
from turtlebot_gym_ros.node.convert import conversion

LARGE = [1e5, 1e9, 3e9, 1e100, 1e154, 1e200, 1e308, 1.7976931348623157e308, math.inf]
SMALL = [0.0, 5e-324, 1e-320, 1e-170, 2.2e-308, 1e-30, 0.5, 1.0, 3.0, math.pi]
REALS = [sign * number for number in SMALL + LARGE for sign in (1.0, -1.0)] + [math.nan]
SINGLES = [1e-45, 3.4e38, -3.4e38, *(number for number in REALS if not 1e38 < abs(number) < math.inf)]
TEXTS = ("", "odom", "map", "base_link", "base_scan", "/", "nis", "nan", "-1e999", "\n\r\x07", "äöü€😀", "x" * 1000)


def _value(kind, chance):
    if kind in ("double", "float"):
        extremes = REALS if kind == "double" else SINGLES
        return chance.choice(extremes) if chance.random() < 0.8 else chance.uniform(-10.0, 10.0)
    if kind == "boolean":
        return chance.random() < 0.5
    if kind in ("octet", "byte"):
        return bytes([chance.randrange(256)])
    if kind == "string":
        return chance.choice(TEXTS) if chance.random() < 0.98 else "y" * 100_000
    bits = int(kind.strip("uint"))
    low, high = (0, 2**bits - 1) if kind.startswith("u") else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    return chance.choice((low, high, 0, 1, 2, 10, min(100, high), chance.randint(low, high)))


@cache
def _type(name):
    package, _, name = name.partition("/")
    return getattr(import_module(f"{package}.msg"), name)


def _any(kind, chance, most):
    sequence, array = re.fullmatch(r"sequence<(.+?)(?:, \d+)?>", kind), re.fullmatch(r"(.+)\[(\d+)\]", kind)
    if not (sequence or array):
        return anything(_type(kind), chance, most) if "/" in kind else _value(kind, chance)
    inner = (sequence or array)[1]
    number = int(array[2]) if array else chance.choice((0, 1, 2, 3, most if "/" not in inner else 4))
    if "/" not in inner and number > 10:  # a few values, many times
        few = [_value(inner, chance) for _ in range(5)]
        return [chance.choice(few) for _ in range(number)]
    return [_any(inner, chance, most if number < 5 else 0) for _ in range(number)]


def anything(message_type, chance, most=400):
    """Return a message of which every field is drawn."""
    fields = message_type.get_fields_and_field_types()
    return message_type(**{name: _any(kind, chance, most) for name, kind in fields.items()})


def spoil(message, chance):
    """Change one field of a message, at any depth."""
    fields = message.get_fields_and_field_types()
    if not fields:
        return
    name = chance.choice(sorted(fields))
    value = getattr(message, name)
    if hasattr(value, "get_fields_and_field_types"):
        spoil(value, chance)
    elif not isinstance(value, (str, bytes)) and hasattr(value, "__len__") and len(value) and chance.random() < 0.7:
        at = chance.randrange(len(value))
        if hasattr(value[at], "get_fields_and_field_types"):
            spoil(value[at], chance)
        else:
            value[at] = _value(re.match(r"(?:sequence<)?(\w+)", fields[name])[1], chance)
    else:
        setattr(message, name, _any(fields[name], chance, 400))


def hostile(example, chance):
    """Return a message that is drawn whole, or a healthy one, as ``example`` returns it, with one to three fields changed."""
    healthy = example()
    if chance.random() < 0.3:
        return anything(type(healthy), chance)
    for _ in range(chance.randint(1, 3)):
        spoil(healthy, chance)
    return healthy


def healthy(message_type):
    """Return a message as a robot sends it."""
    message = message_type()
    parts = [message]
    for part in parts:
        for name in part.get_fields_and_field_types():
            value = getattr(part, name)
            if name == "frame_id":
                part.frame_id = "odom"
            elif name == "orientation":
                value.w = 1.0
            elif name == "covariance":
                value[0] = value[7] = value[35] = 0.01
            elif hasattr(value, "get_fields_and_field_types"):
                parts.append(value)
    if message_type.__name__ == "LaserScan":
        message.angle_increment, message.range_min, message.range_max = 0.0174, 0.12, 3.5
        message.ranges = [1.0] * 360
    if message_type.__name__ == "PointCloud2":
        return conversion(Tracks).write(Tracks((0.5,) * 40), message.header)
    if message_type.__name__ == "OccupancyGrid":
        message.info.resolution, message.info.width, message.info.height, message.data = 0.05, 20, 20, [0] * 400
    return message
