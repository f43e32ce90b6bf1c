"""A dataclass as ROS parameters, which are checked once before anything is published and read-only from then on.

rclpy ignores a misspelled parameter and refuses ``rate:=100`` for a double; this module does the opposite.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from difflib import get_close_matches
from typing import Any, TypeVar, get_type_hints

from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from cmd_vel_guard.checks import Range, rules
from cmd_vel_guard.explain import descriptions

T = TypeVar("T")
_ROS_OWN = ("use_sim_time", "start_type_description_service", "qos_overrides.")


def declare(node: Node, kind: type[T]) -> T:
    """Declare the fields of a class as read-only parameters of a node, and return the filled class.

    From then on ``use_sim_time`` is read-only, too: what uses the clock was made for it.

    Args:
        node: A node that was created with ``automatically_declare_parameters_from_overrides=True``.
        kind: A dataclass with defaults for all fields, whose docstrings are the descriptions.

    Raises:
        ValueError: With one line, if a given parameter does not exist, has the wrong type, or is refused by its class.
    """
    kinds, texts, constraints = get_type_hints(kind), descriptions(kind), rules(kind)
    values: dict[str, Any] = {item.name: item.default for item in fields(kind)}  # type: ignore[arg-type]
    given: dict[str, Any] = dict(node.get_parameters_by_prefix(""))
    for name, parameter in given.items():
        if name in values:
            values[name] = _converted(name, parameter.value, kinds[name])
        elif not name.startswith(_ROS_OWN):
            close = get_close_matches(name, values, n=1)
            hint = f"did you mean {close[0]}?" if close else f"there are {', '.join(sorted(values))}."
            raise ValueError(f"{node.get_name()} has no parameter {name!r}: {hint}")
    made = kind(**values)
    for name, value in values.items():
        if name in given:
            node.undeclare_parameter(name)
        rule = constraints.get(name)
        descriptor = ParameterDescriptor(read_only=True, description=texts.get(name, ""))
        descriptor.additional_constraints = "" if rule is None else str(rule)
        if isinstance(rule, Range) and not rule.infinite:
            descriptor.floating_point_range = [FloatingPointRange(from_value=rule.low, to_value=rule.high)]
        node.declare_parameter(name, value, descriptor, ignore_override=True)
    clock = node.get_parameter("use_sim_time").value

    def refuse(parameters: Sequence[Parameter]) -> SetParametersResult:
        changes = any(parameter.name == "use_sim_time" and parameter.value != clock for parameter in parameters)
        reason = "use_sim_time is read when the node starts: start it anew with the new value."
        return SetParametersResult(successful=not changes, reason=reason if changes else "")

    node.add_on_set_parameters_callback(refuse)
    return made


def _converted(name: str, value: Any, kind: type) -> Any:
    """Return a parameter's value in its type; integers are accepted as floats."""
    if kind is float and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if type(value) is not kind:
        raise ValueError(f"{name} must be of type {kind.__name__}, got {value!r} ({type(value).__name__}).")
    return value
