"""The logger: what it keeps when it is killed, and that its bag holds whatever an independent subscriber saw."""

import signal
import sqlite3
import sys
import time
from contextlib import closing

import pytest
from nav_msgs.msg import Goals, Odometry
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from std_msgs.msg import String

pytestmark = pytest.mark.touched("bridges/turtlebot_gym_ros/turtlebot_gym_ros/recording", "tests/bridges/test_logger.py")

DEEP = QoSProfile(depth=1000)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
BEST_EFFORT = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)


def text(number, size=0):
    return String(data=f"{number}" + "x" * size)


def committed_in(database):
    """Return the texts in the database of a recorder that was killed; opening it takes back an unfinished transaction."""
    with closing(sqlite3.connect(database)) as connection:
        rows = connection.execute("SELECT data FROM messages JOIN topics ON topic_id = topics.id WHERE name = '/text'")
        return [deserialize_message(data, String) for (data,) in rows]


# Without ROS processes: what a kill leaves.


# The node: a process of its own, with talkers and an independent listener in this one, on real DDS.


@pytest.fixture
def start(launch, monkeypatch):
    """Start a logger as a process, with a change to its module if asked."""
    monkeypatch.setenv("AMENT_PREFIX_PATH", sys.prefix)

    def start(*arguments, change=""):
        program = f"from turtlebot_gym_ros.recording import logger\n{change}\nraise SystemExit(logger.main())"
        words = [word for argument in arguments for word in ("-p", argument)]
        return launch("-c", program, "--ros-args", "-p", "output:=run", *words)

    return start


@pytest.fixture
def matched(wait_for):
    def matched(*publishers, listeners=1):
        wait_for(lambda: all(publisher.get_subscription_count() >= listeners for publisher in publishers))

    return matched


@pytest.fixture
def listener(peer, third_runner):
    """A node with a context of its own."""
    return type(peer)(third_runner, "listener")


def end(process):
    process.send_signal(signal.SIGINT)
    _, stderr = process.communicate(timeout=10.0)
    assert process.returncode == 0
    return stderr


def test_holds_every_message_that_another_subscriber_saw(start, peer, listener, matched, wait_for, tmp_path, read_bag):
    process = start()
    odom, goals = peer.speak("odom", Odometry), peer.speak("goals", Goals)
    note = peer.speak("note", String, LATCHED)
    note.publish(String(data="said before anybody listened"))
    heard = {
        "/odom": listener.hear("odom", Odometry, DEEP),
        "/goals": listener.hear("goals", Goals, BEST_EFFORT),
        "/note": listener.hear("note", String, LATCHED),
    }
    matched(odom, goals, note, listeners=2)
    for k in range(300):
        message = Odometry()
        message.header.stamp.sec = k
        odom.publish(message)
        goals.publish(Goals(header=message.header))
        wait_for(lambda k=k: len(heard["/odom"]) > k)
    wait_for(lambda: heard["/goals"] and heard["/note"])
    end(process)
    held = read_bag(tmp_path / "run")
    assert len(heard["/odom"]) == 300
    assert held["/odom"] == heard["/odom"]
    assert held["/note"] == heard["/note"]
    assert [message.header.stamp.sec for message in held["/goals"]] == list(range(300))
    seen = {message.header.stamp.sec for message in heard["/goals"]}  # by best effort, so perhaps not all
    assert [message for message in held["/goals"] if message.header.stamp.sec in seen] == heard["/goals"]
    assert "/rosout" in held  # nobody asked for it


def publish_and_kill(process, peer, matched, wait_for):
    """Return what had been published, with its time, when the logger was killed; and when."""
    speaker = peer.speak("text", String, DEEP)
    matched(speaker)
    sent = []

    def speak():
        sent.append((time.monotonic(), text(len(sent))))
        speaker.publish(sent[-1][1])

    peer.node.create_timer(0.02, speak)
    wait_for(lambda: len(sent) > 170)
    killed = time.monotonic()
    process.kill()
    process.wait()
    return sent, killed


def test_a_kill_loses_at_most_the_last_second(start, peer, matched, wait_for, tmp_path):
    sent, killed = publish_and_kill(start(), peer, matched, wait_for)
    held = committed_in(tmp_path / "run" / "run.db3")
    assert held == [message for _, message in sent[: len(held)]]
    # The commit comes each second, 0.5 s late on a very busy machine.
    assert len(held) >= sum(moment < killed - 1.5 for moment, _ in sent) > 50
