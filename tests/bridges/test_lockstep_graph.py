"""Lock-step on live nodes: the graph is the environment, whatever the machine does meanwhile, and says whom it waits for."""

import signal

import pytest
from std_srvs.srv import Trigger

from harness.machine import busy
from turtlebot_gym import NOISES, write_parameters
from turtlebot_gym_ros import Graph

STEPS = 300
LEAST = 0.0
"""Largest difference from the environment. Headings survive their quaternion; a limit that is applied twice may round twice."""
CHAIN = ("turtlebot_simulator", "kalman_filter", "waypoint_generator", "velocity_controller")


def assert_same(compare, expected, live):
    """Check that a live drive is the environment's in every number."""
    differ = compare.differences(expected, live)
    assert max(differ.values()) <= LEAST, differ


DRIVES = [
    # policy, noise, switch, filter and fix; whether in processes; what must make a difference, so that the comparison can fail
    (("ppo-square", "rough", "time", "matched", "none"), False, {}),
    *(
        pytest.param(*case, marks=pytest.mark.slow)
        for case in (
            (("bearing", "wheel", "arrival", "matched", "late"), True, {"fix": "none"}),
            (("bearing", "rough.yaml", "arrival", "gated", "none"), False, {"filter": "matched"}),
        )
    ),
]


@pytest.mark.parametrize(("parameters", "processes", "otherwise"), DRIVES)
def test_the_graph_is_the_environment(compare, tmp_path, parameters, processes, otherwise):
    policy, noise, switch, filter, fix = parameters
    if noise.endswith(".yaml"):
        noise = str(tmp_path / noise)
        write_parameters(NOISES["rough"], tmp_path / "rough.yaml")
    drive = compare.SquareDrive(policy, noise, switch, "burger", 3, filter, fix)
    expected = compare.episode(drive, STEPS)
    assert_same(compare, expected, compare.live(drive, STEPS, processes=processes))
    if otherwise:
        other = compare.episode(drive._replace(**otherwise), STEPS)
        assert max(compare.differences(expected, other).values()) > 0.01


@pytest.mark.slow
@pytest.mark.parametrize("processes", [False, True])
def test_a_busy_machine_changes_no_number(compare, processes):
    drive = compare.SquareDrive()
    expected = compare.episode(drive, STEPS)
    with busy(4):
        assert_same(compare, expected, compare.live(drive, STEPS, processes=processes))


@pytest.mark.slow
def test_a_reset_begins_the_next_episode(compare, peer):
    drive = compare.SquareDrive("bearing", "tutorial", "time", "burger", 3)
    with Graph(**drive._asdict(), goal_tolerance=0.0) as graph:
        graph.wait_until(lambda graph: graph.time > 40.0)
        assert peer.ask("turtlebot_simulator/reset", Trigger, Trigger.Request()).success
        graph.wait_until(lambda graph: graph.time < 40.0)
        graph.wait_until(lambda graph: graph.time >= 10.0)
        trajectory = graph.trajectory()
    assert_same(compare, compare.episode(drive, 100, number=1), compare.first(trajectory, 100))


@pytest.mark.slow
@pytest.mark.parametrize("name", CHAIN[1:])
def test_a_node_that_is_suspended_is_waited_for_and_costs_no_bit(compare, name):
    drive = compare.SquareDrive("bearing", "rough", "time", "burger", 3)
    with Graph(**drive._asdict(), goal_tolerance=0.0, processes=True) as graph:
        graph.wait_until(lambda graph: graph.time > 3.0)
        (process,) = (process for process in graph._processes if name in process.args)
        process.send_signal(signal.SIGSTOP)
        graph.wait_until(lambda graph: any("waits for /cmd_vel of the step" in text for _, text in graph.reports.values()))
        with pytest.raises(TimeoutError, match="waits for /cmd_vel of the step"):
            graph.wait_until(lambda graph: graph.time > 60.0, timeout=0.5)
        process.send_signal(signal.SIGCONT)
        graph.wait_until(lambda graph: graph.time >= 10.0)
        trajectory = graph.trajectory()
    assert_same(compare, compare.episode(drive, 100), compare.first(trajectory, 100))
