"""The checklist of the deploy page, carried out with the tools of this package alone, on a simulated robot behind the guard.

The numbers in the comments are the steps of the page. Wheels off the ground, a tape measure and a hand before the LiDAR are the
simulator's true state and its room; what delays the odometry or unplugs the LiDAR is a node of the test.
"""

import math
import os
import signal
import time
from collections import deque
from pathlib import Path

import pytest
import yaml
from bench import guarded
from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import Odometry
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import LaserScan

pytestmark = [pytest.mark.nightly, guarded]

ROBOT = Path(__file__).parents[2] / "bridges/turtlebot_gym_ros/config/robot.yaml"
TOPICS = {"velocity_controller": ["-r", "cmd_vel:=cmd_vel_in"]}
NODES = ("cmd_vel_guard", "cmd_vel_standby", "kalman_filter", "waypoint_generator", "velocity_controller")
SENSOR = QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT)


class Robot:
    """A simulated robot and its nodes as processes, and the tools that ask and tell them."""

    def __init__(self, launch, domain):
        self._launch, self._domain = launch, domain
        self.nodes = {}

    def start(self, name, *words):
        """Start a node, with the configuration of a robot."""
        given = [] if name == "turtlebot_simulator" else ["--params-file", str(ROBOT), *TOPICS.get(name, [])]
        if name == "turtlebot_simulator":
            words = ("-p", "noise:=wheel", *words)
        if name == "cmd_vel_guard" and "collision_monitor:=true" not in words:
            words = ("-p", "collision_monitor:=false", *words)  # on open ground nothing is scanned
        self.nodes[name] = self.tool(name, "--ros-args", *given, *words)

    def tool(self, *words):
        """Start a tool."""
        return self._launch("-m", "turtlebot_gym_ros", *words, ROS_DOMAIN_ID=self._domain)

    def ask(self, *words):
        """Run a tool, and return its exit code and what it says."""
        process = self.tool(*words)
        out, error = process.communicate(timeout=60)
        return process.returncode, out + error

    def field(self, topic, path):
        """Return a field of a topic's next message."""
        process = self.tool("echo", topic, "--once", "--field", path)
        out, error = process.communicate(timeout=60)
        assert process.returncode == 0, error
        return yaml.safe_load(out.removesuffix("---\n"))

    def speed(self):
        """Return how fast the robot drives or turns, in its own unit."""
        twist = self.field("odom", "twist.twist")
        return abs(twist["linear"]["x"]) + abs(twist["angular"]["z"])

    def place(self, topic="true_state"):
        """Return x, y and heading by a topic."""
        pose = self.field(topic, "pose.pose")
        position, turn = pose["position"], pose["orientation"]
        return position["x"], position["y"], 2.0 * math.atan2(turn["z"], turn["w"])

    def button(self):
        """Hold an emergency stop that is not pressed."""
        return self.tool("button")

    def enabled(self, *names):
        """Enable nodes, as soon as they may be."""
        for name in names:
            eventually(lambda name=name: self.ask("enable", name)[0] == 0)

    def drives(self):
        """Wait until the robot drives."""
        try:
            eventually(lambda: self.speed() > 0.01)
        except AssertionError:
            pytest.fail(self.ask("status")[1])

    def stands(self):
        """Wait until the robot stands, and require that it stays so."""
        eventually(lambda: self.speed() < 0.01)

    def push(self):
        """Let the policy drive."""
        button = self.button()
        self.enabled("cmd_vel_guard", "velocity_controller")
        self.drives()
        return button


@pytest.fixture
def robot(launch, runner):
    return Robot(launch, str(runner.context.get_domain_id()))


def eventually(found, seconds=40.0):
    end = time.monotonic() + seconds
    while not (value := found()):
        assert time.monotonic() < end
        time.sleep(0.1)
    return value


def end(process):
    process.send_signal(signal.SIGINT)
    process.wait(10)


def test_what_stops_the_wheels(robot, peer):
    commands = peer.hear("cmd_vel", TwistStamped, SENSOR)
    for name in ("turtlebot_simulator", *NODES):
        robot.start(name)

    def ends():
        """Return who is at /cmd_vel, as soon as all are."""
        text = robot.ask("topics", "cmd_vel", "--verbose")[1]
        roles = ("publishes: /cmd_vel_guard", "publishes: /cmd_vel_standby", "subscribes: /turtlebot_simulator")
        return text if all(role in text for role in roles) else None

    kinds = {line.split("[")[1].split("]")[0] for line in eventually(ends).splitlines()}  # 1
    assert kinds == {"geometry_msgs/msg/TwistStamped"}
    code, out = robot.ask("enable", "cmd_vel_guard")  # without a button
    assert code == 1, out
    eventually(lambda: " error " not in robot.ask("status")[1])  # 2
    assert robot.field("diagnostics", "status")

    button = robot.push()  # 3
    assert robot.ask("enable", "velocity_controller", "--off")[0] == 0
    robot.stands()
    end(button)
    button = robot.push()  # 4
    end(button)
    robot.stands()
    assert robot.ask("enable", "cmd_vel_guard")[0] == 1
    button = robot.push()  # 5
    os.kill(robot.nodes["velocity_controller"].pid, signal.SIGKILL)
    robot.stands()
    robot.start("velocity_controller")
    end(button)
    button = robot.push()
    os.kill(robot.nodes["cmd_vel_guard"].pid, signal.SIGKILL)
    robot.stands()
    robot.start("cmd_vel_guard")
    end(button)
    button = robot.push()
    os.kill(robot.nodes["cmd_vel_guard"].pid, signal.SIGSTOP)
    robot.stands()
    os.kill(robot.nodes["cmd_vel_guard"].pid, signal.SIGCONT)
    end(button)
    button = robot.push()
    os.kill(robot.nodes["turtlebot_simulator"].pid, signal.SIGSTOP)  # 6: the bring-up is silent, and the odometry with it

    def silent():
        """Return whether a listener that was there before hears nothing any more."""
        count = len(commands)
        time.sleep(2.0)
        return len(commands) == count

    eventually(silent)
    twist = commands[-1].twist
    assert (twist.linear.x, twist.angular.z) == (0.0, 0.0)
    os.kill(robot.nodes["turtlebot_simulator"].pid, signal.SIGCONT)
    end(button)


def test_late_odometry_stops_the_wheels_for_good(robot, peer):
    for name in ("turtlebot_simulator", *NODES):
        robot.start(name)
    button = robot.push()
    robot.nodes["kalman_filter"].terminate()
    late = peer.node.create_publisher(Odometry, "odom_late", 10)
    waiting = deque()

    def delay():
        """Publish what was heard a second ago."""
        while waiting and waiting[0][0] < time.monotonic() - 1.0:
            late.publish(waiting.popleft()[1])

    peer.node.create_subscription(Odometry, "odom", lambda message: waiting.append((time.monotonic(), message)), SENSOR)
    peer.node.create_timer(0.02, delay)
    robot.start("kalman_filter", "-r", "odom:=odom_late")  # 7
    robot.stands()
    for _ in range(3):
        assert robot.speed() < 0.01
    assert " s old" in eventually(lambda: text if " s old" in (text := robot.ask("status")[1]) else "")
    end(button)


def test_by_hand_the_odometry_is_right_and_the_monitor_stops_before_what_the_lidar_sees(robot, peer):
    robot.start("turtlebot_simulator", "-p", "world:=dense")
    robot.start("cmd_vel_guard", "-p", "collision_monitor:=true", "-r", "scan:=scan_seen")
    robot.start("cmd_vel_standby")
    seen, plugged = peer.node.create_publisher(LaserScan, "scan_seen", 10), [True]
    peer.node.create_subscription(LaserScan, "scan", lambda message: seen.publish(message) if plugged[0] else None, SENSOR)
    scans = peer.hear("scan", LaserScan, SENSOR)
    eventually(lambda: scans)
    scans.clear()
    time.sleep(2.0)
    assert 8 < len(scans) < 12  # 9
    wheels, speeds = peer.speak("cmd_vel_teleop", TwistStamped), [0.0, 0.0]

    def hand():
        """Drive by hand."""
        message = TwistStamped()
        message.twist.linear.x, message.twist.angular.z = speeds
        wheels.publish(message)

    button = robot.button()
    robot.enabled("cmd_vel_guard")
    true, told = robot.place(), robot.place("odom")

    speeds[0] = 0.15  # 8, 9, 10: ahead, until something is there
    driving = peer.node.create_timer(0.1, hand)
    robot.drives()
    robot.stands()
    assert math.dist(robot.place()[:2], true[:2]) == pytest.approx(math.dist(robot.place("odom")[:2], told[:2]), abs=0.1)
    assert 0.0 < robot.field("clearance", "range") < 0.2
    speeds[0] = -0.15  # 9: backwards, until something is behind
    robot.drives()
    plugged[0] = False  # 9: unplug the LiDAR
    robot.stands()
    plugged[0] = True
    eventually(lambda: robot.speed() > 0.01)
    robot.stands()
    assert 0.0 < robot.field("clearance", "range") < 0.2
    driving.cancel()
    before = robot.place("odom")[2]
    speeds[:] = 0.0, 0.1  # 8: turn left
    driving.reset()
    robot.drives()
    assert 0.0 < (robot.place("odom")[2] - before) % math.tau < math.pi
    end(button)


def test_the_policy_is_slow_and_stays_within_the_fence(robot, tmp_path):
    (tmp_path / "far.yaml").write_text("[[3.0, 0.0, 0.0]]\n")
    robot.start("turtlebot_simulator")
    robot.start("cmd_vel_guard", "-p", "speed_scale:=0.3", "-p", "geofence:=0.6")  # 11, with a smaller fence
    robot.start("waypoint_generator", "-p", f"waypoints:={tmp_path / 'far.yaml'}")
    for name in ("cmd_vel_standby", "kalman_filter", "velocity_controller"):
        robot.start(name)
    button = robot.push()
    assert robot.field("odom", "twist.twist.linear.x") < 0.3 * 0.22
    robot.stands()
    assert math.hypot(*robot.place("odom")[:2]) == pytest.approx(0.6, abs=0.1)
    assert "within 0.6 m of the origin" in robot.ask("status")[1]
    end(button)
