"""``enable``: services of the graph's nodes."""

from __future__ import annotations

from typing import Any

from rclpy.node import Node
from std_srvs.srv import SetBool

from turtlebot_gym_ros.base.names import absolute
from turtlebot_gym_ros.tools.asking import answered, asking, parser_of, remark_if_alone, result_of, settle, type_in, until

ENABLE, KIND, GUARD = "/enable", "std_srvs/srv/SetBool", "/cmd_vel_guard"
"""The service of nodes that can be enabled, its type, and the node that is enabled first."""


def _answer(node: Node, kind: Any, name: str, request: Any, seconds: float) -> Any:
    """Call a service, and return its response."""
    client = node.create_client(kind, name)
    until(
        lambda: client.service_is_ready() or None,
        seconds,
        lambda: (
            f"there is no service {name} after {seconds:g} s; `topics --services` lists what there is." + remark_if_alone(node)
        ),
    )
    return result_of(client.call_async(request), name, seconds)


@answered
def enable(argv: Any = None) -> int:
    """Enable nodes in the given order, or disable them, by their services ``enable``."""
    parser = parser_of(
        "enable",
        "Enable nodes, one after the other: watch the robot. It may move from then on. Without a name, enable the guard, "
        "if there is one, and the node that drives.",
        waits_for="each answer",
    )
    parser.add_argument("node", nargs="*", help="such as cmd_vel_guard velocity_controller")
    parser.add_argument("--off", action="store_true", help="disable instead")
    options = parser.parse_args(argv)
    with asking() as node:
        names = [absolute(name, "node") for name in options.node] or switches(node, options.wait)
        for name in names if options.node or not options.off else reversed(names):
            type_in(node, f"{name}{ENABLE}", "service", options.wait)
            if (count := _nodes(node).count(name)) > 1 and not options.off:
                raise ValueError(f"{count} nodes are called {name}, and one of them would be enabled: end the others.")
            request = SetBool.Request(data=not options.off)
            response = _answer(node, SetBool, f"{name}{ENABLE}", request, options.wait)
            print(f"{name}: {response.message or ('enabled' if request.data else 'disabled')}", flush=True)
            if not response.success:
                return 1
    return 0


def switches(node: Node, seconds: float) -> list[str]:
    """Return the nodes of the only robot that can be enabled, the guard first.

    Raises:
        TimeoutError: If there are none.
        ValueError: If there are several robots, or several nodes that drive.
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


def _nodes(node: Node) -> list[str]:
    """Return the full names of all other nodes."""
    return sorted(
        f"{space.rstrip('/')}/{name}" for name, space in node.get_node_names_and_namespaces() if name != node.get_name()
    )
