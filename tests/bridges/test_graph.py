"""The closed loop as a live graph, driven by a policy or by hand; what it is refused. Its numbers: `test_lockstep_graph`."""

import json
import os
import re
from contextlib import ExitStack

import numpy as np
import pytest
from geometry_msgs.msg import Twist, TwistStamped

from cmd_vel_guard.discovery import prepare
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


def test_bringup_prints_the_metrics_and_writes_the_figure(capfd, tmp_path):
    figure, report = tmp_path / "drive.png", tmp_path / "drive.json"
    assert main(["--seed", "3", "--duration", "5", "--figure", str(figure), "--json", str(report)]) == 0
    out = capfd.readouterr().out
    assert all(re.search(r" [\d.]+$", line) for line in out.splitlines() if not line.startswith("figure"))
    assert figure.stat().st_size > 10_000
    written = json.loads(report.read_text())
    assert written["options"]["seed"] == 3
    assert written["metrics"]["duration, s"] >= 5.0
    assert written["metrics"]["waypoints"] == 1


STEPS = 300
RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"


@pytest.mark.slow
@pytest.mark.parametrize("processes", [False, True])
def test_each_of_two_robots_in_lock_step_drives_its_own_episode_to_the_bit(compare, processes):
    drives = {
        "robot1": compare.SquareDrive("bearing", "tutorial", "arrival", "burger", 3),
        "robot2": compare.SquareDrive("proportional", "rough", "arrival", "burger", 8),
    }
    with ExitStack() as stack:
        graphs = {
            name: stack.enter_context(
                Graph(**drive._asdict(), laps=50, goal_tolerance=0.0, namespace=name, processes=processes)
            )
            for name, drive in drives.items()
        }
        for name, graph in graphs.items():
            graph.wait_until(lambda graph: graph.time >= (STEPS - 0.5) * compare.DT, timeout=240.0)
            driven = compare.first(graph.trajectory(), STEPS)
            assert max(compare.differences(compare.episode(drives[name], STEPS), driven).values()) == 0.0


@pytest.mark.parametrize(
    ("given", "full", "prefix"),
    [("", "/", ""), ("/", "/", ""), ("robot1", "/robot1", "robot1/"), ("/lab/robot1/", "/lab/robot1", "lab/robot1/")],
)
def test_a_namespace_is_written_as_ros_writes_it(given, full, prefix):
    assert (absolute(given), prefix_of(given)) == (full, prefix)


@pytest.mark.parametrize("wrong", ["1robot", "a//b", "robot-1"])
def test_a_namespace_that_ros_would_refuse_is_refused(wrong):
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
