"""The help of guard and standby lists the topics and services that the nodes have."""

import pytest
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

from cmd_vel_guard.guard import CmdVelGuard
from cmd_vel_guard.help import TOPICS, help_of
from cmd_vel_guard.sources import type_name
from cmd_vel_guard.standby import CmdVelStandby

ON = {
    "max_linear": 0.2,
    "max_angular": 1.0,
    "wheel_separation": 0.2,
    "radius": 0.1,
    "geofence": 2.0,
    "geofence_topic": "estimate",
    "require_standby": True,
    "heed_disagreement": True,
    "collision_monitor": True,
}
"""Parameters with which the guard has all its topics."""


@pytest.mark.parametrize(("make", "given"), [(CmdVelGuard, ON), (CmdVelStandby, {})])
def test_the_help_lists_the_topics_and_services_of_the_node(runner, monkeypatch, make, given):
    parameters = [Parameter(name, value=value) for name, value in given.items()]
    init = Node.__init__
    monkeypatch.setattr(
        Node, "__init__", lambda node, *words, **named: init(node, *words, parameter_overrides=parameters, **named)
    )
    node = make(runner.context)
    live = rows_of(node)
    name = node.get_name()
    node.destroy_node()
    live.discard(("subscribes", "/emergency_stop", "std_msgs/msg/Bool", "best effort"))  # beside the reliable one
    shown = {
        (topic.verb, "/" + topic.name.replace("~", name).lstrip("/"), topic.kind, topic.quality)
        for topic in TOPICS[name]
        if not topic.kind.startswith("tf2_msgs") or any(row[2] == topic.kind for row in live)
    }
    assert shown == live


@pytest.mark.parametrize("name", TOPICS)
def test_the_help_says_first_what_the_node_does_and_is_short(monkeypatch, name):
    monkeypatch.delenv("COLUMNS", raising=False)
    text = help_of(name, "python -m cmd_vel_guard")
    assert text.startswith(f"usage: python -m cmd_vel_guard {name} [--ros-args")
    assert "/cmd_vel" in text.split("\n\n")[1]
    assert len(text.splitlines()) <= 60


def rows_of(node):
    """Return the topics and services of a node, without those that every node of ROS has."""
    rows = set()
    for verb, ends in (("publishes", node.publishers), ("subscribes", node.subscriptions)):
        for end in ends:
            reliable = end.qos_profile.reliability == ReliabilityPolicy.RELIABLE
            latched = end.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
            quality = "latched" if latched else "reliable" if reliable else "best effort"
            rows.add((verb, end.topic_name, type_name(end.msg_type), quality))
    for service in node.services:
        rows.add(("serves", node.resolve_service_name(service.srv_name), type_name(service.srv_type), ""))
    return {row for row in rows if row[1] not in ("/rosout", "/parameter_events") and "_interfaces/" not in row[2]}
