"""Dataclasses as ROS parameters, which are checked once before anything is published and read-only from then on.

rclpy ignores a misspelled parameter and refuses ``rate:=10`` for a double; this module does the opposite.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import MISSING, Field, fields
from difflib import get_close_matches
from typing import Any, get_type_hints

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.exceptions import ParameterException
from rclpy.node import Node
from rclpy.parameter import Parameter

from turtlebot_gym.config import Range, Rule, rules
from turtlebot_gym_ros.base.explain import descriptions

_ROS_OWN = ("use_sim_time", "start_type_description_service", "qos_overrides.")


def declare(node: Node, *params: type) -> tuple[Any, ...]:
    """Declare the fields of parameter classes as read-only parameters of a node, and return the filled classes.

    From then on ``use_sim_time`` is read-only, too: what uses the clock was made for it.

    Args:
        node: A node that was created with ``automatically_declare_parameters_from_overrides=True``.
        *params: Dataclasses with defaults for all fields, whose docstrings are the descriptions; their rules of
            `turtlebot_gym.config` are shown. If two share a name, the later one counts.

    Raises:
        ValueError: With one line, if a given parameter does not exist, has the wrong type, or is refused by its class.
    """
    declared = {item.name: item for owner in params for item in fields(owner)}
    kinds = {name: kind for owner in params for name, kind in get_type_hints(owner).items()}
    texts = {name: text for owner in params for name, text in descriptions(owner).items()}
    constraints = {name: rule for owner in params for name, rule in rules(owner).items()}
    given: dict[str, Any] = dict(node.get_parameters_by_prefix(""))
    for name in given:
        if name not in declared and not name.startswith(_ROS_OWN):
            close = get_close_matches(name, declared, n=1)
            hint = f"did you mean {close[0]}?" if close else f"there are {', '.join(sorted(declared))}."
            raise ValueError(f"{node.get_name()} has no parameter {name!r}: {hint}")
    values = {
        name: _converted(name, given[name].value, kinds[name]) if name in given else _default(item)
        for name, item in declared.items()
    }
    made = tuple(owner(**{item.name: values[item.name] for item in fields(owner)}) for owner in params)
    for name in declared:
        if name in given:
            node.undeclare_parameter(name)
        descriptor = _descriptor(constraints.get(name), texts.get(name, ""))
        try:
            node.declare_parameter(name, values[name], descriptor, ignore_override=True)
        except ParameterException as error:  # what only the range refuses
            raise ValueError(f"{name} must be {descriptor.additional_constraints}, got {values[name]!r}.") from error
    reason = "use_sim_time is read when the node starts: start it anew with the new value."
    clock = node.get_parameter("use_sim_time").value

    def refuse(parameters: Sequence[Parameter]) -> SetParametersResult:
        changes = any(parameter.name == "use_sim_time" and parameter.value != clock for parameter in parameters)
        return SetParametersResult(successful=not changes, reason=reason if changes else "")

    node.add_on_set_parameters_callback(refuse)
    return made


def words_of(parameters: Mapping[str, Any]) -> list[str]:
    """Return parameters as words of the ROS command line."""
    texts = {name: str(value).lower() if isinstance(value, bool) else value for name, value in parameters.items()}
    return [word for name, text in texts.items() for word in ("-p", f"{name}:={text}")]


def _default(item: Field[Any]) -> Any:
    return item.default if item.default_factory is MISSING else item.default_factory()


def _converted(name: str, value: Any, kind: type) -> Any:
    """Return a parameter's value in its type; integers are accepted as floats."""
    if kind is float and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if type(value) is not kind:
        raise ValueError(f"{name} must be of type {kind.__name__}, got {value!r} ({type(value).__name__}).")
    return value


def _descriptor(rule: Rule | None, description: str) -> ParameterDescriptor:
    """Return the description of a parameter for ``ros2 param describe``."""
    descriptor = ParameterDescriptor(read_only=True, description=description)
    descriptor.additional_constraints = "" if rule is None else str(rule)
    if isinstance(rule, Range) and rule.whole:
        descriptor.integer_range = [IntegerRange(from_value=rule.low, to_value=rule.high)]
    elif isinstance(rule, Range):
        descriptor.floating_point_range = [FloatingPointRange(from_value=rule.low, to_value=rule.high)]
    return descriptor
