"""The scan at live nodes: it moves who sees by it, and what does not fit is refused on one line."""

import numpy as np
import pytest
from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import Odometry
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.time import Time
from sensor_msgs.msg import LaserScan, TimeReference

from turtlebot_gym_ros import Graph, Shell
from turtlebot_gym_ros.blocks import TurtlebotSimulator
from turtlebot_gym_ros.graph.bringup import room_metrics

SENSOR = QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT)
TENTH = 100_000_000


CONTACT = 9
"""Seed of a room in which the straight way to the goal is blocked, after 2.1 s."""


@pytest.mark.nightly
def test_the_simulators_scans_are_a_sensors(runner, peer, wait_for):
    """Best effort, five a second by their stamps, in a graph of real time."""
    overrides = {"world": "dense", "lidar": "lds01", "seed": 3}
    simulator = Shell(TurtlebotSimulator, TurtlebotSimulator.Params, context=runner.context, overrides=overrides)
    runner.add(simulator)
    scans = peer.hear("scan", LaserScan, SENSOR)
    wait_for(lambda: len(scans) > 5)
    (info,) = peer.node.get_publishers_info_by_topic("scan")
    assert info.qos_profile.reliability is ReliabilityPolicy.BEST_EFFORT
    assert peer.node.count_publishers("scan/newest") == 0
    assert {len(scan.ranges) for scan in scans} == {360}
    stamps = np.array([Time.from_msg(scan.header.stamp).nanoseconds for scan in scans])
    assert np.isin(np.diff(stamps), 2 * TENTH * np.arange(1, 50)).all()
    assert scans[0].header.frame_id == "base_scan"


@pytest.mark.nightly
def test_contact_is_reported_once_and_ends_the_episode(capfd):
    """A driver straight to the goal, in a room with an obstacle on the way."""
    with Graph(world="dense", policy="bearing", seed=CONTACT, goal_tolerance=0.0, speed=20.0) as graph:
        graph.wait_until(lambda graph: any("contact after 2.1 s" in text for _, text in graph.reports.values()))
        graph.wait_until(lambda graph: graph.time > 4.0)
        trajectory = graph.trajectory()
        ended = room_metrics(trajectory)
    assert (ended["collision"], ended["goal reached"], ended["end of the episode, s"]) == (True, False, pytest.approx(2.1))
    assert ended["least clearance, m"] < 0.0
    assert capfd.readouterr().err.count("contact after") == 1


@pytest.mark.nightly
def test_in_lock_step_a_scan_is_sent_again_until_its_step_and_the_next_are_answered(runner, peer, wait_for):
    """Who begins to listen late hears it all the same: lds01's second scan comes with the third step."""
    overrides = {"world": "dense", "lock_step": True, "speed": 0.0}
    runner.add(Shell(TurtlebotSimulator, TurtlebotSimulator.Params, context=runner.context, overrides=overrides))
    truths, commands = peer.hear("true_state", Odometry), peer.speak("cmd_vel", TwistStamped)
    wait_for(lambda: truths and commands.get_subscription_count())
    for k, scan_of in enumerate((0, 0, 2, 2)):
        step, expected = 10**9 + k * TENTH, 10**9 + scan_of * TENTH
        wait_for(lambda step=step: Time.from_msg(truths[-1].header.stamp).nanoseconds == step)
        scans, newest = peer.hear("scan", LaserScan), peer.hear("scan/newest", TimeReference)  # after the step began
        wait_for(lambda scans=scans, newest=newest: scans and newest)
        assert {Time.from_msg(scan.header.stamp).nanoseconds for scan in scans} == {expected}
        pairs = {
            tuple(Time.from_msg(stamp).nanoseconds for stamp in (reference.header.stamp, reference.time_ref))
            for reference in newest
        }
        assert pairs == {(step, expected)}
        commands.publish(TwistStamped(header=truths[-1].header))
