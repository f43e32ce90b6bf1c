"""The closed loop as ROS 2 nodes: any block with a ``step`` becomes a node, including the project's own.

All are imported at first use. `Input`, `Output`, `Every`, `On` and `Block` do not depend on ROS. `register`, `Shell` and `run`
need rclpy, from a ROS installation or from the extra ``ros``.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from turtlebot_gym_ros.graph.graph import Graph
    from turtlebot_gym_ros.node.block import Block, Every, Input, On, Output
    from turtlebot_gym_ros.node.convert import register
    from turtlebot_gym_ros.node.shell import Shell, run

__all__ = ["Block", "Every", "Graph", "Input", "On", "Output", "Shell", "register", "run"]
_PLACES = {"Graph": "graph.graph", "register": "node.convert", "Shell": "node.shell", "run": "node.shell"}


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_PLACES.get(name, 'node.block')}"), name)
