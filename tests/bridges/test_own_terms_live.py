"""A policy that reads a bumper drives at a live node while the bumper's topic speaks, and stands when that says nothing."""

import os
import time
from dataclasses import replace
from pathlib import Path

import own_terms
import pytest
from bench import node, odometry
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, TwistStamped
from nav_msgs.msg import Odometry
from std_msgs.msg import Bool

from turtlebot_gym_agents.policies.bundle import term_on
from turtlebot_gym_ros.blocks.controller import _input_of

TOUCHY = """
import numpy as np


def drive(observations):
    '''Drive ahead, or back where the bumper touches something.'''
    touches = np.asarray(observations)[..., -1:]
    return np.concatenate([0.5 - touches, 0.0 * touches], axis=-1)


drive.terms = ("goal", "own_terms:BUMPER")
"""
"""A policy that reads a term of a user's own, whose module is beside it."""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "touchy.py").write_text(TOUCHY)
    (tmp_path / "own_terms.py").write_text((Path(__file__).parents[1] / "core" / "own_terms.py").read_text())
    return tmp_path


def test_the_bumpers_topic_moves_the_robot_and_its_silence_stops_it(peer, launch, wait_for, folder):
    commands, reports = peer.hear("cmd_vel", TwistStamped), peer.hear("/diagnostics", DiagnosticArray)
    estimates, goals = peer.speak("estimate", Odometry), peer.speak("reference", PoseStamped)
    bumps = peer.speak("bumper", Bool)
    path = os.pathsep.join([str(folder), *filter(None, [os.environ.get("PYTHONPATH")])])
    launch(*node("velocity_controller", "policy:=touchy:drive", "start_enabled:=true"), PYTHONPATH=path)
    wait_for(lambda: estimates.get_subscription_count() and bumps.get_subscription_count())

    def drive(until, touches):
        deadline = time.monotonic() + 20.0
        while not until() and time.monotonic() < deadline:
            message = odometry()
            message.header.stamp = peer.node.get_clock().now().to_msg()
            for k in (0, 7, 14, 21, 28, 35):
                message.pose.covariance[k] = message.twist.covariance[k] = 0.01
            goal = PoseStamped()
            goal.header, goal.pose.position.x, goal.pose.orientation.w = message.header, 2.0, 1.0
            goals.publish(goal)
            if touches is not None:
                bumps.publish(Bool(data=touches))
            estimates.publish(message)
            time.sleep(0.1)
        assert until(), [status.message for report in reports[-3:] for status in report.status]

    drive(lambda: commands and commands[-1].twist.linear.x > 0.05, False)
    drive(lambda: commands[-1].twist.linear.x < -0.05, True)
    drive(lambda: commands[-1].twist.linear.x == 0.0, None)
    late = "/bumper is older than 0.5 s"
    drive(lambda: any(late in status.message for report in reports for status in report.status), None)


def bundle_term(name, low, high, source=""):
    """Return a term as a bundle's card has it."""
    return term_on("a.onnx", {"name": name, "low": low, "high": high, "source": source})


NAMED = {term.name: replace(term, source=f"own_terms:{term.name.upper()}") for term in (own_terms.BUMPER, own_terms.GAPS)}


def test_a_bundles_term_is_brought_by_the_topic_that_a_person_names():
    source = _input_of(bundle_term("bumper", [0.0], [1.0]), NAMED)
    assert (source.topic, source.message, source.max_age, source.lasts) == ("bumper", "std_msgs/msg/Bool", 0.5, 0.0)
    assert source.read(Bool(data=True)) == (1.0,)
    slow = _input_of(replace(own_terms.BUMPER, lasts=3.0), {})
    assert (slow.max_age, slow.lasts) == (0.5, 2.5)
