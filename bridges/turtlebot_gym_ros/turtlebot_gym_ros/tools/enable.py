"""``enable``: enable nodes, or disable them."""

from __future__ import annotations

from typing import Any

from rclpy.node import Node
from std_srvs.srv import SetBool

from turtlebot_gym_ros.base.names import absolute
from turtlebot_gym_ros.tools.asking import answered, asking, parser_of, remark_if_alone, result_of, settle, until

ENABLE, KIND, GUARD = "/enable", "std_srvs/srv/SetBool", "/cmd_vel_guard"
"""The service of nodes that can be enabled, its type, and the node that is enabled first."""


@answered
def enable(argv: Any = None) -> int:
    """Enable nodes in the given order, or disable them, by their services ``enable``."""
    parser = parser_of(
        "enable",
        "Enable nodes, one after the other: watch the robot. It may move from then on. Without a name, enable the guard, "
        "if there is one, and the node that drives.",
    )
    parser.add_argument("node", nargs="*", help="such as cmd_vel_guard velocity_controller")
    parser.add_argument("--off", action="store_true", help="disable instead")
    options = parser.parse_args(argv)
    with asking() as node:
        names = [absolute(name, "node") for name in options.node] or switches(node, options.wait)
        for name in names if options.node or not options.off else reversed(names):
            _switch(node, name, on=not options.off, seconds=options.wait)
    return 0


def _switch(node: Node, name: str, *, on: bool, seconds: float) -> None:
    """Enable or disable a node, and print what it says; raise an error if it does not answer, refuses, or there are several."""
    client = node.create_client(SetBool, f"{name}{ENABLE}")
    missing = f"there is no service {name}{ENABLE} after {seconds:g} s."
    until(lambda: client.service_is_ready() or None, seconds, lambda: missing + remark_if_alone(node))
    nodes = [f"{space.rstrip('/')}/{other}" for other, space in node.get_node_names_and_namespaces()]
    if nodes.count(name) > 1 and on:
        raise ValueError(f"{nodes.count(name)} nodes are called {name}, and one of them would be enabled: end the others.")
    response = result_of(client.call_async(SetBool.Request(data=on)), name, seconds)
    if not response.success:
        raise ValueError(f"{name}: {response.message}")
    print(f"{name}: {response.message or ('enabled' if on else 'disabled')}", flush=True)


def switches(node: Node, seconds: float) -> list[str]:
    """Return the nodes of the only robot that can be enabled, the guard first.

    Raises an error if there are none, several robots, or several nodes that drive.
    """

    def found() -> list[str] | None:
        services = node.get_service_names_and_types()
        return [name.removesuffix(ENABLE) for name, kinds in services if name.endswith(ENABLE) and kinds == [KIND]] or None

    until(found, seconds, lambda: f"no node can be enabled after {seconds:g} s.{remark_if_alone(node)}")
    settle(node, seconds)
    names = sorted(found() or [])
    guards = [name for name in names if name.endswith(GUARD)]
    drivers = [name for name in names if name not in guards]
    if len(guards) > 1 or len(drivers) > 1:
        raise ValueError(f"name the nodes to enable: {', '.join(names)} are more than one robot, or node that drives.")
    return guards + drivers
