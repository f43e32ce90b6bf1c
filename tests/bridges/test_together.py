"""Nodes in one process: each keeps its parameters, services and refusals, and the guard, in its own process, outlives them."""

import os
import signal

import pytest
from bench import POLICIES, guarded, node, odometry
from burger import WORDS
from geometry_msgs.msg import PoseStamped, TwistStamped
from nav_msgs.msg import Odometry
from rcl_interfaces.srv import GetParameters
from std_msgs.msg import String
from std_srvs.srv import SetBool

from cmd_vel_guard.qos import LATCHED
from turtlebot_gym_ros.__main__ import main

pytestmark = guarded


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (["kalman_filter", "cmd_vel_guard"], "cmd_vel_guard runs in a process of its own"),
        (["cmd_vel_guard", "kalman_filter"], "cmd_vel_guard runs in a process of its own"),
        (["kalman_filter", "cmd_vel_standby"], "cmd_vel_standby runs in a process of its own"),
        (["kalman_filter", "data_logger"], "data_logger runs in a process of its own"),
        (["kalman_filter", "velocity_controller", "kalman_filter"], "kalman_filter is named twice"),
        (["kalman_filter", "velocity_controller", "quickly"], "unknown argument 'quickly'"),
        (["kalman_filter", "velocity_controller", "--ros-args", "-p", "policy:=bearing"], "kalman_filter has no parameter"),
        (["kalman_filter", "velocity_controller", "--ros-args", "-r", "__node:=one"], "two nodes are called /one"),
    ],
)
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_what_cannot_share_a_process_is_refused_in_one_line(capfd, names, said):
    assert main(names) == 2
    *_, line = capfd.readouterr().err.splitlines()
    assert line.startswith("error: ")
    assert said in line


class Robot:
    """A robot with a guard on its wheels, and filter and controller in one process."""

    def __init__(self, launch, peer, wait_for, folder, policy):
        (folder / "policies.py").write_text(POLICIES)
        self.ask, self.wait_for = peer.ask, wait_for
        self._odometry, self._reference = peer.speak("odom", Odometry), peer.speak("reference", PoseStamped)
        self.states = peer.hear("velocity_controller/state", String, LATCHED)
        self.wheels = peer.hear("cmd_vel", TwistStamped)
        self.guard = launch(*node("cmd_vel_guard", *WORDS[1::2], "start_enabled:=true"))
        words = ["-r", "velocity_controller:cmd_vel:=cmd_vel_in"]
        path = os.pathsep.join(filter(None, [str(folder), os.environ.get("PYTHONPATH", "")]))
        _, _, name, *arguments = node("kalman_filter", f"velocity_controller:policy:=policies:{policy}", words=words)
        self.nodes = launch("-m", "turtlebot_gym_ros", name, "velocity_controller", *arguments, PYTHONPATH=path)

    def until(self, what):
        def tick():
            goal = PoseStamped()
            message = odometry()
            goal.header, goal.pose.position.x, goal.pose.orientation.w = message.header, 2.0, 1.0
            self._reference.publish(goal)
            self._odometry.publish(message)
            return what()

        self.wait_for(tick)

    @property
    def speeds(self):
        return [message.twist.linear.x for message in self.wheels]

    def drive(self):
        """Enable the controller, and wait for a motion."""
        self.until(lambda: self.states and self.states[-1].data.startswith("silent: not enabled"))
        assert not any(self.speeds)
        assert self.ask("velocity_controller/enable", SetBool, SetBool.Request(data=True)).success
        self.until(lambda: self.speeds[-1] > 0.1)


@pytest.fixture
def robot(launch, peer, wait_for, tmp_path):
    return lambda policy: Robot(launch, peer, wait_for, tmp_path, policy)


def test_nodes_in_one_process_keep_their_parameters_and_the_guard_outlives_them(robot):
    driving = robot("ahead")
    driving.drive()
    for name, parameter, value in (("kalman_filter", "filter", "matched"), ("velocity_controller", "policy", "policies:ahead")):
        response = driving.ask(f"{name}/get_parameters", GetParameters, GetParameters.Request(names=[parameter]))
        assert response.values[0].string_value == value
    driving.nodes.send_signal(signal.SIGKILL)
    driving.wait_for(lambda: driving.speeds[-1] == 0.0)
    assert driving.guard.poll() is None


def test_the_last_word_of_nodes_that_are_asked_to_end_is_zero(robot):
    driving = robot("ahead")
    driving.drive()
    driving.nodes.terminate()
    assert driving.nodes.wait(30) == 0
    driving.wait_for(lambda: driving.speeds[-1] == 0.0)
