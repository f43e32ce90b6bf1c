"""Robots in one graph and discovery: below a namespace each, they share a ROS domain and nothing else."""

import os
from contextlib import ExitStack

import pytest

from cmd_vel_guard.discovery import prepare
from turtlebot_gym_ros import Graph
from turtlebot_gym_ros.base.names import absolute, prefix_of, remapping

STEPS = 300
RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"


@pytest.mark.nightly
@pytest.mark.parametrize("processes", [False, True])
def test_each_of_two_robots_in_lock_step_drives_its_own_episode_to_the_bit(compare, processes):
    drives = {
        "robot1": compare.SquareDrive("bearing", "tutorial", "arrival", "burger", 3),
        "robot2": compare.SquareDrive("proportional", "rough", "arrival", "burger", 8),
    }
    with ExitStack() as stack:
        graphs = {
            name: stack.enter_context(Graph(**drive._asdict(), goal_tolerance=0.0, namespace=name, processes=processes))
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
    assert remapping(given) == ([] if full == "/" else ["--ros-args", "-r", f"__ns:={full}"])


@pytest.mark.parametrize("wrong", ["1robot", "a//b", "a__b", "robot-1", "röbot"])
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
