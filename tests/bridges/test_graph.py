"""The closed loop as a live graph, driven by a policy or by hand; what it is refused. Its numbers: `test_lockstep_graph`."""

import json
import re

import numpy as np
import pytest
from geometry_msgs.msg import Twist, TwistStamped

from turtlebot_gym.tasks import SQUARE_WAYPOINTS
from turtlebot_gym_ros import Graph
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


def test_graphs_in_one_process_do_not_disturb_each_other():
    with Graph(namespace="a", seed=1, laps=1000) as driving, Graph(namespace="b", mode="teleoperation") as other:
        driving.wait_until(lambda graph: graph.latest["true_state"].x > 0.3)
        assert other.latest["true_state"][:3] == (0.0, 0.0, 0.0)
        assert "reference" not in other.latest


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
    assert main(["--speed", "20", "--duration", "5", "--figure", str(figure), "--json", str(report)]) == 0
    out = capfd.readouterr().out
    assert all(re.search(r" [\d.]+$", line) for line in out.splitlines() if not line.startswith("figure"))
    assert figure.stat().st_size > 10_000
    written = json.loads(report.read_text())
    assert written["options"]["speed"] == 20.0
    assert written["metrics"]["duration, s"] >= 5.0
    assert written["metrics"]["waypoints"] == 1
