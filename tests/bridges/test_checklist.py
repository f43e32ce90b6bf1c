"""The checklist of the deploy page, carried out with the tools of this package alone, on a simulated robot behind the guard.

The numbers in the comments are the steps of the page. Wheels off the ground, a tape measure and a hand before the LiDAR are the
simulator's true state and its room.
"""

import signal
from pathlib import Path

import pytest
from nav_msgs.msg import Odometry

from cmd_vel_guard.qos import SENSOR

pytestmark = pytest.mark.slow

ROBOT = Path(__file__).parents[2] / "bridges/turtlebot_gym_ros/config/robot.yaml"
WORDS = {
    "turtlebot_simulator": ["-p", "noise:=wheel"],
    "cmd_vel_guard": ["-p", "collision_monitor:=false"],  # on open ground nothing is scanned
    "velocity_controller": ["-r", "cmd_vel:=cmd_vel_in"],
}
GUARDS = ("cmd_vel_guard", "cmd_vel_standby")
LOOP = ("kalman_filter", "waypoint_generator", "velocity_controller")


class Robot:
    """A simulated robot and its nodes as processes, and the tools that ask and tell them."""

    def __init__(self, launch, domain, peer, wait_for):
        self._launch, self._domain, self.until, self.nodes = launch, domain, wait_for, {}
        self.odometry = peer.hear("odom", Odometry, SENSOR)

    def start(self, name):
        given = [] if name == "turtlebot_simulator" else ["--params-file", str(ROBOT)]
        self.nodes[name] = self.tool(name, "--ros-args", *given, *WORDS.get(name, []))

    def tool(self, *words):
        package = "cmd_vel_guard" if words[0] in GUARDS else "turtlebot_gym_ros"
        return self._launch("-m", package, *words, ROS_DOMAIN_ID=self._domain)

    def ask(self, *words):
        """Run a tool, and return its exit code and what it says."""
        process = self.tool(*words)
        said = "".join(process.communicate(timeout=60))
        return process.returncode, said

    def moves(self):
        twist = self.odometry[-1].twist.twist if self.odometry else Odometry().twist.twist
        return abs(twist.linear.x) + abs(twist.angular.z) > 0.01

    def push(self):
        """Hold an emergency stop that is not pressed, and let the policy drive."""
        button = self.tool("button")
        for name in ("cmd_vel_guard", "velocity_controller"):
            self.until(lambda name=name: self.ask("enable", name)[0] == 0)
        self.until(self.moves)
        return button

    def stands(self, button=None):
        self.until(lambda: not self.moves())
        if button:
            button.send_signal(signal.SIGINT)
            button.wait(10)


def test_what_stops_the_wheels(launch, runner, peer, wait_for):
    robot = Robot(launch, str(runner.context.get_domain_id()), peer, wait_for)
    for name in ("turtlebot_simulator", *GUARDS, *LOOP):
        robot.start(name)
    ends = ("publishes: /cmd_vel_guard", "publishes: /cmd_vel_standby", "subscribes: /turtlebot_simulator")
    wait_for(lambda: all(end in robot.ask("topics", "cmd_vel")[1] for end in ends))  # 1
    assert robot.ask("enable", "cmd_vel_guard")[0] == 2  # without a button
    wait_for(lambda: " error " not in robot.ask("status")[1])  # 2
    assert "DiagnosticStatus" in robot.ask("topics", "diagnostics")[1]
    button = robot.push()  # 3
    assert robot.ask("enable", "velocity_controller", "--off")[0] == 0
    robot.stands(button)
    button = robot.push()  # 4
    button.send_signal(signal.SIGINT)
    robot.stands()
    assert robot.ask("enable", "cmd_vel_guard")[0] == 2
