"""Nodes as processes: what they refuse, how they end, and that the last thing they say is zero."""

import os
import signal
import time
from threading import Event
from types import SimpleNamespace

import pytest
from bench import node
from geometry_msgs.msg import PoseStamped, TwistStamped
from nav_msgs.msg import Odometry
from rclpy.time import Time
from std_msgs.msg import Header, String
from std_srvs.srv import Trigger

from turtlebot_gym.estimation.ekf import Estimate
from turtlebot_gym.values import Belief, Covariance, Pose, State
from turtlebot_gym_ros import Graph
from turtlebot_gym_ros.__main__ import HELP, main
from turtlebot_gym_ros.base.process import be_interruptible, go_on
from turtlebot_gym_ros.base.qos import LATCHED
from turtlebot_gym_ros.field.session import _follow
from turtlebot_gym_ros.graph.watch import View, Watcher
from turtlebot_gym_ros.node.convert import conversion
from turtlebot_gym_ros.nodes import NODES

POLICIES = """
import time
import numpy as np

def ahead(observation):
    return np.array([0.5, 0.0], np.float32)

def blocks(observation, calls=[]):
    calls.append(1)
    if len(calls) > 3:
        time.sleep(3600.0)
    return ahead(observation)
"""


def test_help_lists_the_nodes_and_what_a_person_must_know(capsys):
    assert main(["--help"]) == 0
    out = capsys.readouterr().out
    assert all(f"  {name} " in out for name in NODES)
    assert "Only policies such as vfh see obstacles" in HELP


@pytest.mark.parametrize("name", ["velocity_controller", "turtlebot_simulator", "kalman_filter"])
def test_a_node_explains_itself(capsys, name):
    assert main([name, "--help"]) == 0
    assert "Inputs:" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("argv", "said"),
    [
        (["flight_controller"], "there is no node 'flight_controller'"),
        (["bringp"], "Did you mean 'bringup'?"),
        (["velocity_controller", "--ros-args", "-p", "policy:=clever"], "clever"),
        (["velocity_controller", "--ros-args", "-p", "polcy:=bearing"], "did you mean policy?"),
        (["turtlebot_simulator", "--ros-args", "-p", "speed:=0"], "speed must be positive"),
        (["simulated_teleop", "--ros-args", "-p", "lock_step:=true"], "lock_step must be false"),
        (["kalman_filter", "--ros-args", "-p", "lock_step:=true", "-p", "twist:=commanded"], "lock_step must be false"),
        (["kalman_filter", "--ros-args", "-p", "filter"], "parse"),
        (["kalman_filter", "filter:=matched"], "unknown argument 'filter:=matched'"),
        (["kalman_filter", "quickly"], "unknown argument 'quickly'"),
        (["bringup", "--policy", "nope.onnx"], "No such file or directory: 'nope.onnx'"),
        (["bringup", "--seed", "-1"], "--seed must be a whole number from 0 to"),
        (["bringup", "--duration", "nan"], "--duration must be a positive number from 1e-15 to 1e+09, or infinite, got nan"),
        (["bringup", "--figure", "drive.jpg"], "drive.jpg: its name must end with .png or .pdf or .svg"),
        (["bringup", "--json", "/proc/none/drive.json"], "/proc/none"),
    ],
)
def test_what_is_wrong_is_one_clear_line_and_exit_code_2(capsys, argv, said):
    assert main(argv) == 2
    captured = capsys.readouterr()
    (line,) = captured.err.splitlines()
    assert line.startswith("error: ")
    assert said in line
    assert not captured.out


def test_the_exit_code_is_the_process_own(launch, peer):
    process = launch(*node("waypoint_generator", "waypoint:=square"))
    assert process.wait(30) == 2
    assert "did you mean waypoints?" in process.stderr.read()
    assert not peer.node.count_publishers("reference")


class Swallowing:
    """Whose destructor swallows an interruption."""

    def __del__(self):
        signal.raise_signal(signal.SIGINT)


WAITS = {
    "a field test's drive": lambda: _follow(lambda: "active", lambda: True, 30.0),
    "a graph": lambda: Graph(policy="bearing").wait_until(lambda graph: False, timeout=30.0),
    "a view without a row": lambda: Watcher.wait(SimpleNamespace(_begun=Event())),
    "a view": lambda: View.stay(SimpleNamespace()) or go_on(),
}


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("wait", WAITS.values(), ids=WAITS)
def test_a_wait_ends_at_an_interruption_that_a_destructor_has_swallowed(monkeypatch, wait):
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGALRM)}
    monkeypatch.setattr("turtlebot_gym_ros.base.process._interrupted", Event())
    be_interruptible()
    signal.signal(signal.SIGALRM, lambda *_: pytest.fail("it waits on"))
    signal.alarm(30)
    try:
        Swallowing()
        with pytest.raises(KeyboardInterrupt):
            wait()
    finally:
        signal.alarm(0)
        for number, handler in before.items():
            signal.signal(number, handler)


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
        estimate = Estimate(Belief(State(0.0, 0.0, 0.0, 0.0, 0.0), Covariance(*[0.01] * 15)), 0.0, 0.0)
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


@pytest.mark.parametrize("number", [pytest.param(signal.SIGINT, marks=pytest.mark.nightly), signal.SIGTERM])
def test_the_last_word_of_a_controller_that_is_asked_to_end_is_zero(launch, world, tmp_path, number):
    process = launch(*node("velocity_controller", "policy:=policies:ahead", "start_enabled:=true"), PYTHONPATH=path(tmp_path))
    world.until(lambda: len(world.commands) > 5)
    process.send_signal(number)
    assert process.wait(30) == 0
    world.wait_for(lambda: world.speeds[-1] == 0.0)
    first = world.speeds.index(0.0)
    assert min(world.speeds[:first]) > 0.1
    assert set(world.speeds[first:]) == {0.0}


def test_a_blocked_policy_stops_the_robot_and_holds_up_no_end(launch, world, tmp_path):
    process = launch(*node("velocity_controller", "policy:=policies:blocks", "start_enabled:=true"), PYTHONPATH=path(tmp_path))
    world.until(lambda: 0.0 in world.speeds)
    world.wait_for(lambda: world.states[-1].data.startswith("silent: fault: a step takes longer"))
    assert set(world.speeds[world.speeds.index(0.0) :]) == {0.0}
    process.send_signal(signal.SIGTERM)
    assert process.wait(30) == 0


def test_a_node_whose_callback_fails_ends_with_an_error(launch, peer, wait_for):
    fails = "from turtlebot_gym_ros.node import shell; shell.Shell._serve_reset = lambda *_: 1 / 0"
    process = launch("-c", f"{fails}\nfrom turtlebot_gym_ros.__main__ import main\nmain(['kalman_filter'])")
    client = peer.node.create_client(Trigger, "kalman_filter/reset")
    wait_for(client.service_is_ready)
    wait_for(lambda: client.call_async(Trigger.Request()) and process.poll() is not None)
    assert process.returncode == 1
    assert "ZeroDivisionError" in process.stderr.read()


def path(folder):
    return os.pathsep.join(filter(None, [str(folder), os.environ.get("PYTHONPATH", "")]))
