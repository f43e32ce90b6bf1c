"""``foxglove``: the live graph as a server for Foxglove (Studio or app.foxglove.dev), without ``foxglove_bridge``."""

from __future__ import annotations

from typing import Any, cast

from rclpy.node import Node

from cmd_vel_guard.qos import SENSOR
from turtlebot_gym_ros.base.names import message_type
from turtlebot_gym_ros.tools.asking import answered, asking, listen, parser_of

LOOK = 0.5
"""How often new topics are looked for, s."""
PORT = 8765
"""The port that Foxglove suggests."""


class Relay:
    """Passes every topic of known type on to a Foxglove server, message by message, as it came.

    ``make_channel(topic, kind, definition)`` returns an object whose ``log`` takes a message's bytes.
    """

    def __init__(self, node: Node, make_channel: Any) -> None:
        from rosbags.typesys import Stores, get_typestore

        self._node, self._make_channel, self._store = node, make_channel, get_typestore(Stores.ROS2_JAZZY)
        self.topics: dict[str, str] = {}
        """What is known of each topic: its type, or that it is left out."""

    def look(self) -> None:
        """Subscribe to topics that are new, and print them."""
        for topic, (kind, *_) in self._node.get_topic_names_and_types():
            if topic in self.topics:
                continue
            self.topics[topic] = kind
            try:
                found, (text, _) = message_type(kind), self._store.generate_msgdef(kind, ros_version=2)
            except (ValueError, KeyError):
                self.topics[topic] = f"left out, since {kind} is unknown here"
            else:
                log = self._make_channel(topic, kind, text).log
                self._node.create_subscription(found, topic, lambda raw, log=log: log(bytes(cast(Any, raw))), SENSOR, raw=True)
            print(f"{topic}: {self.topics[topic]}", flush=True)


@answered
def foxglove(argv: Any = None) -> int:
    """Serve the live graph to Foxglove until Ctrl-C."""
    parser = parser_of("foxglove", "Serve the live graph to Foxglove: open connection, Foxglove WebSocket, ws://HOST:PORT.")
    parser.add_argument("--port", type=int, default=PORT, help=f"port of the server (default: {PORT})")
    parser.add_argument("--host", default="127.0.0.1", help="address; 0.0.0.0 serves the network (default: 127.0.0.1)")
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
            relay = Relay(node, channel)
            while True:
                relay.look()
                listen(LOOK)
    finally:
        server.stop()
