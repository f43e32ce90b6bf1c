"""The closed loop as ROS 2 nodes: any block with a ``step`` becomes a node, including the project's own five.

All are imported at first use. `Input`, `Output`, `Every`, `On` and `Block` do not depend on ROS. `register`, `Shell` and
`run` need rclpy, from a ROS installation or from the extra ``ros``.
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

_PLACES = {
    **dict.fromkeys(("Block", "Every", "Input", "On", "Output"), "node.block"),
    **{
        "Graph": "graph.graph",
        "register": "node.convert",
        "run": "node.shell",
        "Shell": "node.shell",
    },
}


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_PLACES[name]}"), name)
