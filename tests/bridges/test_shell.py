"""The shell around small blocks: what it owns for all nodes, on real DDS, and two sources of one input."""

import itertools
import runpy
import time
from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.time import Time
from std_msgs.msg import Empty, String

from cmd_vel_guard import reports
from turtlebot_gym_ros import Shell
from turtlebot_gym_ros.base.executor import FastGroup
from turtlebot_gym_ros.blocks.kalman_filter import FIX
from turtlebot_gym_ros.blocks.localizer import MAP_INPUT
from turtlebot_gym_ros.blocks.waypoints import ROOM_GOAL
from turtlebot_gym_ros.node.block import SCAN
from turtlebot_gym_ros.node.geometry import half_turn
from turtlebot_gym_ros.nodes import BLOCKS, load

EXAMPLE = Path(__file__).parents[2] / "bridges/turtlebot_gym_ros/examples/face_east.py"


@pytest.mark.parametrize("stamped", [True, False])
def test_the_same_block_is_a_node(runner, peer, wait_for, stamped):
    example, kind = runpy.run_path(EXAMPLE), TwistStamped if stamped else Twist
    odometry, commands = peer.speak("odom", Odometry), peer.hear("cmd_vel", kind)
    reports = peer.hear("/diagnostics", DiagnosticArray)
    overrides = {"gain": 2, "start_enabled": True, "enable_stamped_cmd_vel": stamped}  # an integer will do for a float
    runner.add(Shell(example["FaceEast"], example["Params"], context=runner.context, overrides=overrides))
    message, stamps = Odometry(), itertools.count(1)
    message.header.frame_id = "odom"
    orientation = message.pose.pose.orientation
    orientation.z, orientation.w = half_turn(0.5)

    def answered():
        message.header.stamp = Time(nanoseconds=next(stamps) * 100_000_000).to_msg()
        odometry.publish(message)
        time.sleep(0.01)
        return commands

    first = wait_for(answered)[0]
    assert (first.twist if stamped else first).angular.z == pytest.approx(-1.0, abs=1e-12)
    assert not stamped or first.header.frame_id == "base_footprint"
    wait_for(lambda: "face_east" in peer.node.get_node_names())  # names come by a topic of their own, later than data
    wait_for(lambda: reports and reports[-1].status[0].level == DiagnosticStatus.OK)


def test_intervals_are_exact_and_gaps_reset(bench):
    bench.drive()
    resets, count = bench.block.resets, bench.steps
    for dt in (0.1, 0.3, 0.05, 1.5, 0.1):
        bench.send(dt=dt)
    bench.wait_for(lambda: bench.steps == count + 5)
    assert bench.block.intervals[count:] == [0.1, 0.3, 0.05, 0.0, 0.1]
    assert bench.block.resets == resets + 1


def test_a_reset_of_the_plant_reaches_everybody(bench):
    reset = bench.peer.speak("reset", Empty)
    bench.wait_for(reset.get_subscription_count)
    bench.drive()
    resets = bench.block.resets
    reset.publish(Empty())
    bench.wait_for(lambda: bench.block.resets > resets)
    bench.wait_for(lambda: bench.state == "stopping: the plant was reset")
    bench.drive()


def test_each_input_that_moves_a_robot_has_one_source_but_for_what_persons_and_fixes_say():
    chain = [load(name) for name in BLOCKS if name != "turtlebot_simulator"]
    sometimes = (FIX, MAP_INPUT, ROOM_GOAL, SCAN)
    ends = {end.topic: end.sole for end in (*sometimes, *(end for block in chain for end in block.inputs.values()))}
    others = {"cmd_vel", "disagreement", "goal_pose", "initialpose", "map", "pose_fix", "resume"}
    assert {topic for topic, sole in ends.items() if not sole} == others
    assert {"estimate", "next_reference", "nis", "odom", "reference", "room_goal", "scan"} == ends.keys() - others


@pytest.mark.parametrize("group", [None, FastGroup])
def test_a_callback_that_fails_on_a_message_ends_nothing_and_is_counted_and_reported(peer, another_runner, wait_for, group):
    worker, heard = Node("worker", context=another_runner.context), []

    def hear(message):
        heard.append(message.data)
        if message.data != "good":
            raise OverflowError(message.data)

    worker.create_subscription(String, "work", hear, 10, callback_group=group and group(worker))
    another_runner.add(worker)
    publisher = peer.speak("work", String)
    wait_for(publisher.get_subscription_count)
    for text in ("x" * 100_000, "second", "good"):
        publisher.publish(String(data=text))
    wait_for(lambda: "good" in heard)
    report = lambda: reports.report(worker, reports.OK, "runs", hardware="", values={}).status[0]  # noqa: E731
    status = report()
    assert (status.level, len(status.message) < 300) == (reports.WARN, True)
    assert status.message.startswith("runs /work: refused: OverflowError: ")
    assert (status.values[0].key, status.values[0].value) == ("callbacks that failed", "2")
    assert (report().level, report().message) == (reports.OK, "runs")
