"""The graph as a picture: nodes are boxes, topics are arrows, from the declarations or from what is really connected.

`declared` reads what blocks, guard and recorders say of themselves, `connected` asks ROS; both return the same kind of set, so
that one can be compared with the other, and `draw` draws either of them. Drawing needs matplotlib.
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
from turtlebot_gym_ros.graph.recorder import TOPICS
from turtlebot_gym_ros.node.convert import conversion
from turtlebot_gym_ros.node.diagnostics import type_name
from turtlebot_gym_ros.node.runner import Runner
from turtlebot_gym_ros.nodes import BLOCKS, NODES, load

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.patches import Patch

BEHIND_GUARD = {name: entry.guarded for name, entry in NODES.items() if entry.guarded}
"""Where those who command speak, instead of on ``cmd_vel``, when there is a guard."""
HIDDEN = ("/rosout", "/parameter_events", "/diagnostics", "/clock", "/reset", "/recorded", "/scan/newest")
"""Topics that nearly every node has; they carry nothing of the loop."""


class Connection(NamedTuple):
    """A node that is heard by another one."""

    publisher: str
    """Its name, without the first slash."""
    topic: str
    """Its full name, "/odom"."""
    message: str
    """Its type, as the graph writes it: "nav_msgs/msg/Odometry"."""
    subscriber: str


Connections = frozenset[Connection]


def declared(names: Iterable[str], *, stamped: bool = True) -> Connections:
    """Return who hears whom by what the nodes declare.

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
    """Return on which topics a node speaks, and with which values."""
    if name in ("data_logger", "bringup"):
        return {}
    if name == "cmd_vel_guard":
        return {"cmd_vel": Command}
    topics = {each.topic: each.type for each in _block(name).outputs.values()}
    moves = BEHIND_GUARD.get(name) if guarded else None
    return {moves if moves and topic == "cmd_vel" else topic: kind for topic, kind in topics.items()}


def _hears(name: str, spoken: Mapping[str, type]) -> Iterable[str]:
    """Return which topics a node listens to, of those on which somebody speaks."""
    special = {"data_logger": spoken, "bringup": TOPICS, "cmd_vel_guard": BEHIND_GUARD.values()}
    return special[name] if name in special else [each.topic for each in _block(name).inputs.values()]


def _block(name: str) -> type:
    if name not in BLOCKS:
        raise ValueError(f"names must be of {', '.join(BLOCKS)}, cmd_vel_guard, data_logger and bringup, got {name!r}.")
    return load(name)


def connected(expected: Connections, *, domain: int | None = None, timeout: float = 10.0) -> Connections:
    """Ask ROS who hears whom at present; types and quality of service must fit, or nothing would arrive.

    It asks through a node of its own, which needs a moment to learn of the others.

    Args:
        expected: What to wait for; what there is besides is returned as well.
        domain: ROS domain; None for that of the environment.
        timeout: Longest wait, s; what has been found until then is returned.
    """
    runner = Runner(domain=domain)
    node = Node("diagram", context=runner.context)
    try:
        deadline = time.monotonic() + timeout
        while not (found := _ask(node)) >= expected and time.monotonic() < deadline:
            time.sleep(0.05)
    finally:
        node.destroy_node()
        runner.close()
    return found


def _ask(node: Node) -> Connections:
    return frozenset(
        Connection(_name(publisher), topic, publisher.topic_type, _name(subscriber))
        for topic, _ in node.get_topic_names_and_types()
        if topic not in HIDDEN
        for publisher in node.get_publishers_info_by_topic(topic)
        if not topic.startswith(f"/{_name(publisher)}/")  # what a node says of itself
        for subscriber in node.get_subscriptions_info_by_topic(topic)
        if publisher.topic_type == subscriber.topic_type
        and qos_check_compatible(publisher.qos_profile, subscriber.qos_profile)[0] != QoSCompatibility.ERROR
    )


def _name(info: TopicEndpointInfo) -> str:
    return f"{info.node_namespace}/{info.node_name}".strip("/")


PLACES = {name: entry.place for name, entry in NODES.items() if entry.place}
"""Column and row of each node of the loop, which runs clockwise; who only listens stands below, anybody else above."""
WORDS = {name: entry.word for name, entry in NODES.items()} | {
    "/reference": "waypoint",
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
"""Nodes and topics in plain words."""
_COLORS = {
    "/reference": GREEN, "/next_reference": GREEN, "/odom": SKY_BLUE, "/estimate": VERMILLION, "/true_state": BLACK,
    "/cmd_vel": BLUE, "/cmd_vel_in": BLUE, "/cmd_vel_teleop": BLUE,
}  # fmt: skip
_ACROSS, _UP, _MARGIN = 2.75, 1.5, 0.2
_WIDTH, _HEIGHT = 1.55, 0.5
"""Of columns, rows, the frame and the boxes; in."""
_ARROW = {"arrowstyle": "-|>", "mutation_scale": 13.0, "linewidth": 1.6, "shrinkA": 0.0, "shrinkB": 1.0}
_NO_BREAK = "\N{NO-BREAK SPACE}"
_Place = tuple[float, float]


def draw(axes: Axes, connections: Connections, *, plain: bool = False) -> Axes:
    """Draw nodes as boxes and what they tell each other as arrows, in the colours of the drives' figures.

    Whoever tells the loop nothing, such as a recorder, stands below it; its arrow says what it hears.

    Args:
        axes: Where to draw; at 7.5 by 3.8 inches, text and boxes of a loop with a recorder fit each other.
        connections: The graph.
        plain: Whether to draw it as a block diagram, in plain words, or with the names that ROS uses.
    """
    nodes = {name for each in connections for name in (each.publisher, each.subscriber)}
    loop = (nodes & PLACES.keys()) | {each.publisher for each in connections if each.subscriber in PLACES} or nodes
    at = _loop_places(loop)
    words = WORDS if plain else {}
    boxes = {name: _draw_box(axes, place, words.get(name, name), linestyle="-") for name, place in at.items()}
    arrows: dict[tuple[str, str], list[Connection]] = {}
    for each in sorted(connections, key=lambda each: (len(each.topic), each)):
        arrows.setdefault((each.publisher, each.subscriber), []).append(each)
    for (publisher, subscriber), topics in arrows.items():
        if not {publisher, subscriber} <= loop:
            continue
        bend = 0.25 if (subscriber, publisher) in arrows else 0.0  # two arrows must not lie on each other
        style = {"patchA": boxes[publisher], "patchB": boxes[subscriber], "connectionstyle": f"arc3,rad={bend}"}
        color = _COLORS.get(topics[0].topic, BLACK)
        axes.annotate("", at[subscriber], at[publisher], arrowprops={**_ARROW, **style, "color": color}, zorder=1.5)
        _draw_label(axes, at[publisher], at[subscriber], bend, _text(topics, words))
    bystanders = {
        name: sorted({words.get(each.topic, each.topic) for each in connections if each.subscriber == name})
        for name in sorted(nodes - loop)
    }
    if bystanders:
        _draw_bystanders(axes, list(at.values()), {words.get(name, name): heard for name, heard in bystanders.items()})
    axes.set_axis_off()
    axes.set_aspect("equal")
    axes.margins(0.03)
    return axes


def _loop_places(loop: Iterable[str]) -> dict[str, _Place]:
    """Return where the boxes stand; columns and rows in which nobody stands are left out."""
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
    """Return what stands at an arrow: its topics, and under them their types, unless in plain words."""
    lines = [words.get(each.topic, each.topic) for each in topics]
    kinds = dict.fromkeys(each.message.rpartition("/")[2] for each in topics)
    return "\n".join([*lines, *([] if words else kinds)])


def _draw_label(axes: Axes, start: _Place, end: _Place, bend: float, text: str) -> None:
    """Write at the middle of an arrow: above a level one, beside a bent one, on an upright or slanted one."""
    (x, y), (dx, dy) = start, (end[0] - start[0], end[1] - start[1])
    share = 0.5 if bend or not dx or not dy else 0.62  # off the middle, where the label of an upright one is
    x, y = x + share * dx + 0.5 * bend * dy, y + share * dy - 0.5 * bend * dx
    across = "center" if not bend or not dy else "left" if dy > 0.0 else "right"
    up = "bottom" if not dy else "center"
    shift = (6.0 * (across == "left") - 6.0 * (across == "right"), 4.0 * (up == "bottom"))
    patch = {"facecolor": "white", "edgecolor": "none", "boxstyle": "square,pad=0.15"} if across == up == "center" else None
    axes.annotate(text, (x, y), shift, textcoords="offset points", ha=across, va=up, fontsize=8.0, bbox=patch, zorder=2.0)


def _draw_bystanders(axes: Axes, loop: Sequence[_Place], heard: Mapping[str, Sequence[str]]) -> None:
    """Draw a frame round the loop, and from it an arrow to each one who only listens."""
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
