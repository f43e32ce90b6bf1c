"""Two sources of one input: each node says so, and of two odometries none counts."""

from functools import partial

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry

from turtlebot_gym_ros import Shell
from turtlebot_gym_ros.nodes import load


def speaker(peer, topic, kind, name):
    """Publish a value each 50 ms from a node of its own; return its node and the publisher."""
    other = type(peer)(peer.runner, name)
    publisher = other.speak(topic, kind)

    def speak():
        message = kind()
        message.header.frame_id, message.header.stamp = "odom", other.node.get_clock().now().to_msg()
        getattr(message.pose, "pose", message.pose).orientation.w = 1.0
        publisher.publish(message)

    other.node.create_timer(0.05, speak)
    return other


@pytest.fixture
def said(peer):
    """Return the level and the text of the last report of a node."""
    reports = peer.hear("/diagnostics", DiagnosticArray)

    def said(node, level):
        return next((s.message for r in reversed(reports[-3:]) for s in r.status if s.name == node and s.level == level), "")

    return said


def test_of_two_odometries_none_counts_until_one_is_gone(runner, peer, another_runner, wait_for, said):
    peer.runner = another_runner
    block = load("kalman_filter")
    runner.add(Shell(block, block.Params, context=runner.context))
    estimates = peer.hear("estimate", Odometry)
    wheels = speaker(peer, "odom", Odometry, "wheels")
    wait_for(lambda: len(estimates) > 3)
    rival = speaker(peer, "odom", Odometry, "rival")
    error = partial(said, "/kalman_filter", DiagnosticStatus.ERROR)
    wait_for(lambda: "/odom: /rival and /wheels publish it: refused until there is one." in error())
    del estimates[:]
    wait_for(lambda: "2 nodes publish /odom, where one may" in said("/kalman_filter", DiagnosticStatus.ERROR) or error())
    assert not estimates
    rival.close()
    wait_for(lambda: len(estimates) > 3)
    assert wheels.node is not None


def test_a_second_source_of_any_input_is_reported(runner, peer, another_runner, wait_for, said):
    peer.runner = another_runner
    block = load("velocity_controller")
    runner.add(Shell(block, block.Params, context=runner.context))
    kinds = {"estimate": Odometry, "reference": PoseStamped, "next_reference": PoseStamped}
    for topic, kind in kinds.items():
        for name in ("first", "second"):
            speaker(peer, topic, kind, f"{name}_{topic}")
    for topic in kinds:
        text = f"/{topic}: /first_{topic} and /second_{topic} publish it: which of them counts is undefined."
        wait_for(lambda text=text: text in said("/velocity_controller", DiagnosticStatus.WARN))
