"""The collision monitor in the guard's real process, on real DDS: scans at 5 Hz, commands from a person and from a program."""

import math
import time

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import TwistStamped
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import LaserScan

from turtlebot_gym.values import STOP, Command

AHEAD, BACK = Command(0.15, 0.3), Command(-0.1, 0.0)


def laser(distance=math.inf, **fields):
    """A scan of a wall ahead, with some of its fields changed."""
    cosine = np.cos(2.0 * np.pi * np.arange(360) / 360)
    ranges = np.where(cosine > 0.01, distance / np.maximum(cosine, 0.01), np.inf)
    message = LaserScan(angle_min=0.0, angle_increment=2.0 * math.pi / 360, range_min=0.12, range_max=3.5)
    message.header.frame_id = "base_scan"
    message.ranges = ranges.tolist()
    for name, value in fields.items():
        setattr(message, name, value)
    return message


class Room:
    """A LiDAR, whoever commands, the wheels, and whoever reads the diagnostics."""

    def __init__(self, peer, wait_for):
        self.node, self.until = peer.node, wait_for
        self.heard, self.reports = [], []
        self.scan, self.command, self.topic, self.old = None, None, "cmd_vel_teleop", 0
        self.node.create_subscription(TwistStamped, "cmd_vel", self._hear, 1000)
        self.node.create_subscription(DiagnosticArray, "/diagnostics", lambda m: self.reports.extend(m.status), 10)
        self.speakers = {topic: peer.speak(topic, TwistStamped, 1) for topic in ("cmd_vel_teleop", "cmd_vel_in")}
        self.lidar = peer.speak("scan", LaserScan, qos_profile_sensor_data)
        self.node.create_timer(0.05, self._speak)
        self.node.create_timer(0.2, self._measure)

    def _hear(self, message):
        self.heard.append(Command(message.twist.linear.x, message.twist.angular.z))

    def _speak(self):
        if self.command is not None:
            message = TwistStamped()
            message.twist.linear.x, message.twist.angular.z = self.command
            self.speakers[self.topic].publish(message)

    def _measure(self):
        scan = self.scan
        if scan is not None:
            scan.header.stamp.sec, nanoseconds = divmod(time.time_ns() - int(self.old * 1e9), 10**9)
            scan.header.stamp.nanosec = nanoseconds
            self.lidar.publish(scan)

    def until_told(self, what):
        self.heard.clear()
        return self.until(lambda: next((each for each in list(self.heard) if what(each)), None))

    def until_reported(self, text):
        self.reports.clear()
        return self.until(lambda: next((status for status in list(self.reports) if text in status.message), None))

    def until_driving(self):
        self.scan, self.command, self.old = laser(), AHEAD, 0
        self.until_told(lambda each: each == AHEAD)

    def until_standing(self, why):
        """Wait until the guard says why it stands; from then on nothing moves."""
        status = self.until_reported(why)
        self.heard.clear()
        time.sleep(0.5)
        assert set(self.heard) <= {STOP}
        return status


@pytest.fixture
def room(peer, wait_for):
    return Room(peer, wait_for)


@pytest.fixture
def guard(launch):
    return launch("-m", "turtlebot_gym_ros", "cmd_vel_guard", "--ros-args", "-p", "collision_monitor:=true")


def test_commands_are_limited_by_what_the_lidar_sees_and_need_its_scans(guard, room):
    room.command = AHEAD
    assert room.until_standing("/scan: no scan has arrived").level == DiagnosticStatus.ERROR
    assert set(room.heard) <= {STOP}
    room.until_driving()
    for room.topic in ("cmd_vel_teleop", "cmd_vel_in"):
        # 0.3 m from the LiDAR, 0.292 m from the footprint's centre: less the radius, the margin and the error, in one second.
        room.scan = laser(0.3)
        who = "teleop" if room.topic == "cmd_vel_teleop" else "program"
        status = room.until_reported(f"{who}, collision monitor: slowed down: an obstacle is ahead")
        assert status.level == DiagnosticStatus.WARN
        v, omega = room.until_told(lambda each: each.v > 0.02)
        assert v <= 0.292 - 0.105 - 0.05 - 0.085 * 0.3 + 1e-6
        assert omega / v == pytest.approx(0.3 / 0.15)
        room.scan = laser(0.16)
        room.until_standing("stopped: an obstacle is in the stop zone")
        room.command = BACK
        room.until_told(lambda each: each.v == pytest.approx(-0.05, abs=1e-9))
        assert min(each.v for each in room.heard) > -0.0501
        room.until_driving()
    room.scan = None
    room.until_standing("the last scan is older than 0.4 s; the robot stands")
    room.until_driving()
    room.old = 0.7  # by its stamp, which may be that of the first beam, 0.2 s before the last
    room.until_standing("the last scan is older than 0.4 s")
    room.old = 0.5
    room.until_told(lambda each: each != STOP)
    room.until_driving()
    assert guard.poll() is None


BAD = {
    "ranges that are NaN": {"ranges": [1.0, math.nan] * 180},
    "no ranges": {"ranges": []},
    "an angle_increment of 0 rad": {"angle_increment": 0.0},
    "range_min must be in [0, range_max)": {"range_min": 4.0},
    "angle_min is nan": {"angle_min": math.nan},
    "angle_increment is inf": {"angle_increment": math.inf},
    "range_max is inf": {"range_max": math.inf},
    "its frame is 'rplidar_link', not 'base_scan'": {},
}


def test_bad_scans_stop_the_robot_with_one_report_and_do_not_end_the_guard(guard, room):
    for why, fields in BAD.items():
        room.until_driving()
        room.scan = laser(**fields)
        if not fields:
            room.scan.header.frame_id = "rplidar_link"
        status = room.until_standing(why)
        assert status.level == DiagnosticStatus.ERROR
        assert status.message.startswith("collision monitor: /scan: a scan was refused: ")
        assert "\n" not in status.message
    room.until_driving()
    assert guard.poll() is None
