"""Messages that PyPI lacks, as they are built, and messages as bytes: rclpy reads what is written, and the other way round."""

import struct
import sys

import numpy as np
import pytest
from geometry_msgs.msg import TwistStamped
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.time import Time
from std_msgs.msg import Header

from turtlebot_gym import values
from turtlebot_gym.estimation.ekf import Estimate
from turtlebot_gym.values import Belief, Command, Covariance, Pose, State
from turtlebot_gym_ros import interfaces
from turtlebot_gym_ros.node import cdr
from turtlebot_gym_ros.node.block import Nis
from turtlebot_gym_ros.node.convert import conversion


def test_beside_a_ros_installation_it_names_the_packages(monkeypatch, capsys):
    monkeypatch.setattr(interfaces, "DISTRIBUTIONS", ())
    monkeypatch.setenv("ROS_DISTRO", "jazzy")
    monkeypatch.setattr(interfaces, "find_spec", lambda name: None)
    assert interfaces.main([]) == 2
    assert capsys.readouterr().err.endswith("sudo apt install ros-jazzy-nav2-msgs ros-jazzy-tf2-msgs.\n")


def test_without_its_tools_it_says_what_to_install(monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(ValueError, match=r"^cmake, make, g\+\+ missing: sudo apt install cmake g\+\+ make python3-dev$"):
        interfaces.build()


def test_where_the_messages_are_there_is_nothing_to_do(monkeypatch, capsys):
    monkeypatch.setattr(interfaces, "find_spec", lambda name: name)
    assert interfaces.main([]) == 0
    assert capsys.readouterr().out == "nav2_msgs and tf2_msgs are installed.\n"


def test_a_step_that_fails_shows_its_last_lines():
    with pytest.raises(ValueError, match=r"failed: .*no such step"):
        interfaces._run(sys.executable, "-c", "raise SystemExit('no such step')")


FIELDS = """
from nav2_msgs.action import NavigateToPose
from tf2_msgs.msg import TFMessage
for kind in (TFMessage, NavigateToPose.Goal, NavigateToPose.Result, NavigateToPose.Feedback):
    print(*(f"{kind} {name}" for name, kind in kind.get_fields_and_field_types().items()), sep="\\n")
"""


@pytest.mark.nightly
def test_the_built_types_have_the_fields_of_the_definition(launch, interfaces):
    from turtlebot_gym_ros.interfaces import definitions, installed_distribution

    out, err = launch("-c", FIELDS, **interfaces).communicate(timeout=60.0)
    texts = (text for _, text in definitions(installed_distribution()).values())
    wanted = [line for text in texts for line in text.splitlines() if line != "---"]
    said = [
        line.replace("sequence<geometry_msgs/TransformStamped>", "geometry_msgs/TransformStamped[]") for line in out.split("\n")
    ]
    assert [line.replace("float ", "float32 ") for line in said if line] == wanted, err


STAMP = 1_234_567_890_123_456_789
FRAMES = ["", *("robot_1/odom"[:n] for n in range(1, 12)), "Fuß"]
"""Names of all lengths modulo 8, as what follows is aligned."""


def some(rng):
    """Return a value of each kind that is read or written as bytes."""
    belief = Belief(State(*rng.normal(size=5).tolist()), Covariance(*rng.uniform(size=15).tolist()))
    poses = [values.Odometry(Pose(*belief.mean[:3]), Command(0.1, -0.2), measured) for measured in (True, False)]
    return [belief.mean, *poses, belief, Estimate(belief, 0.0, 0.0), Command(0.25, -1.5), Nis(1.5), Nis(40.0)]


@pytest.mark.parametrize("frame", FRAMES)
def test_bytes_say_the_same_to_rclpy_and_here(frame):
    for value in some(np.random.default_rng(len(frame))):
        way = conversion(type(value))
        by_rclpy = way.write(value, Header(stamp=Time(nanoseconds=STAMP).to_msg(), frame_id=frame))
        here = way.write(value, cdr.header(STAMP, frame))
        if hasattr(here, "child_frame_id"):
            by_rclpy.child_frame_id = here.child_frame_id = frame[::-1]
        data = cdr.write(way.message, here)
        assert deserialize_message(data, way.message) == by_rclpy
        read = cdr.read(way.message, serialize_message(by_rclpy))
        assert read == here
        assert way.read(read) == way.read(by_rclpy)


def test_numbers_may_be_big_endian():
    data = b"\0\0\0\0" + struct.pack(">iII12s6d", 5, 7, 5, b"odom", *range(1, 7))
    message = cdr.read(TwistStamped, data)
    assert (message.header.stamp.nanosec, message.header.frame_id, message.twist.angular.z) == (7, "odom", 6.0)


def test_bytes_that_end_too_early_are_refused():
    for value in some(np.random.default_rng(0)):
        way = conversion(type(value))
        data = cdr.write(way.message, way.write(value, cdr.header(STAMP, "odom")))
        for n in range(len(data)):
            with pytest.raises(ValueError, match=r"its .* bytes are no"):
                cdr.read(way.message, data[:n])
