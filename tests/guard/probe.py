"""What stands around a guard's process: wheels, a program, a person, a button, a LiDAR, and a reader of the diagnostics."""

import math
import time

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import TwistStamped
from rclpy.qos import qos_profile_sensor_data
from rclpy.time import Time
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Bool
from std_srvs.srv import SetBool

from cmd_vel_guard.values import STOP, Command

AHEAD = Command(0.1, 0.2)


def laser(distance=math.inf, **fields):
    """A scan of a wall ahead, with some of its fields changed."""
    cosine = np.cos(2.0 * np.pi * np.arange(360) / 360)
    ranges = np.where(cosine > 0.01, distance / np.maximum(cosine, 0.01), np.inf)
    message = LaserScan(angle_min=0.0, angle_increment=2.0 * math.pi / 360, range_min=0.12, range_max=3.5)
    message.header.frame_id = "base_scan"
    message.ranges = np.minimum(ranges, 3.0).tolist()  # a round room: a LiDAR without returns is covered
    for name, value in fields.items():
        setattr(message, name, value)
    return message


class Probe:
    """Around a guard: ``command`` on ``topic`` and ``pressed`` at 20 Hz, ``scan`` at 5 Hz, unless they are None."""

    def __init__(self, peer, wait_for):
        self.node, self._ask, self.until = peer.node, peer.ask, wait_for
        self.heard, self.sent, self.reports = [], [], []
        self.command, self.topic = None, "cmd_vel_in"
        self.pressed, self.scan, self.scan_age = None, None, 0.0
        self.node.create_subscription(TwistStamped, "cmd_vel", self._hear, 1000)
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._read, 10)
        self._speakers = {topic: peer.speak(topic, TwistStamped, 1) for topic in ("cmd_vel_in", "cmd_vel_teleop")}
        self._button = peer.speak("emergency_stop", Bool, 1)
        self._lidar = peer.speak("scan", LaserScan, qos_profile_sensor_data)
        self.node.create_timer(0.05, self._speak)
        self.node.create_timer(0.2, self._measure)

    def _hear(self, message, info):
        self.heard.append(Command(message.twist.linear.x, message.twist.angular.z))
        self.sent.append(info["source_timestamp"] * 1e-9)

    def _read(self, message):
        self.reports.extend(status for status in message.status if status.name == "/cmd_vel_guard")

    def _speak(self):
        if self.command is not None:
            message = TwistStamped()
            message.twist.linear.x, message.twist.angular.z = self.command
            self._speakers[self.topic].publish(message)
        if self.pressed is not None:
            self.press(self.pressed)

    def press(self, pressed):
        self._button.publish(Bool(data=pressed))

    def _measure(self):
        scan = self.scan
        if scan is not None:
            noise = np.random.default_rng().normal(0.0, 1e-4, len(scan.ranges))  # a LiDAR that repeats itself is frozen
            scan.ranges = (np.asarray(scan.ranges) + noise).tolist()
            scan.header.stamp = Time(nanoseconds=time.time_ns() - int(self.scan_age * 1e9)).to_msg()
            self._lidar.publish(scan)

    def until_reported(self, *texts):
        self.reports.clear()
        return self.until(
            lambda: next((report for report in list(self.reports) if all(text in report.message for text in texts)), None)
        )

    def until_told(self, what):
        self.heard.clear()
        return self.until(lambda: next((command for command in list(self.heard) if what(command)), None))

    def until_driving(self):
        self.heard.clear()
        self.command = AHEAD
        self.until(self._drives)

    def _drives(self):
        if self.pressed is False:
            self.enable(True)  # again, where a busy machine kept the button silent for too long
            time.sleep(0.5)  # an enabled guard has forgotten what was said before
        return AHEAD in self.heard

    def until_standing(self, *why):
        """Wait until the guard says why the robot stands; from then on nothing moves."""
        status = self.until_reported(*why)
        self.heard.clear()
        time.sleep(0.5)
        assert set(self.heard) <= {STOP}
        return status

    def enable(self, on):
        return self._ask("cmd_vel_guard/enable", SetBool, SetBool.Request(data=on))
