"""The ``--help`` of a block's node: its topics and parameters as the block's class declares them, without making the node."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import fields
from importlib import import_module
from inspect import cleandoc
from typing import Any

from turtlebot_gym.rooms.scan import Scan
from turtlebot_gym_ros.base.explain import Topic, explain, parameters_of
from turtlebot_gym_ros.base.frames import Common
from turtlebot_gym_ros.base.names import type_name
from turtlebot_gym_ros.node.block import Correction, Every, Input, Output
from turtlebot_gym_ros.node.convert import CONVERSIONS, conversion
from turtlebot_gym_ros.node.navigate import NAME, NAVIGATOR, SendsGoals
from turtlebot_gym_ros.nodes import BLOCKS, GUARD, NODES, load

TF = "tf2_msgs/msg/TFMessage"
ORDER = ("subscribes", "publishes", "serves")


PROGRAM = "python -m turtlebot_gym_ros"


def explain_node(name: str) -> str:
    """Return the help of a node that takes ROS arguments, by its name."""
    if NODES[name].guards:
        return import_module(f"{GUARD}.help").help_of(name, PROGRAM)
    made = load(name)
    if name in BLOCKS:
        return explain_block(name, made)
    module = import_module(made.__module__)
    return explain(f"{PROGRAM} {name}", _first(module.__doc__), module.TOPICS, parameters_of(module.Parameters))


def explain_block(name: str, block: Any) -> str:
    """Return the help of a block's node.

    Args:
        name: Name of the node.
        block: Class of the block, whose inputs, outputs and trigger are class attributes.
    """
    trigger = block.trigger
    by_clock = isinstance(trigger, Every)
    runs = f"every {trigger.period:g} s" if by_clock else f"with each message on {block.inputs[trigger.input].topic}"
    summary = f"{_first(block.__doc__)} It steps {runs}."
    return explain(f"{PROGRAM} {name}", summary, topics_of(block), parameters_of(Common, block.Params))


def _first(docstring: str | None) -> str:
    """Return the first paragraph of a docstring."""
    return cleandoc(docstring or "").split("\n\n")[0]


def topics_of(block: Any) -> list[Topic]:
    """Return the topics and services of a block's node, but for those that only lock-step has."""
    found = [*_ends(block.inputs), *_ends(block.outputs)]
    for when, ends in getattr(block, "conditional", {}).items():
        found += _ends(ends, f"{when}: ")
    found += _of_shell(block)
    return sorted(found, key=lambda topic: ORDER.index(topic.verb))


def _ends(ends: Mapping[str, Input | Output], when: str = "") -> Iterator[Topic]:
    """Yield inputs or outputs as topics."""
    for end in ends.values():
        quality = "latched" if end.latched else "reliable" if end.reliable else "best effort"
        if isinstance(end, Input):
            kind = end.message or type_name(conversion(end.type).message)
            yield Topic("subscribes", end.topic, kind, quality, f"{when}{_freshness(end)}")
        elif end.type is Correction and Correction not in CONVERSIONS:
            yield Topic("publishes", end.topic, TF, quality, when.removesuffix(": "))
        else:
            stops = "zeros when it stops" if end.stop is not None else ""
            note = f"{when}{stops}".removesuffix(": ")
            yield Topic("publishes", end.topic, type_name(conversion(end.type).message), quality, note)


def _freshness(source: Input) -> str:
    """Return how a block takes an input."""
    age = "the last value holds" if source.max_age is None else f"at most {source.max_age:g} s old"
    return f"{'required' if source.required else 'optional'}, {'each value once' if source.once else age}"


def _of_shell(block: Any) -> Iterator[Topic]:
    """Yield what the shell adds to a block's inputs and outputs, see `Shell`."""
    is_plant = isinstance(block.trigger, Every) and block.trigger.speed is not None
    inputs = [*block.inputs.values(), *(end for ends in getattr(block, "conditional", {}).values() for end in ends.values())]
    if any(isinstance(end, Input) and end.type is Scan for end in inputs):
        yield Topic("subscribes", "/tf_static", TF, "latched", "where the LiDAR is")
    moves = any(output.stop is not None for output in block.outputs.values())
    if moves:
        yield Topic("subscribes", "emergency_stop", "std_msgs/msg/Bool", "reliable", "at 5 Hz or more; true is pressed")
        yield Topic("publishes", "~/state", "std_msgs/msg/String", "latched", "silent, active or stopping, and why")
    verb, note = ("publishes", "a new episode begins") if is_plant else ("subscribes", "the simulator begins a new episode")
    yield Topic(verb, "reset", "std_msgs/msg/Empty", "reliable", note)
    if any(isinstance(end, Input) and end.halts for end in inputs):
        yield Topic("publishes", "resume", "std_msgs/msg/Empty", "reliable", "enabled: the filter may go on")
    if is_plant:
        yield Topic("publishes", "/clock", "rosgraph_msgs/msg/Clock", "reliable", "with speed other than 1")
    if "publish_tf" in {item.name for item in fields(block.Params)} and not any(end.type is Correction for end in inputs):
        yield Topic("publishes", "/tf", TF, "reliable", "with publish_tf")
        if is_plant:
            yield Topic("publishes", "/tf_static", TF, "latched", "with publish_tf")
    yield Topic("publishes", "/diagnostics", "diagnostic_msgs/msg/DiagnosticArray", "reliable", "at 1 Hz: what it waits for")
    yield Topic("serves", "~/reset", "std_srvs/srv/Trigger", note="begin anew")
    if moves:
        yield Topic("serves", "~/enable", "std_srvs/srv/SetBool", note="let it move the robot, or not")
    for name in getattr(block, "service_names", ()):
        yield Topic("serves", name, "std_srvs/srv/Empty")
    if name := getattr(block, "nav2_name", ""):
        yield Topic("serves", f"{name}/get_state", "lifecycle_msgs/srv/GetState", note="active, for Nav2's clients")
    if issubclass(block, SendsGoals):
        yield Topic("serves", NAME, "nav2_msgs/action/NavigateToPose", note="the action, if nav2_msgs is installed")
        yield Topic("serves", f"{NAVIGATOR}/get_state", "lifecycle_msgs/srv/GetState", note="beside the action")
