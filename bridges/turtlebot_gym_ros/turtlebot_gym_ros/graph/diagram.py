"""The graph as a picture, with nodes as boxes and topics as arrows, from the declarations or the actual connections.

`declared` reads the declarations of blocks, guard and recorders, and `connected` asks ROS; both return the same kind of set, so
that they can be compared, and `draw` draws either. Drawing needs matplotlib.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping, Sequence
from textwrap import fill
from typing import TYPE_CHECKING, NamedTuple

from rclpy.node import Node
from rclpy.qos import QoSCompatibility, qos_check_compatible
from rclpy.topic_endpoint_info import TopicEndpointInfo

from turtlebot_gym.plotting import BLACK, BLUE, GREEN, SKY_BLUE, VERMILLION
from turtlebot_gym.values import Command
from turtlebot_gym_ros.base.names import type_name
from turtlebot_gym_ros.base.process import Runner
from turtlebot_gym_ros.graph.recorder import TOPICS
from turtlebot_gym_ros.node.convert import conversion
from turtlebot_gym_ros.nodes import BLOCKS, NODES, load

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.patches import Patch

BEHIND_GUARD = {name: entry.guarded for name, entry in NODES.items() if entry.guarded}
"""Topic for commands, instead of ``cmd_vel``, if there is a guard."""
HIDDEN = (
    "/rosout",
    "/parameter_events",
    "/diagnostics",
    "/clock",
    "/reset",
    "/recorded",
    "/scan/newest",
    "/disagreement",
    "/resume",
)
"""Topics of nearly every node that are not part of the loop, or by which it is only watched."""


class Connection(NamedTuple):
    """A topic from one node to another."""

    publisher: str
    """Name of the publisher, without the first slash."""
    topic: str
    """Its full name, "/odom"."""
    message: str
    """Its type, as the graph writes it: "nav_msgs/msg/Odometry"."""
    subscriber: str


Connections = frozenset[Connection]


def declared(names: Iterable[str], *, stamped: bool = True) -> Connections:
    """Return the connections that the nodes declare.

    Args:
        names: The nodes of the graph: blocks, "cmd_vel_guard", "data_logger", and "bringup", which records a `Graph`.
        stamped: Whether velocities travel as TwistStamped or as Twist.

    Raises:
        ValueError: If there is no such node.
    """
    names = list(names)
    guarded = "cmd_vel_guard" in names
    says = {name: _says(name, guarded=guarded) for name in names}
    spoken = {topic: kind for topics in says.values() for topic, kind in topics.items()}
    return frozenset(
        Connection(publisher, f"/{topic}", type_name(conversion(kind, stamped=stamped).message), subscriber)
        for publisher, topics in says.items()
        for topic, kind in topics.items()
        for subscriber in names
        if topic in _hears(subscriber, spoken)
    )


def _says(name: str, *, guarded: bool) -> dict[str, type]:
    """Return the topics that a node publishes, with their value types."""
    if name in ("data_logger", "bringup"):
        return {}
    if name == "cmd_vel_guard":
        return {"cmd_vel": Command}
    outputs = _block(name).outputs.values()
    topics = {output.topic: output.type for output in outputs if f"/{output.topic}" not in HIDDEN}
    moves = BEHIND_GUARD.get(name) if guarded else None
    return {moves if moves and topic == "cmd_vel" else topic: kind for topic, kind in topics.items()}


def _hears(name: str, spoken: Mapping[str, type]) -> Iterable[str]:
    """Return the topics that a node subscribes to, among those with a publisher."""
    special = {"data_logger": spoken, "bringup": TOPICS, "cmd_vel_guard": [*BEHIND_GUARD.values(), "odom"]}
    return (
        special[name]
        if name in special
        else [item.topic for item in _block(name).inputs.values() if item.lock_step != "absent"]
    )


def _block(name: str) -> type:
    if name not in BLOCKS:
        raise ValueError(f"names must be of {', '.join(BLOCKS)}, cmd_vel_guard, data_logger and bringup, got {name!r}.")
    return load(name)


def connected(expected: Connections, *, domain: int | None = None, timeout: float = 10.0) -> Connections:
    """Return the current connections from ROS; types and quality of service must match, or nothing would arrive.

    It uses a temporary node, which needs a moment to discover the others.

    Args:
        expected: Connections to wait for; others are returned too.
        domain: ROS domain; None for that of the environment.
        timeout: Longest wait, s; then the connections found so far are returned.
    """
    runner = Runner(domain=domain)
    node = Node("diagram", context=runner.context)
    try:
        deadline = time.monotonic() + timeout
        while not (connections := _ask(node)) >= expected and time.monotonic() < deadline:
            time.sleep(0.05)
    finally:
        node.destroy_node()
        runner.close()
    return connections


def _ask(node: Node) -> Connections:
    return frozenset(
        Connection(_name(publisher), topic, publisher.topic_type, _name(subscriber))
        for topic, _ in node.get_topic_names_and_types()
        if topic not in HIDDEN
        for publisher in node.get_publishers_info_by_topic(topic)
        if not topic.startswith(f"/{_name(publisher)}/")  # a node's private topics
        for subscriber in node.get_subscriptions_info_by_topic(topic)
        if publisher.topic_type == subscriber.topic_type
        and qos_check_compatible(publisher.qos_profile, subscriber.qos_profile)[0] != QoSCompatibility.ERROR
    )


def _name(info: TopicEndpointInfo) -> str:
    return f"{info.node_namespace}/{info.node_name}".strip("/")


PLACES = {name: entry.place for name, entry in NODES.items() if entry.place}
"""Column and row of each node of the loop, which runs clockwise; pure listeners are below, other nodes above."""
WORDS = {name: entry.word for name, entry in NODES.items()} | {
    "/reference": "waypoint",
    "/amcl_pose": "pose in the map",
    "/hypotheses": "other places",
    "/next_reference": "next waypoint",
    "/cmd_vel": "command",
    "/cmd_vel_in": "command",
    "/cmd_vel_teleop": "command",
    "/odom": "odometry",
    "/true_state": "true state",
    "/estimate": "estimate",
    "/nis": "innovation",
    "/markers": "markers",
}
"""Plain names of nodes and topics."""
_COLORS = {
    "/reference": GREEN, "/next_reference": GREEN, "/odom": SKY_BLUE, "/estimate": VERMILLION, "/true_state": BLACK,
    "/cmd_vel": BLUE, "/cmd_vel_in": BLUE, "/cmd_vel_teleop": BLUE,
}  # fmt: skip
_ACROSS, _UP, _MARGIN = 2.75, 1.5, 0.2
_WIDTH, _HEIGHT = 1.55, 0.5
"""Sizes of columns, rows, the frame and the boxes, inches."""
_ARROW = {"arrowstyle": "-|>", "mutation_scale": 13.0, "linewidth": 1.6, "shrinkA": 0.0, "shrinkB": 1.0}
_NO_BREAK = "\N{NO-BREAK SPACE}"
_Place = tuple[float, float]


def draw(axes: Axes, connections: Connections, *, plain: bool = False) -> Axes:
    """Draw nodes as boxes and topics as arrows, in the colours of the drives' figures.

    Nodes that send nothing to the loop, such as recorders, are below it; their arrows name what they receive.

    Args:
        axes: Where to draw; at 7.5 by 3.8 inches, text fits into the boxes of a loop with a recorder.
        connections: The graph.
        plain: Whether to use plain names, as in a block diagram, instead of ROS names.
    """
    nodes = {name for connection in connections for name in (connection.publisher, connection.subscriber)}
    loop = (nodes & PLACES.keys()) | {
        connection.publisher for connection in connections if connection.subscriber in PLACES
    } or nodes
    at = _loop_places(loop)
    words = WORDS if plain else {}
    boxes = {name: _draw_box(axes, place, words.get(name, name), linestyle="-") for name, place in at.items()}
    arrows: dict[tuple[str, str], list[Connection]] = {}
    for connection in sorted(connections, key=lambda connection: (len(connection.topic), connection)):
        arrows.setdefault((connection.publisher, connection.subscriber), []).append(connection)
    for (publisher, subscriber), topics in arrows.items():
        if not {publisher, subscriber} <= loop:
            continue
        bend = 0.25 if (subscriber, publisher) in arrows else 0.0  # two arrows must not overlap
        style = {"patchA": boxes[publisher], "patchB": boxes[subscriber], "connectionstyle": f"arc3,rad={bend}"}
        color = _COLORS.get(topics[0].topic, BLACK)
        axes.annotate("", at[subscriber], at[publisher], arrowprops={**_ARROW, **style, "color": color}, zorder=1.5)
        _draw_label(axes, at[publisher], at[subscriber], bend, _text(topics, words))
    bystanders = {
        name: sorted(
            {words.get(connection.topic, connection.topic) for connection in connections if connection.subscriber == name}
        )
        for name in sorted(nodes - loop)
    }
    if bystanders:
        _draw_bystanders(axes, list(at.values()), {words.get(name, name): heard for name, heard in bystanders.items()})
    axes.set_axis_off()
    axes.set_aspect("equal")
    axes.margins(0.03)
    return axes


def _loop_places(loop: Iterable[str]) -> dict[str, _Place]:
    """Return the places of the boxes, without empty columns and rows."""
    strangers = sorted(set(loop) - PLACES.keys())
    grid = {name: PLACES.get(name) or (strangers.index(name), 3) for name in loop}
    columns, rows = (sorted({place[axis] for place in grid.values()}) for axis in (0, 1))
    return {name: (columns.index(x) * _ACROSS, rows.index(y) * _UP) for name, (x, y) in sorted(grid.items())}


def _draw_box(axes: Axes, place: _Place, text: str, *, linestyle: str) -> Patch:
    from matplotlib.patches import FancyBboxPatch

    x, y = place
    corner, shape = (x - 0.5 * _WIDTH, y - 0.5 * _HEIGHT), "round,pad=0,rounding_size=0.1"
    box = FancyBboxPatch(corner, _WIDTH, _HEIGHT, shape, facecolor="0.95", edgecolor=BLACK, linestyle=linestyle, zorder=3.0)
    axes.text(x, y, text, ha="center", va="center", fontsize=9.0, zorder=4.0)
    return axes.add_patch(box)


def _text(topics: Iterable[Connection], words: Mapping[str, str]) -> str:
    """Return the label of an arrow: its topics, with their types below them unless in plain words."""
    lines = [words.get(connection.topic, connection.topic) for connection in topics]
    kinds = dict.fromkeys(connection.message.rpartition("/")[2] for connection in topics)
    return "\n".join([*lines, *([] if words else kinds)])


def _draw_label(axes: Axes, start: _Place, end: _Place, bend: float, text: str) -> None:
    """Write at the middle of an arrow: above a level one, beside a bent one, on an upright or slanted one."""
    (x, y), (dx, dy) = start, (end[0] - start[0], end[1] - start[1])
    share = 0.5 if bend or not dx or not dy else 0.62  # off the middle, where a vertical arrow has its label
    x, y = x + share * dx + 0.5 * bend * dy, y + share * dy - 0.5 * bend * dx
    across = "center" if not bend or not dy else "left" if dy > 0.0 else "right"
    up = "bottom" if not dy else "center"
    shift = (6.0 * (across == "left") - 6.0 * (across == "right"), 4.0 * (up == "bottom"))
    patch = {"facecolor": "white", "edgecolor": "none", "boxstyle": "square,pad=0.15"} if across == up == "center" else None
    axes.annotate(text, (x, y), shift, textcoords="offset points", ha=across, va=up, fontsize=8.0, bbox=patch, zorder=2.0)


def _draw_bystanders(axes: Axes, loop: Sequence[_Place], heard: Mapping[str, Sequence[str]]) -> None:
    """Draw a frame around the loop, and an arrow from it to each pure listener."""
    from matplotlib.patches import Rectangle

    (left, right), (low, high) = ((min(values), max(values)) for values in zip(*loop, strict=True))
    left, right = left - 0.5 * _WIDTH - _MARGIN, right + 0.5 * _WIDTH + _MARGIN
    low, high = low - 0.5 * _HEIGHT - _MARGIN, high + 0.5 * _HEIGHT + 1.6 * _MARGIN
    axes.add_patch(Rectangle((left, low), right - left, high - low, fill=False, edgecolor="0.4", linewidth=0.9, linestyle=":"))
    first = 0.5 * (left + right) - 0.5 * (len(heard) - 1) * _ACROSS
    for column, (name, topics) in enumerate(heard.items()):
        x, y = first + column * _ACROSS, low - 0.8 - 0.5 * _HEIGHT
        box = _draw_box(axes, (x, y), name, linestyle="--")
        axes.annotate("", (x, y), (x, low), arrowprops={**_ARROW, "patchB": box, "color": "0.4", "linestyle": "--"})
        text = fill(", ".join(topic.replace(" ", _NO_BREAK) for topic in topics), 34)
        axes.text(x + 0.1, low - 0.4, text, ha="left", va="center", fontsize=8.0)
