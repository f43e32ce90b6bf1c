"""The checklist of the deploy page, carried out with the tools of this package alone, on a simulated robot behind the guard.

The numbers in the comments are the steps of the page. Wheels off the ground, a tape measure and a hand before the LiDAR are the
simulator's true state and its room; what delays the odometry or unplugs the LiDAR is a node of the test.
"""

import os
import signal
import time
from pathlib import Path

import pytest
from bench import guarded
from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import Odometry
from rclpy.qos import QoSProfile, ReliabilityPolicy

pytestmark = [pytest.mark.nightly, guarded]

ROBOT = Path(__file__).parents[2] / "bridges/turtlebot_gym_ros/config/robot.yaml"
TOPICS = {"velocity_controller": ["-r", "cmd_vel:=cmd_vel_in"]}
NODES = ("cmd_vel_guard", "cmd_vel_standby", "kalman_filter", "waypoint_generator", "velocity_controller")
SENSOR = QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT)


class Robot:
    """A simulated robot and its nodes as processes, and the tools that ask and tell them."""

    def __init__(self, launch, domain, peer):
        self._launch, self._domain = launch, domain
        self.odometry = peer.hear("odom", Odometry, SENSOR)
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

    def speed(self):
        """Return how fast the robot drives or turns, in its own unit."""
        seen = self.odometry[-1].twist.twist if self.odometry else Odometry().twist.twist
        return abs(seen.linear.x) + abs(seen.angular.z)

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
def robot(launch, runner, peer):
    return Robot(launch, str(runner.context.get_domain_id()), peer)


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
        text = robot.ask("topics", "cmd_vel")[1]
        roles = ("publishes: /cmd_vel_guard", "publishes: /cmd_vel_standby", "subscribes: /turtlebot_simulator")
        return text if all(role in text for role in roles) else None

    assert "/cmd_vel  [geometry_msgs/msg/TwistStamped]" in eventually(ends)  # 1
    code, out = robot.ask("enable", "cmd_vel_guard")  # without a button
    assert code == 2, out
    eventually(lambda: " error " not in robot.ask("status")[1])  # 2
    assert "DiagnosticStatus" in robot.ask("topics", "diagnostics", "--once")[1]

    button = robot.push()  # 3
    assert robot.ask("enable", "velocity_controller", "--off")[0] == 0
    robot.stands()
    end(button)
    button = robot.push()  # 4
    end(button)
    robot.stands()
    assert robot.ask("enable", "cmd_vel_guard")[0] == 2
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
