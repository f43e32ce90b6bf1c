"""``foxglove``: the live graph as a server for Foxglove (Studio or app.foxglove.dev), without ``foxglove_bridge``."""

from __future__ import annotations

import sys
import time
from typing import Any, cast

from rclpy.node import Node

from turtlebot_gym_ros.base.names import message_type
from turtlebot_gym_ros.base.process import go_on
from turtlebot_gym_ros.base.qos import SENSOR
from turtlebot_gym_ros.tools.asking import WAIT, answered, asking, parser_of, remark_if_alone

LOOK = 1.0
"""How often new topics are looked for, s."""
PORT = 8765
"""The port that Foxglove suggests."""


class Relay:
    """Passes every topic of known type on to a Foxglove server, message by message, as it came.

    Args:
        node: Subscribes to the topics.
        make_channel: ``make_channel(topic, kind, definition)`` returns an object whose ``log`` takes a message's bytes.
    """

    def __init__(self, node: Node, make_channel: Any) -> None:
        from rosbags.typesys import Stores, get_typestore

        self._node, self._make_channel, self._store = node, make_channel, get_typestore(Stores.ROS2_JAZZY)
        self.topics: dict[str, str] = {}
        """The types of the topics that are passed on."""
        self.left_out: dict[str, str] = {}
        """The types of the others, which are unknown here."""

    def look(self) -> None:
        """Subscribe to topics that are new."""
        for topic, (kind, *_) in self._node.get_topic_names_and_types():
            if topic in self.topics or topic in self.left_out:
                continue
            try:
                found, (text, _) = message_type(kind), self._store.generate_msgdef(kind, ros_version=2)
            except (ValueError, KeyError):
                self.left_out[topic] = kind
                continue
            log = self._make_channel(topic, kind, text).log
            self._node.create_subscription(found, topic, lambda raw, log=log: log(bytes(cast(Any, raw))), SENSOR, raw=True)
            self.topics[topic] = kind


@answered
def foxglove(argv: Any = None) -> int:
    """Serve the live graph to Foxglove until Ctrl-C."""
    parser = parser_of("foxglove", "Serve the live graph to Foxglove: open connection, Foxglove WebSocket, ws://HOST:PORT.")
    parser.add_argument("--port", type=int, default=PORT, help=f"port of the server (default: {PORT})")
    parser.add_argument("--host", default="127.0.0.1", help="address; 0.0.0.0 serves the network (default: 127.0.0.1)")
    parser.add_argument("--seconds", type=float, default=0.0, help="end after this time, s (default: never)")
    options = parser.parse_args(argv)
    try:
        import foxglove as sdk
    except ImportError as error:
        raise ValueError("foxglove-sdk is missing: pip install foxglove-sdk.") from error

    sdk.set_log_level("ERROR")  # a client that leaves is no event for this terminal

    def channel(topic: str, kind: str, definition: str) -> Any:
        schema = sdk.Schema(name=kind, encoding="ros2msg", data=definition.encode())
        return sdk.Channel(topic, schema=schema, message_encoding="cdr")

    try:
        server = sdk.start_server(host=options.host, port=options.port, name="turtlebot_gym")
    except RuntimeError as error:
        raise ValueError(f"no server on {options.host}:{options.port}: {error}.") from error
    print(f"ws://{options.host}:{server.port}", flush=True)
    try:
        with asking() as node:
            relay, began, known, told = Relay(node, channel), time.monotonic(), 0, False
            while not (options.seconds and time.monotonic() > began + options.seconds):
                relay.look()
                if not told and time.monotonic() > began + WAIT and (remark := remark_if_alone(node)):
                    told = True
                    print(remark.strip(), file=sys.stderr, flush=True)
                if len(relay.topics) != known:
                    known = len(relay.topics)
                    print(f"{known} topics", flush=True)
                for topic in [name for name, kind in relay.left_out.items() if kind]:
                    print(f"left out: {topic}, whose type {relay.left_out[topic]} is unknown here.", file=sys.stderr)
                    relay.left_out[topic] = ""
                end = time.monotonic() + LOOK
                while time.monotonic() < end:
                    go_on()
                    time.sleep(0.05)
    finally:
        server.stop()
    return 0
