"""``topics``, ``echo`` and ``button``: what is on the graph's topics."""

from __future__ import annotations

import sys
import time
from typing import Any

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import Bool

from cmd_vel_guard.qos import STREAM
from cmd_vel_guard.sources import node_name
from turtlebot_gym.validation import Range
from turtlebot_gym_ros.base.names import absolute, message_type
from turtlebot_gym_ros.base.process import go_on
from turtlebot_gym_ros.tools.asking import answered, asking, parser_of, remark_if_alone, settle, type_in
from turtlebot_gym_ros.tools.messages import field_of, text_of

COUNT = Range(0, 2**31, whole=True)
"""A number of messages; 0 for no end."""
BUTTON_PERIOD = 0.1
"""Time between two messages of `button`, s; as a radio needs it."""


@answered
def topics(argv: Any = None) -> int:
    """Print the topics, their types, and how many publish and subscribe; with ``--verbose`` who they are."""
    parser = parser_of("topics", "List topics, or services.", waits_for="a graph that still grows")
    parser.add_argument("topic", nargs="?", help="one topic only")
    parser.add_argument("--services", action="store_true", help="list services instead")
    parser.add_argument("--verbose", action="store_true", help="list the nodes behind each topic with their quality of service")
    options = parser.parse_args(argv)
    if options.services and (options.verbose or options.topic):
        raise ValueError("--services lists all services, without --verbose and without a topic.")
    with asking() as node:
        if options.topic:
            type_in(node, options.topic, "topic", options.wait)
        settle(node, options.wait)
        if remark := remark_if_alone(node):
            raise TimeoutError(f"there are no topics.{remark}")
        kinds = node.get_service_names_and_types() if options.services else node.get_topic_names_and_types()
        rows = [(name, ", ".join(types)) for name, types in sorted(kinds)]
        if options.services:
            own = f"/{node.get_name()}/"
            print("\n".join(f"{name}  [{types}]" for name, types in rows if not name.startswith(own)))
            return 0
        if options.topic:
            rows = [row for row in rows if row[0] == absolute(options.topic, "topic")]
        for name, types in rows:
            ends = node.get_publishers_info_by_topic(name), node.get_subscriptions_info_by_topic(name)
            print(f"{name}  [{types}]  {len(ends[0])} publish, {len(ends[1])} subscribe")
            for role, infos in zip(("publishes", "subscribes"), ends, strict=True):
                for info in infos if options.verbose else ():
                    quality = info.qos_profile
                    manner = f"{quality.reliability.name.lower()}, {quality.durability.name.lower()}"
                    print(f"    {role}: {node_name(info)}  [{info.topic_type}]  {manner}")
    return 0


def _quality(node: Node, topic: str) -> QoSProfile:
    """Return a quality of service that hears every publisher of a topic, and the last values where all keep them."""
    offers = [info.qos_profile for info in node.get_publishers_info_by_topic(topic)]
    reliable = bool(offers) and all(offer.reliability == ReliabilityPolicy.RELIABLE for offer in offers)
    latched = bool(offers) and all(offer.durability == DurabilityPolicy.TRANSIENT_LOCAL for offer in offers)
    return QoSProfile(
        depth=100,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


@answered
def echo(argv: Any = None) -> int:
    """Print the messages of a topic as YAML."""
    parser = parser_of("echo", "Print the messages of a topic as YAML, until Ctrl-C.", waits_for="the graph")
    parser.add_argument("topic")
    parser.add_argument("--field", default="", help="one field of each message, such as pose.pose.position")
    parser.add_argument("--count", type=int, default=0, help="end after so many messages (default: never)")
    parser.add_argument("--once", action="store_true", help="end after one message")
    options = parser.parse_args(argv)
    COUNT.check("--count", options.count)
    wanted, heard = 1 if options.once else options.count, [0]
    with asking() as node:
        topic, kind = type_in(node, options.topic, "topic", options.wait)
        errors: list[str] = []

        def show(message: Any) -> None:
            if errors or (wanted and heard[0] >= wanted):
                return
            try:
                part = field_of(message, options.field)
            except ValueError as error:
                errors.append(f"{kind}: {error}")
                return
            print(f"{text_of(part)}\n---", flush=True)
            heard[0] += 1

        node.create_subscription(message_type(kind), topic, show, _quality(node, topic))
        began = time.monotonic()
        while not errors and not (wanted and heard[0] >= wanted):
            go_on()
            if wanted and not heard[0] and time.monotonic() > began + options.wait:
                publishers = node.count_publishers(topic)
                why = f"{publishers} publish it" if publishers else "nobody publishes it"
                raise TimeoutError(f"{topic} has said nothing for {options.wait:g} s: {why}.")
            time.sleep(0.02)
    if errors:
        raise ValueError(errors[0])
    return 0


@answered
def button(argv: Any = None) -> int:
    """Say that an emergency stop is not pressed, again and again; the end of it is a stop."""
    parser = parser_of("button", "Be an emergency stop that is not pressed. Ctrl-C ends it, which stops the robot.")
    parser.add_argument("topic", nargs="?", default="emergency_stop", help="(default: emergency_stop)")
    options = parser.parse_args(argv)
    with asking() as node:
        publisher = node.create_publisher(Bool, absolute(options.topic, "topic"), STREAM)
        print(f"publishes on {publisher.topic_name}; Ctrl-C stops the robot", file=sys.stderr, flush=True)
        due = time.monotonic()
        while True:
            go_on()
            publisher.publish(Bool(data=False))
            due += BUTTON_PERIOD
            time.sleep(max(due - time.monotonic(), 0.0))
