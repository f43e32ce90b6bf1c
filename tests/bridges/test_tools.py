"""The tools for a graph without ros2cli: real processes that ask and tell a live graph."""

import signal
import time

import pytest
from std_msgs.msg import Bool

from cmd_vel_guard.session import INTERRUPTED
from turtlebot_gym_ros.tools.foxglove import Relay


@pytest.fixture
def ask(launch, runner):
    """Run a tool, and return its exit code, output and errors."""
    domain = str(runner.context.get_domain_id())

    def run(*words, end=None):
        process = launch("-m", "turtlebot_gym_ros", *words, ROS_DOMAIN_ID=domain)
        if end:
            end(process)
        out, error = process.communicate(timeout=60)
        assert "Traceback" not in error
        return process.returncode, out, error

    return run


def test_a_button_speaks_until_it_ends(ask, peer):
    heard = peer.hear("robot2/emergency_stop", Bool)

    def press(process):
        peer_heard(lambda: len(heard) > 10, seconds=30.0)
        process.send_signal(signal.SIGINT)

    assert ask("button", "robot2/emergency_stop", end=press)[0] == INTERRUPTED
    assert not any(message.data for message in heard)


def peer_heard(found, seconds=10.0):
    end = time.monotonic() + seconds
    while not found():
        assert time.monotonic() < end
        time.sleep(0.05)


def test_the_relay_passes_messages_on_as_they_came_and_names_unknown_types(runner, peer):
    logged = []

    class Channel:
        def __init__(self, topic, kind, definition):
            self.topic, self.definition = topic, definition

        def log(self, message):
            logged.append((self.topic, message, self.definition))

    relay = Relay(peer.node, Channel)
    speak = peer.speak("said", Bool)
    peer_heard(lambda: (relay.look(), "/said" in relay.topics)[1])
    peer_heard(lambda: (speak.publish(Bool(data=True)), logged)[1])
    topic, message, definition = logged[0]
    assert (topic, definition.strip().splitlines()[-1]) == ("/said", "bool data")
    from rclpy.serialization import deserialize_message

    assert deserialize_message(message, Bool).data
