"""Lock-step on live nodes: the graph is the environment, whatever the machine does meanwhile, and says whom it waits for."""

import signal

import numpy as np
import pytest
from lockstep import Logged, assert_same, driven, episode, live, square
from std_srvs.srv import Trigger

from harness.machine import busy
from turtlebot_gym import NOISES, write_parameters
from turtlebot_gym_ros import Graph
from turtlebot_gym_ros.graph.bringup import room_metrics

STEPS = 300
DRIVES = [
    # whether in processes; what must make a difference, so that the comparison can fail
    (square(policy="ppo-square", noise="rough"), False, {}),
    *(
        pytest.param(*case, marks=pytest.mark.slow)
        for case in (
            (square(noise="wheel", switch="arrival", fix="late"), True, {"fix": None}),
            (square(noise="rough.yaml", switch="arrival", filter="gated"), False, {"filter": "matched"}),
        )
    ),
]


@pytest.mark.parametrize(("drive", "processes", "otherwise"), DRIVES)
def test_the_graph_is_the_environment(tmp_path, drive, processes, otherwise):
    if drive["noise"].endswith(".yaml"):
        drive = {**drive, "noise": str(tmp_path / drive["noise"])}
        write_parameters(NOISES["rough"], drive["noise"])
    expected = episode(drive, STEPS)
    assert_same(expected, live(drive, STEPS, processes=processes))
    if otherwise:
        other = episode({**drive, **otherwise}, STEPS)
        assert np.abs(other.estimate - expected.estimate).max() > 0.01


@pytest.mark.slow
@pytest.mark.parametrize("processes", [False, True])
def test_a_busy_machine_changes_no_number(processes):
    drive = square(policy="proportional", robot="tutorial")
    expected = episode(drive, STEPS)
    with busy(4):
        assert_same(expected, live(drive, STEPS, processes=processes))


@pytest.mark.slow
def test_a_reset_begins_the_next_episode(peer):
    with Graph(**square(), goal_tolerance=0.0) as graph:
        graph.wait_until(lambda graph: graph.time > 40.0)
        assert peer.ask("turtlebot_simulator/reset", Trigger, Trigger.Request()).success
        graph.wait_until(lambda graph: graph.time < 40.0)
        assert_same(episode(square(), 100, number=1), driven(graph, 100))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["kalman_filter", "waypoint_generator", "velocity_controller"])
def test_a_node_that_is_suspended_is_waited_for_and_costs_no_bit(name):
    drive = square(noise="rough")
    with Graph(**drive, goal_tolerance=0.0, processes=True) as graph:
        graph.wait_until(lambda graph: graph.time > 3.0)
        (process,) = (process for process in graph._processes if name in process.args)
        process.send_signal(signal.SIGSTOP)
        graph.wait_until(lambda graph: any("waits for /cmd_vel of the step" in text for _, text in graph.reports.values()))
        with pytest.raises(TimeoutError, match="waits for /cmd_vel of the step"):
            graph.wait_until(lambda graph: graph.time > 60.0, timeout=0.5)
        process.send_signal(signal.SIGCONT)
        assert_same(episode(drive, 100), driven(graph, 100))


@pytest.mark.slow
@pytest.mark.parametrize("processes", [False, True])
def test_each_of_two_robots_drives_its_own_episode(processes):
    drives = {
        "robot1": square(switch="arrival"),
        "robot2": square(policy="proportional", noise="rough", switch="arrival", seed=8),
    }
    options = {"goal_tolerance": 0.0, "processes": processes}
    with (
        Graph(**drives["robot1"], namespace="robot1", **options) as one,
        Graph(**drives["robot2"], namespace="robot2", **options) as two,
    ):
        for drive, graph in zip(drives.values(), (one, two), strict=True):
            assert_same(episode(drive, STEPS), driven(graph, STEPS))


# In a room: also what the policy is given and answers is the environment's.


def room(policy="lockstep:Logged", world="dense", noise="tutorial", seed=3, **options):
    return {"policy": policy, "world": world, "noise": noise, "seed": seed, **options}


def given_alike(drive, steps=600, *, observation="ekf"):
    """Return the observations and actions of some steps or all, after it is sure that the graph's are the environment's."""
    Logged.seen.clear()
    expected = episode(drive, steps, observation=observation)
    given, count = np.array(Logged.seen), len(expected.clearance) - 1
    Logged.seen.clear()
    driven = live(drive, count)
    assert_same(expected, driven)
    assert count == len(given)
    np.testing.assert_array_equal(Logged.seen[:count], given)
    assert room_metrics(driven) == room_metrics(expected)
    return given


@pytest.mark.parametrize(
    "drive",
    [
        room(lidar="lds01"),
        pytest.param(room(world="office", lidar="a1", noise="rough", seed=1), marks=pytest.mark.slow),
    ],
    ids=["dense", "office"],
)
def test_the_graph_in_a_room_is_the_environment(drive):
    given_alike(drive)


@pytest.mark.slow
def test_the_graph_in_a_room_is_the_environment_in_processes_too():
    drive = room("vfh", lidar="lds01", seed=5)
    expected = episode(drive)
    assert_same(expected, live(drive, len(expected.time) - 1, processes=True))


@pytest.mark.parametrize(("world", "seed"), [("office", 1), pytest.param("crowd", 3, marks=pytest.mark.slow)])
def test_a_robot_with_an_unknown_start_is_the_environments_with_its_localizers_evidence(world, seed):
    drive = room("lockstep:Located", world, "wheel", seed, lidar="lds01", localizer="match", start="unknown")
    given = given_alike(drive, 100, observation="located")
    assert {0.0, 1.0} < {*given[:, 16].tolist()}  # the weight of the best hypothesis: lost, in doubt, sure


@pytest.mark.parametrize("lidar", ["lds01", pytest.param("a1", marks=pytest.mark.slow)])
def test_tracks_of_people_are_those_of_the_environment(lidar):
    drive = room("lockstep:Tracking", "people", "wheel", 2, lidar=lidar)
    given = given_alike(drive, 60, observation="ekf,tracks")
    assert (given[:, 57] == 1.0).any(), "nobody was tracked: the test saw too little"


def test_a_localizer_in_a_map_is_the_environments(tmp_path, write_map):
    drive = room("vfh", str(write_map(tmp_path)), "wheel", lidar="lds01", localizer="match")
    assert_same(episode(drive, 60), live(drive, 60))
