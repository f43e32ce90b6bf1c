"""The closed loop as a live graph, by policy or by hand, and the nodes of a robot. Its numbers: `test_lockstep_graph`."""

import json
import os
import re
import signal
from pathlib import Path

import numpy as np
import pytest
from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import Odometry

from cmd_vel_guard.discovery import prepare
from cmd_vel_guard.qos import SENSOR
from turtlebot_gym.tasks import SQUARE_WAYPOINTS
from turtlebot_gym_ros import Graph
from turtlebot_gym_ros.base.names import absolute, prefix_of
from turtlebot_gym_ros.graph.bringup import main, metrics

NODES = ("turtlebot_simulator", "kalman_filter", "velocity_controller", "waypoint_generator")


def test_it_drives_the_square_in_one_process():
    with Graph(policy="bearing", noise="clean") as graph:
        graph.wait_until(lambda graph: graph.state == "silent: done")
        trajectory = graph.trajectory()
        assert graph.reports.keys() >= set(NODES)
        assert max(level for level, _ in graph.reports.values()) == 0, graph.reports
    figures = metrics(trajectory)
    assert all("waypoints" in name or name.endswith((", m", ", s", ", rad")) for name in figures)
    assert figures["waypoints reached"] == figures["waypoints"] == len(SQUARE_WAYPOINTS)  # without noise belief and truth agree
    np.testing.assert_allclose(np.diff(trajectory.time), 0.1, atol=1e-9)
    assert np.isfinite(trajectory.true_state).all()


@pytest.mark.parametrize(("stamped", "kind"), [(True, TwistStamped), (False, Twist)])
def test_a_person_drives_with_the_type_of_velocity_that_is_configured(peer, wait_for, stamped, kind):
    with Graph(mode="teleoperation", noise="clean", enable_stamped_cmd_vel=stamped) as graph:
        command = kind()
        (command.twist if stamped else command).linear.x = 0.15
        publisher = peer.speak("cmd_vel", kind)
        wait_for(lambda: publisher.get_subscription_count() >= 2)  # the plant and the recorder
        publisher.publish(command)  # once: the plant holds it for ever
        graph.wait_until(lambda graph: graph.latest["true_state"].x > 0.3)
        assert graph.latest["estimate"].belief.mean.x == pytest.approx(graph.latest["true_state"].x, abs=0.1)


def test_bringup_prints_the_metrics_and_writes_figure_and_page(capfd, tmp_path):
    figure, report, page = (tmp_path / f"drive.{ending}" for ending in ("png", "json", "html"))
    assert main(["--seed", "3", "--duration", "5", "--figure", f"{figure}", "--json", f"{report}", "--html", f"{page}"]) == 0
    out = capfd.readouterr().out
    assert all(re.search(r" [\d.]+$", line) for line in out.splitlines() if not line.startswith(("figure", "page")))
    assert min(figure.stat().st_size, page.stat().st_size) > 10_000
    written = json.loads(report.read_text())
    assert written["options"]["seed"] == 3
    assert written["metrics"]["duration, s"] >= 5.0
    assert written["metrics"]["waypoints"] == 1


RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"


def test_a_namespace_is_written_as_ros_writes_it_or_refused():
    for given in ("", "/"):
        assert (absolute(given), prefix_of(given)) == ("/", "")
    for given in ("lab/robot1", "/lab/robot1/"):
        assert (absolute(given), prefix_of(given)) == ("/lab/robot1", "lab/robot1/")
    for wrong in ("1robot", "a//b", "robot-1"):
        with pytest.raises(ValueError, match="namespace must be names of letters"):
            Graph(namespace=wrong)


@pytest.mark.parametrize("asked", [RANGE, "ROS_LOCALHOST_ONLY", "ROS_STATIC_PEERS", "ROS_DISCOVERY_SERVER"])
def test_it_stays_on_this_machine_unless_asked_or_on_a_robot(monkeypatch, asked):
    for given, local, reach in (({}, True, "LOCALHOST"), ({}, False, None), ({asked: "SUBNET"}, True, None)):
        bare = {name: value for name, value in os.environ.items() if "ROS_" not in name and "FAST" not in name} | given
        with monkeypatch.context() as patch:
            patch.setattr(os, "environ", bare)
            prepare(local=local)
        assert bare.get(RANGE) == (given.get(RANGE) or reach)


# A simulated robot behind the guard.


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
        self._launch, self._domain, self.until = launch, domain, wait_for
        self.odometry = peer.hear("odom", Odometry, SENSOR)

    def start(self, name):
        given = [] if name == "turtlebot_simulator" else ["--params-file", str(ROBOT)]
        self.tool(name, "--ros-args", *given, *WORDS.get(name, []))

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


@pytest.mark.slow
def test_what_stops_the_wheels(launch, runner, peer, wait_for):
    """The checklist of the deploy page, with the tools of this package alone; the comments have the page's steps."""
    robot = Robot(launch, str(runner.context.get_domain_id()), peer, wait_for)
    for name in ("turtlebot_simulator", *GUARDS, *LOOP):
        robot.start(name)
    ends = ("publishes: /cmd_vel_guard", "publishes: /cmd_vel_standby", "subscribes: /turtlebot_simulator")
    wait_for(lambda: all(end in robot.ask("topics", "cmd_vel")[1] for end in ends))  # 1
    assert robot.ask("enable", "cmd_vel_guard")[0] == 2  # without a button
    wait_for(lambda: " error " not in robot.ask("status")[1])  # 2
    echo = robot.tool("topics", "diagnostics", "--echo")
    assert any("DiagnosticStatus" in line for line in echo.stdout)
    button = robot.push()  # 3
    assert robot.ask("enable", "velocity_controller", "--off")[0] == 0
    robot.stands(button)
    button = robot.push()  # 4
    button.send_signal(signal.SIGINT)
    robot.stands()
    assert robot.ask("enable", "cmd_vel_guard")[0] == 2
