"""A node's report on itself and on the graph around it, once a second on ``/diagnostics``."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node

from cmd_vel_guard.qos import STREAM
from cmd_vel_guard.reports import ERROR, OK, WARN, log, report
from cmd_vel_guard.sources import node_name
from turtlebot_gym_ros.nodes import NODES

_VELOCITIES = {"geometry_msgs/msg/Twist": "false", "geometry_msgs/msg/TwistStamped": "true"}


class Endpoint(NamedTuple):
    """A topic of a node."""

    topic: str
    """Its full name."""
    message: str
    """Its type, as the graph writes it: "geometry_msgs/msg/Twist"."""
    publishes: bool
    moves: bool = False
    """Whether messages on the topic move the robot."""
    sole: bool = False
    """Whether the node refuses its messages if there is a second publisher."""


class Reporter:
    """Publishes a node's diagnostics, and logs new problems in the graph around its topics; a plant simulates a robot."""

    def __init__(self, node: Node, endpoints: Iterable[Endpoint], *, plant: bool) -> None:
        self._node, self._endpoints, self._plant = node, list(endpoints), plant
        self._known: set[tuple[bytes, str]] = set()
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", STREAM)

    def publish(self, problems: Iterable[tuple[bytes, str]], summary: str, values: Mapping[str, object]) -> None:
        """Publish figures with the problems, their levels and texts, of the graph and then of the node, or a summary."""
        around = [problem for endpoint in self._endpoints for problem in self._around(endpoint)]
        for problem in set(around) - self._known:
            log(self._node, *problem)
        self._known = set(around)
        worst = sorted([*around, *problems], key=lambda problem: problem[0], reverse=True)
        level, text = worst[0][0] if worst else OK, " ".join(text for _, text in worst) or summary
        name = self._node.get_namespace().strip("/") or "turtlebot_gym_ros"
        self._publisher.publish(report(self._node, level, text, hardware=name, values=values))

    def _around(self, mine: Endpoint) -> Iterable[tuple[bytes, str]]:
        node, me = self._node, self._node.get_fully_qualified_name()
        publishers = node.get_publishers_info_by_topic(mine.topic)
        listeners = node.get_subscriptions_info_by_topic(mine.topic)
        for other in (other for other in (*publishers, *listeners) if other.topic_type != mine.message):
            text = f"{mine.topic}: {node_name(other)} has {other.topic_type}, this node {mine.message}: they cannot be matched."
            if mine.message in _VELOCITIES and (stamped := _VELOCITIES.get(other.topic_type)):
                text += f" Start this one with -p enable_stamped_cmd_vel:={stamped}"
            yield ERROR, text
        names = sorted(map(node_name, publishers))
        if mine.moves and not any(other.topic_type == mine.message for other in listeners):
            yield WARN, f"{mine.topic}: there is no listener."
        if mine.moves and len(names) > 1:
            rivals = ", ".join(name for name in names if name != me) or "another node of this name"
            yield ERROR, f"{mine.topic}: {rivals} publishes too; which of them the robot obeys is undefined."
        first = [name for name in names if not name.endswith("/cmd_vel_standby")]  # silent while a guard speaks
        if not mine.publishes and len(first) > 1 and (self._plant or mine.message not in _VELOCITIES):
            effect = "refused until there is one" if mine.sole else "which of them counts is undefined"
            yield ERROR if mine.sole else WARN, f"{mine.topic}: {' and '.join(first)} publish it: {effect}."
        if self._plant and not mine.publishes and mine.message in _VELOCITIES:
            ours = {me, *(f"{me.rpartition('/')[0]}/{name}" for name in (*NODES, "cmd_vel_standby"))}
            if strangers := sorted({node_name(other) for other in listeners} - ours):
                text = f"{mine.topic}: {', '.join(strangers)} obeys the same commands as this simulation. Is it a real robot?"
                yield WARN, text
