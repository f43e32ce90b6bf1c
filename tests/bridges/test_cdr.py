"""Messages as bytes: rclpy reads what is written here, and whatever bytes arrive are read as rclpy reads them, or refused."""

import struct

import numpy as np
import pytest
from geometry_msgs.msg import TwistStamped
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.time import Time
from std_msgs.msg import Header

from turtlebot_gym import values
from turtlebot_gym.estimation.ekf import Estimate
from turtlebot_gym.values import Belief, Command, Covariance, Pose, State
from turtlebot_gym_ros.node import cdr
from turtlebot_gym_ros.node.block import Nis
from turtlebot_gym_ros.node.convert import conversion

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
