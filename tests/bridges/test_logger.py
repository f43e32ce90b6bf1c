"""The logger and the tools: a bag holds what another subscriber saw, also after a kill; a button, and a relay."""

import signal
import sqlite3
import sys
import time
from contextlib import closing
from types import SimpleNamespace

import pytest
from nav_msgs.msg import Goals, Odometry
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from rosbags.highlevel import AnyReader
from std_msgs.msg import Bool, String

from cmd_vel_guard.qos import LATCHED
from cmd_vel_guard.session import INTERRUPTED
from turtlebot_gym_ros.base.names import message_type
from turtlebot_gym_ros.tools.foxglove import Relay

DEEP = QoSProfile(depth=1000)
BEST_EFFORT = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)


@pytest.fixture
def process(launch, monkeypatch):
    monkeypatch.setenv("AMENT_PREFIX_PATH", sys.prefix)
    return launch("-m", "turtlebot_gym_ros", "data_logger", "--ros-args", "-p", "output:=run")


def test_holds_every_message_that_another_subscriber_saw(process, peer, make_runner, wait_for, tmp_path):
    listener = type(peer)(make_runner(), "listener")
    odom, goals = peer.speak("odom", Odometry), peer.speak("goals", Goals)
    note = peer.speak("note", String, LATCHED)
    note.publish(String(data="said before anybody listened"))
    heard = {
        "/odom": listener.hear("odom", Odometry, DEEP),
        "/goals": listener.hear("goals", Goals, BEST_EFFORT),
        "/note": listener.hear("note", String, LATCHED),
    }
    wait_for(lambda: all(publisher.get_subscription_count() > 1 for publisher in (odom, goals, note)))
    for k in range(300):
        message = Odometry()
        message.header.stamp.sec = k
        odom.publish(message)
        goals.publish(Goals(header=message.header))
        wait_for(lambda k=k: len(heard["/odom"]) > k)
    wait_for(lambda: heard["/goals"] and heard["/note"])
    process.send_signal(signal.SIGINT)
    assert process.wait(10.0) == 0
    held = {}
    with AnyReader([tmp_path / "run"]) as reader:
        for connection, _, data in reader.messages():
            reader.deserialize(data, connection.msgtype)  # the definition is in the bag, and fits
            held.setdefault(connection.topic, []).append(deserialize_message(data, message_type(connection.msgtype)))
    assert len(heard["/odom"]) == 300
    assert held["/odom"] == heard["/odom"]
    assert held["/note"] == heard["/note"]
    assert [message.header.stamp.sec for message in held["/goals"]] == list(range(300))
    seen = {message.header.stamp.sec for message in heard["/goals"]}  # by best effort, so perhaps not all
    assert [message for message in held["/goals"] if message.header.stamp.sec in seen] == heard["/goals"]
    assert "/rosout" in held  # nobody asked for it


def test_a_kill_loses_at_most_the_last_second(process, peer, wait_for, tmp_path):
    speaker, sent = peer.speak("text", String, DEEP), []
    wait_for(speaker.get_subscription_count)

    def speak():
        sent.append((time.monotonic(), String(data=f"{len(sent)}")))
        speaker.publish(sent[-1][1])

    peer.node.create_timer(0.02, speak)
    wait_for(lambda: len(sent) > 170)
    killed = time.monotonic()
    process.kill()
    process.wait()
    with closing(sqlite3.connect(tmp_path / "run" / "run.db3")) as connection:  # which takes back an unfinished transaction
        rows = connection.execute("SELECT data FROM messages JOIN topics ON topic_id = topics.id WHERE name = '/text'")
        held = [deserialize_message(data, String) for (data,) in rows]
    assert held == [message for _, message in sent[: len(held)]]
    # The commit comes each second, 0.5 s late on a very busy machine.
    assert len(held) >= sum(moment < killed - 1.5 for moment, _ in sent) > 50


def test_a_button_speaks_until_it_ends(launch, runner, peer, wait_for):
    heard = peer.hear("robot2/emergency_stop", Bool)
    domain = str(runner.context.get_domain_id())
    process = launch("-m", "turtlebot_gym_ros", "button", "robot2/emergency_stop", ROS_DOMAIN_ID=domain)
    wait_for(lambda: len(heard) > 10)
    process.send_signal(signal.SIGINT)
    assert process.wait(10.0) == INTERRUPTED
    assert not any(message.data for message in heard)


def test_the_relay_passes_messages_on_as_they_came(peer, wait_for):
    logged = []

    def channel(topic, kind, definition):
        return SimpleNamespace(log=lambda message: logged.append((topic, message, definition)))

    relay, speak = Relay(peer.node, channel), peer.speak("said", Bool)
    wait_for(lambda: (relay.look(), "/said" in relay.topics)[1])
    wait_for(lambda: (speak.publish(Bool(data=True)), logged)[1])
    topic, message, definition = logged[0]
    assert (topic, definition.strip().splitlines()[-1]) == ("/said", "bool data")
    assert deserialize_message(message, Bool).data
