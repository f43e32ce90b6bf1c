"""Nodes as processes: what they refuse, how they end, and that the last thing they say is zero."""

import os
import signal
import time
from pathlib import Path

import pytest
from bench import POLICIES, node
from geometry_msgs.msg import PoseStamped, TwistStamped
from nav_msgs.msg import Odometry
from rclpy.time import Time
from std_msgs.msg import Header, String

from cmd_vel_guard.qos import LATCHED
from turtlebot_gym.estimation.ekf import Estimate
from turtlebot_gym.values import Belief, Covariance, Pose, State
from turtlebot_gym_ros.__main__ import main
from turtlebot_gym_ros.node.convert import conversion


@pytest.mark.parametrize(
    ("argv", "said"),
    [
        (["flight_controller"], "there is no node 'flight_controller'"),
        (["velocity_controller", "--ros-args", "-p", "polcy:=bearing"], "did you mean policy?"),
        (["turtlebot_simulator", "--ros-args", "-p", "speed:=0"], "speed must be 1"),
        (["simulated_teleop", "--ros-args", "-p", "lock_step:=true"], "lock_step must be false"),
        (["kalman_filter", "--ros-args", "-p", "lock_step:=true", "-p", "twist:=commanded"], "lock_step must be false"),
        (["kalman_filter", "filter:=matched"], "unknown argument 'filter:=matched'"),
        (["bringup", "--policy", "nope.onnx"], "No such file or directory: 'nope.onnx'"),
        (["bringup", "--seed", "-1"], "--seed must be a whole number from 0 to"),
        (["bringup", "--figure", "drive.jpg"], "drive.jpg: its name must end with .png or .pdf or .svg"),
    ],
)
def test_what_is_wrong_is_one_clear_line_and_exit_code_2(capsys, argv, said):
    assert main(argv) == 2
    captured = capsys.readouterr()
    (line,) = captured.err.splitlines()
    assert line.startswith("error: ")
    assert said in line
    assert not captured.out


class World:
    """Estimates and a reference for a controller in a process of its own, and ears for what it commands."""

    def __init__(self, peer, wait_for):
        self.wait_for = wait_for
        self.estimate, self.reference = peer.speak("estimate", Odometry), peer.speak("reference", PoseStamped)
        self.commands = peer.hear("cmd_vel", TwistStamped)
        self.states = peer.hear("velocity_controller/state", String, LATCHED)
        self.stamp = 0

    def tick(self):
        self.stamp += 100_000_000
        header = Header(stamp=Time(nanoseconds=self.stamp).to_msg(), frame_id="odom")
        estimate = Estimate(Belief(State(0.0, 0.0, 0.0, 0.0, 0.0), Covariance(*[0.01] * 8)), 0.0, 0.0)
        self.reference.publish(conversion(Pose).write(Pose(2.0, 0.0, 0.0), header))
        self.estimate.publish(conversion(Estimate).write(estimate, header))
        time.sleep(0.05)

    def until(self, what):
        self.wait_for(lambda: self.tick() or what())

    @property
    def speeds(self):
        return [message.twist.linear.x for message in self.commands]


@pytest.fixture
def world(peer, wait_for, tmp_path):
    (tmp_path / "policies.py").write_text(POLICIES)
    return World(peer, wait_for)


def test_the_last_word_of_a_controller_before_it_is_suspended_is_zero_and_then_it_needs_fresh_inputs(launch, world, tmp_path):
    process = launch(*node("velocity_controller", "policy:=policies:ahead", "start_enabled:=true"), PYTHONPATH=path(tmp_path))
    world.until(lambda: len(world.commands) > 5)
    process.send_signal(signal.SIGTSTP)
    world.wait_for(lambda: Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()[0] == "T")
    world.wait_for(lambda: world.speeds[-1] == 0.0)
    suspended = len(world.commands)
    process.send_signal(signal.SIGCONT)
    world.wait_for(lambda: world.states[-1].data.startswith("silent"))
    assert not any(world.speeds[suspended:])
    world.until(lambda: world.speeds[-1] > 0.1)


def path(folder):
    return os.pathsep.join(filter(None, [str(folder), os.environ.get("PYTHONPATH", "")]))
