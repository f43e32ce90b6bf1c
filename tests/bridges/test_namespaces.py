"""Robots in one graph and discovery: below a namespace each, they share a ROS domain and nothing else."""

import os

import pytest

from cmd_vel_guard.discovery import prepare
from turtlebot_gym_ros import Graph
from turtlebot_gym_ros.base.names import absolute, prefix_of, remapping

STEPS = 300


@pytest.fixture
def drives(compare):
    """Another policy, noise and seed for each robot."""
    return {
        "robot1": compare.SquareDrive("bearing", "tutorial", "arrival", "burger", 3),
        "robot2": compare.SquareDrive("proportional", "rough", "arrival", "burger", 8),
    }


@pytest.fixture
def start():
    """Start graphs, and let none survive the test."""
    graphs = []

    def start_one(drive, namespace, **options):
        graph = Graph(**drive._asdict(), laps=drive.laps, goal_tolerance=0.0, namespace=namespace, **options)
        graphs.append(graph.start())
        return graph

    yield start_one
    for graph in graphs:
        graph.close()


def side_by_side(start, compare, drives, steps, **options):
    """Run a graph for each robot at the same time, and return their trajectories."""
    graphs = {name: start(drive, name, **options) for name, drive in drives.items()}
    for graph in graphs.values():
        graph.wait_until(lambda graph: graph.time >= (steps - 0.5) * compare.DT, timeout=max(120.0, 8.0 * steps * compare.DT))
    return {name: compare.first(graph.trajectory(), steps) for name, graph in graphs.items()}


def apart(compare, drives, driven, steps):
    """Return the largest difference of each robot's drive from the environment's episode of its own seed."""
    return {
        name: max(compare.differences(compare.episode(drive, steps), driven[name]).values()) for name, drive in drives.items()
    }


@pytest.mark.nightly
@pytest.mark.parametrize("processes", [False, True])
def test_each_of_two_robots_in_lock_step_drives_its_own_episode_to_the_bit(compare, drives, start, processes):
    driven = side_by_side(start, compare, drives, STEPS, processes=processes)
    assert apart(compare, drives, driven, STEPS) == {"robot1": 0.0, "robot2": 0.0}
    swapped = {"robot1": drives["robot2"], "robot2": drives["robot1"]}
    assert min(apart(compare, swapped, driven, STEPS).values()) > 0.01  # the comparison tells them apart


@pytest.mark.parametrize(
    ("given", "full", "prefix"),
    [("", "/", ""), ("/", "/", ""), ("robot1", "/robot1", "robot1/"), ("/lab/robot1/", "/lab/robot1", "lab/robot1/")],
)
def test_a_namespace_is_written_as_ros_writes_it(given, full, prefix):
    assert (absolute(given), prefix_of(given)) == (full, prefix)
    assert remapping(given) == ([] if full == "/" else ["--ros-args", "-r", f"__ns:={full}"])


@pytest.mark.parametrize("wrong", ["1robot", "robot 1", "a//b", "a__b", "robot-1", "~robot", "röbot"])
def test_a_namespace_that_ros_would_refuse_is_refused(wrong):
    with pytest.raises(ValueError, match="namespace must be names of letters"):
        Graph(namespace=wrong)


RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"


@pytest.fixture
def environment(monkeypatch):
    """An environment in which nothing is set; it is as it was afterwards."""
    bare = {name: value for name, value in os.environ.items() if "ROS_" not in name and "FAST" not in name}
    monkeypatch.setattr(os, "environ", bare)
    return bare


def test_it_stays_on_this_machine_unless_asked(environment):
    prepare()
    assert environment[RANGE] == "LOCALHOST"


@pytest.mark.parametrize("asked", [RANGE, "ROS_LOCALHOST_ONLY", "ROS_STATIC_PEERS", "ROS_DISCOVERY_SERVER"])
def test_what_was_asked_for_stays(environment, asked):
    environment[asked] = "SUBNET"
    prepare()
    assert environment[asked] == "SUBNET"
    assert asked == RANGE or RANGE not in environment


def test_the_guard_serves_the_network(environment):
    prepare(local=False)
    assert RANGE not in environment
