"""The executor of the nodes goes on whatever other threads do to its entities, and nodes work in other executors, too."""

import pytest
from rcl_interfaces.msg import Parameter as ParameterMsg
from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import ListParameters, SetParameters
from rclpy.node import Node
from std_msgs.msg import String

from cmd_vel_guard import reports
from turtlebot_gym_ros.base.executor import FastGroup


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
