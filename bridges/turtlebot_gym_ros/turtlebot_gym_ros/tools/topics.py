"""``topics``, ``echo``, ``hz`` and ``pub``: what is on the graph's topics."""

from __future__ import annotations

import sys
import time
from typing import Any

import numpy as np
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from turtlebot_gym.validation import POSITIVE, Range
from turtlebot_gym_ros.base.names import absolute, message_type, node_name
from turtlebot_gym_ros.base.process import go_on
from turtlebot_gym_ros.base.qos import STREAM
from turtlebot_gym_ros.tools.asking import answered, asking, parser_of, pause, remark_if_alone, settle, type_in, until
from turtlebot_gym_ros.tools.messages import field_of, message_of, text_of

COUNT = Range(0, 2**31, whole=True)
"""A number of messages; 0 for no end."""


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
def hz(argv: Any = None) -> int:
    """Print the rate at which the messages of a topic arrive."""
    parser = parser_of(
        "hz", "Print the rate at which the messages of a topic arrive, and their intervals.", waits_for="the graph"
    )
    parser.add_argument("topic")
    parser.add_argument("--seconds", type=float, default=5.0, help="how long to listen, s (default: 5)")
    options = parser.parse_args(argv)
    POSITIVE.check("--seconds", options.seconds)
    times: list[float] = []
    with asking() as node:
        topic, kind = type_in(node, options.topic, "topic", options.wait)
        quality = _quality(node, topic)
        node.create_subscription(message_type(kind), topic, lambda raw: times.append(time.monotonic()), quality, raw=True)
        pause(options.seconds)
        publishers = node.count_publishers(topic)
    if len(times) < 2:
        raise TimeoutError(f"{topic} has sent {len(times)} messages in {options.seconds:g} s; {publishers} publish it.")
    intervals = np.diff(times)
    print(
        f"{topic}: {1.0 / intervals.mean():.2f} Hz; intervals {intervals.min():.3f} to {intervals.max():.3f} s, "
        f"deviation {intervals.std():.4f} s; {len(times)} messages"
    )
    return 0


@answered
def pub(argv: Any = None) -> int:
    """Publish a message again and again."""
    parser = parser_of(
        "pub", "Publish a message, until Ctrl-C; the emergency stop of the deploy page, for example.", waits_for="the graph"
    )
    parser.add_argument("topic")
    parser.add_argument("type", help="such as std_msgs/msg/Bool")
    parser.add_argument("values", nargs="?", default="", help="fields in YAML, such as '{data: false}'; defaults elsewhere")
    parser.add_argument("--rate", type=float, default=1.0, help="how often, Hz (default: 1)")
    parser.add_argument("--count", type=int, default=0, help="end after so many messages (default: never)")
    parser.add_argument("--once", action="store_true", help="end after one message, as soon as anybody listens")
    options = parser.parse_args(argv)
    POSITIVE.of("Hz").check("--rate", options.rate)
    COUNT.check("--count", options.count)
    message, wanted = message_of(options.type, options.values), 1 if options.once else options.count
    with asking() as node:
        publisher = node.create_publisher(type(message), absolute(options.topic, "topic"), STREAM)
        if options.once:
            missing = f"nobody has listened to {publisher.topic_name} for {options.wait:g} s."
            until(lambda: publisher.get_subscription_count() or None, options.wait, lambda: missing)
        else:
            print(f"publishes on {publisher.topic_name} at {options.rate:g} Hz; Ctrl-C ends it", file=sys.stderr, flush=True)
        sent, due = 0, time.monotonic()
        while not (wanted and sent >= wanted):
            go_on()
            publisher.publish(message)
            sent, due = sent + 1, due + 1.0 / options.rate
            time.sleep(max(due - time.monotonic(), 0.0))
        if wanted:
            publisher.wait_for_all_acked()
    return 0
