"""Dataclasses as ROS parameters, which are checked once before anything is published and read-only from then on.

rclpy ignores a misspelled parameter and refuses ``rate:=100`` for a double; this module does the opposite.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import MISSING, fields
from typing import Any, get_type_hints

from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from turtlebot_gym.config import did_you_mean, rules
from turtlebot_gym.docstrings import texts_of

_ROS_OWN = ("use_sim_time", "start_type_description_service", "qos_overrides.")


def declare(node: Node, *kinds: type) -> tuple[Any, ...]:
    """Declare the fields of classes as read-only parameters of a node, and return the filled classes.

    So is ``use_sim_time`` from then on. Of fields of one name the later class's counts. The node was created with
    ``automatically_declare_parameters_from_overrides=True``. `ValueError` says in one line what of the given is refused.
    """
    declared = {item.name: item for kind in kinds for item in fields(kind)}
    types = {name: hint for kind in kinds for name, hint in get_type_hints(kind).items()}
    texts = {name: text for kind in kinds for name, text in texts_of(kind).items()}
    constraints = {name: rule for kind in kinds for name, rule in rules(kind).items()}
    given: dict[str, Any] = dict(node.get_parameters_by_prefix(""))
    values = {
        name: item.default if item.default_factory is MISSING else item.default_factory() for name, item in declared.items()
    }
    for name, parameter in given.items():
        if name in values:
            values[name] = _converted(name, parameter.value, types[name])
        elif not name.startswith(_ROS_OWN):
            hint = did_you_mean(name, values) or f" There are {', '.join(sorted(values))}."
            raise ValueError(f"{node.get_name()} has no parameter {name!r}.{hint}")
    made = tuple(kind(**{item.name: values[item.name] for item in fields(kind)}) for kind in kinds)
    for name, value in values.items():
        if name in given:
            node.undeclare_parameter(name)
        descriptor = ParameterDescriptor(read_only=True, description=texts.get(name, ""))
        descriptor.additional_constraints = str(constraints.get(name, ""))
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
