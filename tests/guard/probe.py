"""What stands around a guard's process: wheels, a program, a person, a button, a LiDAR, and a reader of the diagnostics."""

import math
import time

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Twist, TwistStamped
from rclpy.qos import qos_profile_sensor_data
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


def stamp(message, lead):
    """Stamp a message by a clock that is ahead by so many seconds."""
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(time.time_ns() + int(lead * 1e9), 10**9)


class Probe:
    """The surroundings of a guard, in its namespace.

    It publishes ``command`` on ``topic`` and ``pressed`` at 20 Hz and ``scan`` at 5 Hz, unless they are None. ``lead`` is that
    of the clock by which commands are stamped, s; with None they are not.
    """

    def __init__(self, peer, wait_for, *, name="", stamped=True, button="emergency_stop"):
        self.node, self._ask, self.until = peer.node, peer.ask, wait_for
        self._space = f"/{name}" if name else ""
        self.type = TwistStamped if stamped else Twist
        self.heard, self.sent, self.frames, self.reports = [], [], set(), []
        self.command, self.lead, self.topic = None, None, "cmd_vel_in"
        self.pressed, self.scan, self.scan_age = None, None, 0.0
        self.node.create_subscription(self.type, f"{self._space}/cmd_vel", self._hear, 1000)
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._read, 10)
        self._speakers = {
            topic: peer.speak(f"{self._space}/{topic}", self.type, 1) for topic in ("cmd_vel_in", "cmd_vel_teleop")
        }
        self._button = peer.speak(button if button.startswith("/") else f"{self._space}/{button}", Bool, 1)
        self._lidar = peer.speak(f"{self._space}/scan", LaserScan, qos_profile_sensor_data)
        self.node.create_timer(0.05, self._speak)
        self.node.create_timer(0.2, self._measure)

    def _hear(self, message, info):
        twist = message.twist if self.type is TwistStamped else message
        self.heard.append(Command(twist.linear.x, twist.angular.z))
        self.sent.append(info["source_timestamp"] * 1e-9)
        self.frames |= {message.header.frame_id} if self.type is TwistStamped else set()

    def _read(self, message):
        self.reports.extend(status for status in message.status if status.name == f"{self._space}/cmd_vel_guard")

    def _speak(self):
        if self.command is not None:
            message = self.type()
            twist = message.twist if self.type is TwistStamped else message
            twist.linear.x, twist.angular.z = self.command
            if self.lead is not None:
                stamp(message, self.lead)
            self._speakers[self.topic].publish(message)
        if self.pressed is not None:
            self.press(self.pressed)

    def press(self, pressed):
        """Let the button say once whether it is pressed."""
        self._button.publish(Bool(data=pressed))

    def _measure(self):
        scan = self.scan
        if scan is not None:
            noise = np.random.default_rng().normal(0.0, 1e-4, len(scan.ranges))  # a LiDAR that repeats itself is frozen
            scan.ranges = (np.asarray(scan.ranges) + noise).tolist()
            stamp(scan, -self.scan_age)
            self._lidar.publish(scan)

    def until_reported(self, *texts):
        """Wait until the guard reports something with all of these texts, and return the status."""
        self.reports.clear()
        return self.until(
            lambda: next((report for report in list(self.reports) if all(text in report.message for text in texts)), None)
        )

    def until_told(self, what):
        """Wait until the wheels receive a command for which a condition holds, and return it."""
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

    def stopped(self):
        """Return what the wheels received after they last moved."""
        return self.heard[max((k for k, command in enumerate(self.heard) if command != STOP), default=-1) + 1 :]

    def enable(self, on):
        return self._ask(f"{self._space}/cmd_vel_guard/enable", SetBool, SetBool.Request(data=on))
