"""Nodes as processes: what they refuse, how they end, and that the last thing they say is zero."""

import os
import signal
import time
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from bench import POLICIES, node
from geometry_msgs.msg import PoseStamped, TwistStamped
from nav_msgs.msg import Odometry
from rclpy.time import Time
from std_msgs.msg import Header, String
from std_srvs.srv import Trigger
from swallowed import require_end

from cmd_vel_guard.qos import LATCHED
from cmd_vel_guard.session import ENDINGS, INTERRUPTED
from turtlebot_gym.estimation.ekf import Estimate
from turtlebot_gym.values import Belief, Covariance, Pose, State
from turtlebot_gym_ros import Graph
from turtlebot_gym_ros.__main__ import main
from turtlebot_gym_ros.graph import bringup
from turtlebot_gym_ros.node.convert import conversion
from turtlebot_gym_ros.nodes import NODES

FILTERS = """
import numpy as np

class Tired:
    calls = 0

    def __init__(self, tuning):
        self.x, self.P = np.zeros(5), np.eye(5)

    def predict(self, *arguments, **named):
        Tired.calls += 1
        if Tired.calls > 8:
            raise RuntimeError("tired")

    def update(self, *arguments, **named):
        pass
"""


def test_help_lists_the_nodes_and_what_a_person_must_know(capsys):
    assert main(["--help"]) == 0
    out = capsys.readouterr().out
    assert all(f"  {name} " in out for name in NODES)
    assert "Only policies such as vfh see obstacles" in out


@pytest.mark.parametrize("name", ["velocity_controller", "turtlebot_simulator", "kalman_filter"])
def test_a_node_explains_itself(capsys, name):
    assert main([name, "--help"]) == 0
    assert "\nInputs: " in capsys.readouterr().out


@pytest.mark.parametrize(
    ("argv", "said"),
    [
        (["flight_controller"], "there is no node 'flight_controller'"),
        (["bringp"], "Did you mean 'bringup'?"),
        (["velocity_controller", "--ros-args", "-p", "policy:=clever"], "clever"),
        (["velocity_controller", "--ros-args", "-p", "polcy:=bearing"], "did you mean policy?"),
        (["turtlebot_simulator", "--ros-args", "-p", "speed:=0"], "speed must be 1"),
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


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_a_wait_ends_at_an_interruption_that_a_destructor_has_swallowed(monkeypatch):
    require_end(monkeypatch, lambda: Graph(policy="bearing").wait_until(lambda graph: False, timeout=30.0))


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


OTHERS = [number for number in ENDINGS if number != signal.SIGHUP]


@pytest.mark.parametrize("number", [signal.SIGHUP, *(pytest.param(number, marks=pytest.mark.nightly) for number in OTHERS)])
@pytest.mark.usefixtures("hangs_up")
def test_the_last_word_of_a_controller_that_is_asked_to_end_is_zero(launch, world, tmp_path, number):
    process = launch(*node("velocity_controller", "policy:=policies:ahead", "start_enabled:=true"), PYTHONPATH=path(tmp_path))
    world.until(lambda: len(world.commands) > 5)
    process.send_signal(number)
    assert process.wait(30) == 0
    world.wait_for(lambda: world.speeds[-1] == 0.0)
    first = world.speeds.index(0.0)
    assert min(world.speeds[:first]) > 0.1
    assert set(world.speeds[first:]) == {0.0}


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


def test_a_node_under_nohup_outlives_its_terminal(launch, peer, wait_for):
    become = "os.execv(sys.executable, [sys.executable, *sys.argv[1:]])"
    ignoring = f"import os, signal, sys; signal.signal(signal.SIGHUP, signal.SIG_IGN); {become}"
    process = launch("-c", ignoring, *node("waypoint_generator"))
    wait_for(lambda: peer.node.count_publishers("reference"))
    process.send_signal(signal.SIGHUP)
    time.sleep(0.5)
    assert process.poll() is None


def test_nodes_end_with_the_program_that_started_them_even_if_it_is_killed(launch, peer, wait_for):
    commands = peer.hear("cmd_vel", TwistStamped)
    program = launch("-m", "turtlebot_gym_ros", "bringup", "--processes", "--duration", "3600", "--speed", "1")
    wait_for(lambda: any(message.twist.linear.x for message in list(commands)))
    family = [int(child) for child in Path(f"/proc/{program.pid}/task/{program.pid}/children").read_text().split()]
    assert len(family) == 4
    program.kill()
    wait_for(lambda: not any(Path(f"/proc/{child}").exists() for child in family))
    assert commands[-1].twist.linear.x == 0.0


def test_ctrl_c_ends_a_graph_with_one_word_and_a_shells_exit_code_from_the_first_import_on(launch, peer, wait_for):
    for until in (lambda: time.sleep(0.6) or True, lambda: peer.node.count_publishers("velocity_controller/state")):
        program = launch("-m", "turtlebot_gym_ros", "bringup", "--duration", "3600")
        wait_for(until)
        program.send_signal(signal.SIGINT)
        _, said = program.communicate(timeout=30)
        assert program.returncode == INTERRUPTED == 130
        assert [line for line in said.splitlines() if not line.startswith("[")] == ["interrupted"]


FAULTS = {
    "raises": "ValueError: too clever",
    "exits": "SystemExit: 3",
    "invents": "finite numbers, got nan",
    "shouts": "of shape",
}
MODES = {"lock-step": [], "real time": ["--speed", "1"], "processes": ["--processes"]}
DAILY = [("raises", "lock-step"), ("exits", "lock-step"), ("shouts", "real time")]
LATER = [(policy, mode) for policy in FAULTS for mode in MODES if (policy, mode) not in DAILY]


@pytest.mark.parametrize(("policy", "mode"), [*DAILY, *(pytest.param(*case, marks=pytest.mark.nightly) for case in LATER)])
def test_a_policy_that_fails_ends_a_drive_with_its_error(launch, tmp_path, policy, mode):
    """The program finds the policy in its working folder; a policy may fail in its first step."""
    (tmp_path / "policies.py").write_text(POLICIES)
    words = ["bringup", "--duration", "5", "--policy", f"policies:{policy}", *MODES[mode]]
    program = launch("-m", "turtlebot_gym_ros", *words)
    _, said = program.communicate(timeout=40)
    assert program.returncode == 2
    last = said.splitlines()[-1]
    assert last.startswith("error: velocity_controller is s")
    assert FAULTS[policy] in last


@pytest.mark.nightly
@pytest.mark.parametrize("mode", MODES)
def test_a_filter_that_fails_ends_a_drive_with_its_error(launch, tmp_path, mode):
    (tmp_path / "filters.py").write_text(FILTERS)
    words = ["bringup", "--duration", "20", "--filter", "filters:Tired", *MODES[mode]]
    _, said = (program := launch("-m", "turtlebot_gym_ros", *words)).communicate(timeout=60)
    assert program.returncode == 2
    assert said.splitlines()[-1].startswith(
        "error: kalman_filter reports fault: ValueError: filters:Tired: RuntimeError: tired ("
    )


def test_a_drive_whose_time_stands_still_ends_with_an_error():
    is_over, graph = (
        bringup._GraphEnd(1.0),
        SimpleNamespace(time=0.5, state="active", reports={"kalman_filter": (0, "runs")}, require_no_fault=lambda: None),
    )
    for _ in range(bringup.LOOKS + 1):
        assert not is_over(graph)
    with pytest.raises(RuntimeError, match=r"stood still for 60 s.*kalman_filter.*runs"):
        is_over(graph)
    graph.time = 1.0
    assert is_over(graph)


def test_a_drive_of_nothing_is_an_error(monkeypatch, capsys):
    unknown = np.full((3, 5), np.nan)
    drive = SimpleNamespace(time=np.arange(3.0), true_state=unknown, estimate=unknown, odometry=unknown[:, :3])
    graph = SimpleNamespace(wait_until=lambda *_, **__: None, trajectory=lambda: drive, latest={})
    monkeypatch.setattr(bringup, "Graph", lambda **_: nullcontext(graph))
    monkeypatch.setattr(bringup, "be_interruptible", lambda: None)
    assert bringup.main([]) == 2
    assert capsys.readouterr().err == f"error: {bringup.NOTHING}\n"


def test_a_blocked_policy_stops_the_robot_and_holds_up_no_end(launch, world, tmp_path):
    process = launch(*node("velocity_controller", "policy:=policies:blocks", "start_enabled:=true"), PYTHONPATH=path(tmp_path))
    world.until(lambda: 0.0 in world.speeds)
    world.wait_for(lambda: world.states[-1].data.startswith("silent: fault: a step takes longer"))
    assert set(world.speeds[world.speeds.index(0.0) :]) == {0.0}
    process.send_signal(signal.SIGTERM)
    assert process.wait(30) == 0


def test_a_request_whose_callback_fails_ends_no_node(launch, peer, wait_for):
    fails = "from turtlebot_gym_ros.node import shell; shell.Shell._serve_reset = lambda *_: 1 / 0"
    process = launch("-c", f"{fails}\nfrom turtlebot_gym_ros.__main__ import main\nmain(['kalman_filter'])")
    client = peer.node.create_client(Trigger, "kalman_filter/reset")
    wait_for(client.service_is_ready)
    for _ in range(10):
        client.call_async(Trigger.Request())
    wait_for(lambda: "ZeroDivisionError" in process.stderr.readline())
    assert process.poll() is None


def path(folder):
    return os.pathsep.join(filter(None, [str(folder), os.environ.get("PYTHONPATH", "")]))
