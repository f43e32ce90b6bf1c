"""Checked parameters and a clean shutdown for nodes outside of the shell, with rclpy only.

The guard and the logger must not share faults with the nodes they watch.
"""

from __future__ import annotations

import ast
import inspect
import signal
import sys
import threading
from collections.abc import Callable, Sequence
from dataclasses import Field, fields
from itertools import pairwise
from textwrap import dedent
from typing import Any, TypeVar

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.context import Context
from rclpy.exceptions import ParameterException
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.utilities import remove_ros_args

from turtlebot_gym_ros.node.discovery import leave

P = TypeVar("P")


def described(params: type) -> dict[str, str]:
    """Return the docstring under each field of a class, on one line; empty if the source is not available."""
    try:
        (made,) = ast.parse(dedent(inspect.getsource(params))).body
    except (OSError, TypeError, SyntaxError):  # TypeError: of a module without a file
        return {}
    assert isinstance(made, ast.ClassDef)
    return {
        item.target.id: " ".join(text.value.value.split())
        for item, text in pairwise(made.body)
        if isinstance(item, ast.AnnAssign) and isinstance(item.target, ast.Name)
        if isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant) and isinstance(text.value.value, str)
    }


def descriptor_of(each: Field[Any], description: str) -> ParameterDescriptor:
    """Return the description of a parameter for ``ros2 param describe``."""
    descriptor = ParameterDescriptor(read_only=True, description=description)
    descriptor.additional_constraints = str(each.metadata.get("rule", ""))
    if "range" in each.metadata:
        low, high = each.metadata["range"]
        if isinstance(each.default, int):
            descriptor.integer_range = [IntegerRange(from_value=low, to_value=high)]
        else:
            descriptor.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
    return descriptor


def declare_one(node: Node, name: str, value: Any, descriptor: ParameterDescriptor) -> None:
    """Declare a parameter that was checked; refuse what only its range forbids.

    Raises:
        ValueError: With one line that names the parameter, the rule and the value.
    """
    try:
        node.declare_parameter(name, value, descriptor, ignore_override=True)
    except ParameterException as error:
        spans = [*descriptor.floating_point_range, *descriptor.integer_range]
        span = "".join(f"from {one.from_value:g} to {one.to_value:g}" for one in spans)
        raise ValueError(f"{name} must be {descriptor.additional_constraints or span}, got {value!r}.") from error


def declare(node: Node, params: type[P]) -> P:
    """Read a node's parameters and make them read-only; refuse unknown names, wrong types and wrong values.

    rclpy by itself ignores a misspelled name and refuses an integer for a float.

    Args:
        node: A node made with ``automatically_declare_parameters_from_overrides=True``.
        params: Dataclass whose fields name the parameters; its defaults give the types, the docstrings under its fields the
            descriptions, and the fields' metadata, if given, ``range`` and ``rule``.

    Raises:
        ValueError: With one line that names the parameter, the rule and the value.
    """
    known = {field.name: field.default for field in fields(params)}  # type: ignore[arg-type]
    given = {
        name: node.get_parameter(name).value
        for name in node.list_parameters([], 0).names
        if name not in ("use_sim_time", "start_type_description_service") and not name.startswith("qos_overrides.")
    }
    for name, value in given.items():
        if name not in known:
            raise ValueError(f"unknown parameter {name!r}; there are {', '.join(known)}")
        default = known[name]
        if isinstance(default, float) and type(value) is int:
            given[name] = value = float(value)
        if type(value) is not type(default):
            raise ValueError(f"parameter {name!r} must be of type {type(default).__name__}, got {value!r}")
    parameters, descriptions = params(**given), described(params)
    for each in fields(params):  # type: ignore[arg-type]
        name = each.name
        if name in given:
            node.undeclare_parameter(name)
        declare_one(node, name, getattr(parameters, name), descriptor_of(each, descriptions.get(name, "")))
    return parameters


def run(make: Callable[[Context], Any], argv: Sequence[str] | None = None) -> int:
    """Run a node until SIGINT or SIGTERM, then close it.

    rclpy's own handlers would invalidate the context before the last messages are out.

    Args:
        make: Function that makes the node in a context; a ValueError or OSError refuses the arguments.
        argv: Arguments; by default those of the process.

    Returns:
        2 if the arguments are refused. Otherwise the process ends with code 0.
    """
    stop, context = threading.Event(), Context()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    try:
        argv = list(sys.argv[1:] if argv is None else argv)
        context.init(argv)
        if rest := remove_ros_args(argv):
            raise ValueError(f"unknown argument {rest[0]!r}; parameters are given as --ros-args -p NAME:=VALUE")
        node = make(context)
    except (ValueError, RuntimeError, OSError) as error:
        print(f"error: {' '.join(str(error).split())}", file=sys.stderr)
        context.try_shutdown()
        return 2
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    try:
        while not stop.is_set():
            executor.spin_once(timeout_sec=0.1)
    finally:
        node.close()
    return leave(context, node.destroy_node)
