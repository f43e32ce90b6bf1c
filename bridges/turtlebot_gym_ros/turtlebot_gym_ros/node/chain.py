"""Find the node that has not answered a step: a plant that has waited long listens to the topics from its outputs to its
inputs."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Mapping, Sequence

from rclpy.node import Node
from rclpy.subscription import Subscription

from cmd_vel_guard.sources import node_name
from turtlebot_gym_ros.base.qos import LOCK_STEP
from turtlebot_gym_ros.node.convert import conversion
from turtlebot_gym_ros.node.feed import Feed
from turtlebot_gym_ros.node.triggers import SECOND

LISTEN = 5
"""Number of checks between the start of listening and the report, in which the outputs are sent again twice."""


class Chain:
    """The topics between a plant's outputs and inputs; subscribed only while an answer is missing.

    Args:
        node: The plant's node.
        topics: These topics in order, with their value types.
        answers: The inputs at the end of the chain.
    """

    def __init__(self, node: Node, topics: Mapping[str, type], answers: Sequence[Feed]) -> None:
        self._node, self._answers = node, answers
        self._kinds = {node.resolve_topic_name(topic): conversion(kind).message for topic, kind in topics.items()}
        self._subscriptions: list[Subscription] = []
        self._newest: dict[str, int | None] = {}
        self._looks = 0
        self.missing: str | None = None
        """Description of the node that has not answered."""

    def watch(self, stamp: int | None) -> None:
        """Check for missing answers; call this every 0.1 s.

        Args:
            stamp: Stamp of the step that has not been answered for long; None if there is none.
        """
        if stamp is None:
            self._stop()
            return
        if not self._looks:
            self._newest = dict.fromkeys(self._kinds)
            self._subscriptions = [self._listen(topic, kind) for topic, kind in self._kinds.items()]
        self._looks += 1
        if self._looks < LISTEN:
            return
        heard = self._newest | {feed.topic: feed.stamp for feed in self._answers}
        speakers = {topic: [node_name(info) for info in self._node.get_publishers_info_by_topic(topic)] for topic in heard}
        missing = _missing_link(stamp, heard, speakers)
        if missing != self.missing:
            self._node.get_logger().warning(f"time stands still: {missing}.")
        self.missing = missing

    def _listen(self, topic: str, kind: type) -> Subscription:
        def hear(data: bytes) -> None:
            seconds, nanoseconds = struct.unpack_from("<iI", data, 4)  # CDR: four bytes of its own, then the header's stamp
            self._newest[topic] = seconds * SECOND + nanoseconds

        return self._node.create_subscription(kind, topic, hear, LOCK_STEP, raw=True)

    def _stop(self) -> None:
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)
        if self.missing:
            self._node.get_logger().info("time goes on.")
        self._subscriptions, self._looks, self.missing = [], 0, None


def _missing_link(stamp: int, heard: Mapping[str, int | None], speakers: Mapping[str, Iterable[str]]) -> str:
    """Describe which node has not answered a step.

    Args:
        stamp: Stamp of the step, ns.
        heard: Newest stamp on each topic of the chain, in its order, ns.
        speakers: Publishers of each topic.
    """
    topic = next((topic for topic, newest in heard.items() if newest != stamp), None)
    if topic is None:
        return f"waits for the recorder, which has not heard the steps up to {stamp / SECOND:.3f} s"
    names = ", ".join(sorted(speakers[topic]))
    waits = f"waits for {topic} of the step at {stamp / SECOND:.3f} s"
    return f"{waits}: {names} has not answered" if names else f"{waits}: nobody publishes it"
