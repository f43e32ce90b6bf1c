"""The executor of the nodes goes on whatever other threads do to its entities, and nodes work in other executors, too."""

import time

import pytest
from bench import NoParameters, odometry
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry
from rcl_interfaces.msg import Parameter as ParameterMsg
from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import ListParameters, SetParameters
from rclpy.executors import MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.node import Node
from std_msgs.msg import Header, String

from cmd_vel_guard import reports
from cmd_vel_guard.executor import PolledGroup
from cmd_vel_guard.process import Runner
from turtlebot_gym.values import Pose, State
from turtlebot_gym_ros import Input, On, Output, Shell
from turtlebot_gym_ros.base.executor import FastExecutor, FastGroup, take
from turtlebot_gym_ros.blocks.kalman_filter import KalmanFilter


def test_a_topic_that_nobody_waits_for_is_heard_when_it_is_taken(peer, another_runner, wait_for):
    heard = []
    subscription = peer.node.create_subscription(
        String,
        "polled",
        lambda message, info: heard.append(info["source_timestamp"]),
        10,
        callback_group=PolledGroup(),
    )
    publisher, others = peer.speak("polled", String), peer.hear("others", String)
    talker = peer.speak("others", String)
    wait_for(publisher.get_subscription_count)
    publisher.publish(String(data="there"))
    wait_for(lambda: talker.publish(String(data="there")) or len(others) > 5)
    assert heard == []
    wait_for(lambda: take(subscription, peer.node) or heard)


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


def test_a_request_that_rclpy_itself_cannot_read_is_answered_and_ends_nothing(peer, another_runner, wait_for):
    worker = Node("worker", context=another_runner.context)
    another_runner.add(worker)
    bad = ParameterMsg(name="x", value=ParameterValue(type=99))
    assert peer.ask("worker/set_parameters", SetParameters, SetParameters.Request(parameters=[bad])).results == []
    assert peer.ask("worker/list_parameters", ListParameters, ListParameters.Request()).result.names


@pytest.fixture(params=[SingleThreadedExecutor, MultiThreadedExecutor, FastExecutor])
def any_runner(request):
    runner = Runner(executor=request.param)
    runner.start()
    yield runner
    runner.close()


def test_a_filter_estimates_in_any_executor(any_runner, peer, wait_for):
    publisher, estimates = peer.speak("odom", Odometry), peer.hear("estimate", Odometry)
    any_runner.add(Shell(KalmanFilter, KalmanFilter.Params, context=any_runner.context))
    wait_for(lambda: publisher.publish(odometry()) or len(estimates) > 10)


class Follower:
    """Says where the last goal is, which wakes nobody, whenever odometry comes; two steps at once would be a fault."""

    trigger = On("odometry")
    inputs = {"odometry": Input(topic="odom", type=State), "goal": Input(topic="goal", type=Pose, wakes=False, required=False)}
    outputs = {"seen": Output(topic="seen", type=Pose)}
    Params = NoParameters
    running = False

    def __init__(self, params):
        self.reset()

    def reset(self):
        assert not self.running

    def step(self, dt, odometry, goal):
        assert not self.running
        self.running = True
        time.sleep(0.001)
        self.running = False
        return {} if goal is None else {"seen": goal}


def test_no_two_steps_run_at_once_in_an_executor_with_many_threads(peer, wait_for):
    runner = Runner(executor=MultiThreadedExecutor)
    try:
        runner.start()
        runner.add(shell := Shell(Follower, NoParameters, context=runner.context))
        goals, moves, seen = peer.speak("goal", PoseStamped), peer.speak("odom", Odometry), peer.hear("seen", PoseStamped)
        goal = PoseStamped(header=Header(frame_id="odom"))
        goal.pose.orientation.w = 1.0
        wait_for(lambda: goals.publish(goal) or moves.publish(odometry()) or len(seen) > 10)
        assert shell._trouble is None
    finally:
        runner.close()
