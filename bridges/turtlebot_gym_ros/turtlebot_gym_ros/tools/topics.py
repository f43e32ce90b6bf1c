"""``topics`` and ``status``: what is on the graph's topics, and what its nodes say of themselves."""

from __future__ import annotations

import math
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy

from cmd_vel_guard.qos import LATCHED, SENSOR, STREAM
from cmd_vel_guard.sources import node_name
from turtlebot_gym_ros.base.names import absolute, message_type
from turtlebot_gym_ros.tools.asking import answered, asking, listen, parser_of, remark_if_alone, until

LEVELS = ("ok", "warning", "error", "stale")


@answered
def status(argv: Any = None) -> int:
    """Print in a table what each node says on ``/diagnostics``; return 0 if some are heard, and all are without remarks."""
    parser = parser_of("status", "Print which node waits for what; the exit code is 0 if all nodes run without remarks.")
    parser.add_argument("--namespace", default="", help="namespace of the robot, such as robot1; by default all nodes")
    options = parser.parse_args(argv)
    space = f"{absolute(options.namespace).rstrip('/')}/"
    said: dict[str, tuple[int, str]] = {}

    def hear(message: DiagnosticArray) -> None:
        told = {each.name: (each.level[0], each.message) for each in message.status}
        said.update({name.removeprefix(space): report for name, report in told.items() if name.startswith(space)})

    with asking() as node:
        node.create_subscription(DiagnosticArray, "/diagnostics", hear, STREAM)
        listen(options.wait)
    first = max(map(len, ("node", *said)))
    print(f"{'node':<{first}}  level    says")
    for name, (level, text) in sorted(said.items()):
        print(f"{name:<{first}}  {LEVELS[level]:<7}  {text}")
    return 0 if said and not any(level for level, _ in said.values()) else 1


@answered
def topics(argv: Any = None) -> int:
    """Print the topics, their types and who is at them; with ``--echo`` the messages of one."""
    parser = parser_of("topics", "List topics and who is at them, or print the messages of one.")
    parser.add_argument("topic", nargs="?", help="one topic only")
    parser.add_argument("--echo", action="store_true", help="print the messages of the topic, until Ctrl-C")
    options = parser.parse_args(argv)
    if options.echo and not options.topic:
        raise ValueError("--echo needs a topic.")
    with asking() as node:
        if options.echo:
            _echo(node, absolute(options.topic, "topic"), options.wait)
        listen(options.wait)
        if remark := remark_if_alone(node):
            raise TimeoutError(f"there are no topics.{remark}")
        for name, types in sorted(node.get_topic_names_and_types()):
            if options.topic and name != absolute(options.topic, "topic"):
                continue
            print(f"{name}  [{', '.join(types)}]")
            ends = node.get_publishers_info_by_topic(name), node.get_subscriptions_info_by_topic(name)
            for role, infos in zip(("publishes", "subscribes"), ends, strict=True):
                for info in infos:
                    quality = info.qos_profile
                    manner = f"{quality.reliability.name.lower()}, {quality.durability.name.lower()}"
                    print(f"    {role}: {node_name(info)}  {manner}")
    return 0


def _echo(node: Node, topic: str, seconds: float) -> None:
    """Print the messages of a topic until Ctrl-C; raise `TimeoutError` if there is none."""

    def known() -> str | None:
        return next((kinds[0] for name, kinds in node.get_topic_names_and_types() if name == topic), None)

    kind = until(known, seconds, lambda: f"there is no topic {topic} after {seconds:g} s.{remark_if_alone(node)}")
    # A quality of service that hears every publisher, and the last value where all keep it.
    offers = {info.qos_profile.durability for info in node.get_publishers_info_by_topic(topic)}
    profile = LATCHED if offers == {DurabilityPolicy.TRANSIENT_LOCAL} else SENSOR
    node.create_subscription(message_type(kind), topic, lambda message: print(message, flush=True), profile)
    listen(math.inf)
