"""A node's report on itself and on the graph around it, once a second on ``/diagnostics``."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from rclpy.topic_endpoint_info import TopicEndpointInfo

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


def _mismatch(node: Node, mine: Endpoint, other: TopicEndpointInfo, verb: str) -> NodeProblem:
    text = f"{mine.topic}: {node_name(other)} {verb} {other.topic_type}, this node uses {mine.message}: they cannot be matched."
    if mine.message in _VELOCITIES and other.topic_type in _VELOCITIES:
        stamped = _VELOCITIES[other.topic_type]
        space = node.get_namespace()
        words = "" if space == "/" else f"-r __ns:={space} "
        start = f"python -m turtlebot_gym_ros {node.get_name()} --ros-args {words}-p enable_stamped_cmd_vel:={stamped}"
        text += f" Start this one with: {start}"
    return NodeProblem(ERROR, text)


def _graph_problems(node: Node, endpoints: Iterable[Endpoint], *, plant: bool = False) -> list[NodeProblem]:
    """Return the problems in the graph around a node.

    Args:
        node: The node.
        endpoints: Its topics.
        plant: Whether the node simulates a robot, so that no other node should obey the same commands.
    """
    problems: list[NodeProblem] = []
    for mine in endpoints:
        publishers = node.get_publishers_info_by_topic(mine.topic)
        subscriptions = node.get_subscriptions_info_by_topic(mine.topic)
        for verb, others in (("publishes", publishers), ("subscribes to", subscriptions)):
            problems += [_mismatch(node, mine, other, verb) for other in others if other.topic_type != mine.message]
        if mine.moves and not any(other.topic_type == mine.message for other in subscriptions):
            problems.append(NodeProblem(WARN, f"{mine.topic}: there is no listener."))
        rivals = [name for other in publishers if (name := node_name(other)) != node.get_fully_qualified_name()]
        if mine.moves and len(publishers) > 1:
            rival = ", ".join(rivals) or "another node of this name"
            problems.append(
                NodeProblem(ERROR, f"{mine.topic}: {rival} publishes too; which of them the robot obeys is undefined.")
            )
        elif not mine.publishes and len(publishers) > 1 and (plant or mine.message not in _VELOCITIES):
            names = " and ".join(sorted(map(node_name, publishers)))
            effect = "refused until there is one" if mine.sole else "which of them counts is undefined"
            problems.append(NodeProblem(ERROR if mine.sole else WARN, f"{mine.topic}: {names} publish it: {effect}."))
        if plant and not mine.publishes and mine.message in _VELOCITIES:
            names = [node_name(other) for other in subscriptions]
            strangers = {node_name(other) for other in subscriptions if other.node_name not in NODES}
            strangers |= {name for name in names if name.endswith(f"/{node.get_name()}")} - {node.get_fully_qualified_name()}
            if names.count(node.get_fully_qualified_name()) > 1:
                strangers.add("another simulator")
            who = ", ".join(sorted(strangers))
            text = f"{mine.topic}: {who} obeys the same commands as this simulation. Is it a real robot?"
            problems += [NodeProblem(WARN, text)] if strangers else []
    return problems


class Reporter:
    """Publishes a node's diagnostics, and logs new problems in the graph around it.

    Args:
        node: The node.
        endpoints: Its topics.
        plant: Whether the node simulates a robot.
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
        around = _graph_problems(self._node, self._endpoints, plant=self._plant)
        for problem in set(around) - self._known:
            log(self._node, *problem)
        self._known = set(around)
        worst = sorted([*around, *problems], key=lambda problem: problem.level, reverse=True)
        self._publisher.publish(
            report(
                self._node,
                worst[0].level if worst else OK,
                " ".join(problem.text for problem in worst) or summary,
                hardware=self._node.get_namespace().strip("/") or "turtlebot_gym_ros",
                values=values,
            )
        )
