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


class NodeProblem(NamedTuple):
    """A problem to report to users."""

    level: bytes
    text: str


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
    """Publishes a node's diagnostics, and logs new problems in the graph around it.

    Args:
        node: The node.
        endpoints: Its topics.
        plant: Whether the node simulates a robot, so that no other node should obey the same commands.
    """

    def __init__(self, node: Node, endpoints: Iterable[Endpoint], *, plant: bool) -> None:
        self._node, self._endpoints, self._plant = node, list(endpoints), plant
        self._known: set[NodeProblem] = set()
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", STREAM)

    def publish(self, problems: Iterable[NodeProblem], summary: str, values: Mapping[str, object]) -> None:
        """Publish the problems.

        Args:
            problems: Problems of the node itself; those of the graph, which may be their cause, stand before them.
            summary: Message without problems.
            values: Figures by name.
        """
        around = [problem for endpoint in self._endpoints for problem in self._around(endpoint)]
        for problem in set(around) - self._known:
            log(self._node, *problem)
        self._known = set(around)
        worst = sorted([*around, *problems], key=lambda problem: problem.level, reverse=True)
        level, text = worst[0].level if worst else OK, " ".join(problem.text for problem in worst) or summary
        name = self._node.get_namespace().strip("/") or "turtlebot_gym_ros"
        self._publisher.publish(report(self._node, level, text, hardware=name, values=values))

    def _around(self, mine: Endpoint) -> Iterable[NodeProblem]:
        """Yield the problems in the graph around a topic."""
        node, me = self._node, self._node.get_fully_qualified_name()
        publishers = node.get_publishers_info_by_topic(mine.topic)
        listeners = node.get_subscriptions_info_by_topic(mine.topic)
        for verb, others in (("publishes", publishers), ("subscribes to", listeners)):
            for other in (other for other in others if other.topic_type != mine.message):
                yield self._mismatch(mine, f"{node_name(other)} {verb}", other.topic_type)
        names = sorted(map(node_name, publishers))
        if mine.moves and not any(other.topic_type == mine.message for other in listeners):
            yield NodeProblem(WARN, f"{mine.topic}: there is no listener.")
        if mine.moves and len(names) > 1:
            rivals = ", ".join(name for name in names if name != me) or "another node of this name"
            yield NodeProblem(ERROR, f"{mine.topic}: {rivals} publishes too; which of them the robot obeys is undefined.")
        elif not mine.publishes and len(names) > 1 and (self._plant or mine.message not in _VELOCITIES):
            effect = "refused until there is one" if mine.sole else "which of them counts is undefined"
            yield NodeProblem(ERROR if mine.sole else WARN, f"{mine.topic}: {' and '.join(names)} publish it: {effect}.")
        if self._plant and not mine.publishes and mine.message in _VELOCITIES:
            obey = [node_name(other) for other in listeners]
            obey.remove(me) if me in obey else None
            last = me.rpartition("/")[2]
            if strangers := sorted(name for name in obey if (end := name.rpartition("/")[2]) not in NODES or end == last):
                text = f"{mine.topic}: {', '.join(strangers)} obeys the same commands as this simulation. Is it a real robot?"
                yield NodeProblem(WARN, text)

    def _mismatch(self, mine: Endpoint, other: str, kind: str) -> NodeProblem:
        text = f"{mine.topic}: {other} {kind}, this node uses {mine.message}: they cannot be matched."
        if mine.message in _VELOCITIES and kind in _VELOCITIES:
            space = self._node.get_namespace()
            words = "" if space == "/" else f"-r __ns:={space} "
            start = f"python -m turtlebot_gym_ros {self._node.get_name()} --ros-args {words}"
            text += f" Start this one with: {start}-p enable_stamped_cmd_vel:={_VELOCITIES[kind]}"
        return NodeProblem(ERROR, text)
