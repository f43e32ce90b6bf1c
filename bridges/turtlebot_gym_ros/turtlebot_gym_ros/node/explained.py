"""The ``--help`` of a node, without making the node."""

from __future__ import annotations

from importlib import import_module

from cmd_vel_guard.explain import explain, parameters_of
from turtlebot_gym_ros.base.frames import Common
from turtlebot_gym_ros.nodes import BLOCKS, load


def explain_node(name: str) -> str:
    """Return the help of a node that takes ROS arguments, by its name."""
    made, program = load(name), f"python -m turtlebot_gym_ros {name}"
    if name in BLOCKS:
        return explain(program, made.__doc__, parameters_of(Common, made.Params))
    module = import_module(made.__module__)
    return explain(program, module.__doc__, parameters_of(module.Parameters))
