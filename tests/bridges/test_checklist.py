"""The checklist of the deploy page, carried out with the tools of this package alone, on a simulated robot behind the guard."""

import os
import signal
import time
from pathlib import Path

import pytest
import yaml

pytest.importorskip("cmd_vel_guard", reason="the guard is a satellite")

ROBOT = Path(__file__).parents[2] / "bridges/turtlebot_gym_ros/config/robot.yaml"
TOPICS = {"velocity_controller": ["-r", "cmd_vel:=cmd_vel_in"]}
NODES = ("cmd_vel_guard", "cmd_vel_standby", "kalman_filter", "waypoint_generator", "velocity_controller")


@pytest.fixture
def robot(launch, runner):
    """Start a robot and its nodes; returns them by name, and functions that start one, and that ask a tool."""
    domain = str(runner.context.get_domain_id())
    nodes = {}

    def start(name):
        words = (
            ["-p", "noise:=wheel"] if name == "turtlebot_simulator" else ["--params-file", str(ROBOT), *TOPICS.get(name, [])]
        )
        nodes[name] = launch("-m", "turtlebot_gym_ros", name, "--ros-args", *words, ROS_DOMAIN_ID=domain)

    def tool(*words):
        return launch("-m", "turtlebot_gym_ros", *words, ROS_DOMAIN_ID=domain)

    def ask(*words):
        process = tool(*words)
        out, error = process.communicate(timeout=60)
        return process.returncode, out + error

    for name in ("turtlebot_simulator", *NODES):
        start(name)
    return nodes, start, tool, ask


def speed(ask):
    """Return how fast the robot drives or turns, in its own unit."""
    code, out = ask("echo", "odom", "--once", "--field", "twist.twist")
    assert code == 0, out
    twist = yaml.safe_load(out.removesuffix("---\n"))
    return abs(twist["linear"]["x"]) + abs(twist["angular"]["z"])


def eventually(found, seconds=30.0):
    end = time.monotonic() + seconds
    while not (value := found()):
        assert time.monotonic() < end
        time.sleep(0.1)
    return value


@pytest.mark.nightly
def test_the_checklist(robot):
    nodes, start, tool, ask = robot

    def ends():
        """Return who is at /cmd_vel, as soon as all are."""
        text = ask("topics", "cmd_vel", "--verbose")[1]
        roles = ("publishes: /cmd_vel_guard", "publishes: /cmd_vel_standby", "subscribes: /turtlebot_simulator")
        return text if all(role in text for role in roles) else None

    kinds = {line.split("[")[1].split("]")[0] for line in eventually(ends).splitlines()}  # 1
    assert kinds == {"geometry_msgs/msg/TwistStamped"}
    code, out = ask("enable", "cmd_vel_guard")  # without a button
    assert code == 1, out

    def push():
        button = tool("pub", "--rate", "10", "emergency_stop", "std_msgs/msg/Bool", "{data: false}")
        eventually(lambda: ask("enable", "cmd_vel_guard")[0] == 0)
        eventually(lambda: ask("enable", "velocity_controller")[0] == 0)
        try:
            eventually(lambda: speed(ask) > 0.01)
        except AssertionError:
            pytest.fail(ask("status")[1])
        return button

    def stands():
        eventually(lambda: speed(ask) < 0.01)

    button = push()  # 3
    assert ask("enable", "velocity_controller", "--off")[0] == 0
    stands()
    button.send_signal(signal.SIGINT)
    button.wait(10)
    button = push()  # 4
    button.send_signal(signal.SIGINT)
    stands()
    assert ask("enable", "cmd_vel_guard")[0] == 1
    button = push()  # 5
    os.kill(nodes["velocity_controller"].pid, signal.SIGKILL)
    stands()
    start("velocity_controller")
    button.terminate()
    button = push()
    os.kill(nodes["cmd_vel_guard"].pid, signal.SIGKILL)
    stands()
    start("cmd_vel_guard")
    button.terminate()
    button = push()
    code, out = ask("hz", "odom", "--seconds", "2")  # 9
    assert code == 0, out
    os.kill(nodes["turtlebot_simulator"].pid, signal.SIGSTOP)  # 6: the robot's bring-up, and with it the odometry, is silent
    code, out = ask("echo", "diagnostics", "--once")  # 2
    assert code == 0, out
    eventually(lambda: "odom" in ask("status", "--seconds", "2")[1])
    os.kill(nodes["turtlebot_simulator"].pid, signal.SIGCONT)
    button.terminate()
