"""``enable``: enable nodes, or disable them."""

from __future__ import annotations

from typing import Any

from rclpy.node import Node
from std_srvs.srv import SetBool

from turtlebot_gym_ros.base.names import absolute
from turtlebot_gym_ros.tools.asking import answered, asking, parser_of, remark_if_alone, result_of, until


@answered
def enable(argv: Any = None) -> int:
    """Enable nodes in the given order, or disable them, by their services ``enable``."""
    parser = parser_of("enable", "Enable nodes, one after the other: watch the robot. It may move from then on.")
    parser.add_argument("node", nargs="+", help="such as cmd_vel_guard velocity_controller")
    parser.add_argument("--off", action="store_true", help="disable instead")
    options = parser.parse_args(argv)
    with asking() as node:
        for name in options.node:
            _switch(node, absolute(name, "node"), on=not options.off, seconds=options.wait)
    return 0


def _switch(node: Node, name: str, *, on: bool, seconds: float) -> None:
    """Enable or disable a node, and print what it says; raise an error if it does not answer, refuses, or there are several."""
    client = node.create_client(SetBool, f"{name}/enable")
    missing = f"there is no service {name}/enable after {seconds:g} s."
    until(lambda: client.service_is_ready() or None, seconds, lambda: missing + remark_if_alone(node))
    nodes = [f"{space.rstrip('/')}/{other}" for other, space in node.get_node_names_and_namespaces()]
    if nodes.count(name) > 1 and on:
        raise ValueError(f"{nodes.count(name)} nodes are called {name}, and one of them would be enabled: end the others.")
    response = result_of(client.call_async(SetBool.Request(data=on)), name, seconds)
    if not response.success:
        raise ValueError(f"{name}: {response.message}")
    print(f"{name}: {response.message or ('enabled' if on else 'disabled')}", flush=True)
