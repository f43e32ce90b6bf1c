"""A room in the live graph: the environment's episode to the bit, what is refused, and what a lost scan does."""

import os
import sys

import numpy as np
import pytest

from turtlebot_gym_ros.graph.bringup import room_metrics

LOGGED = """
import os
import numpy as np
from turtlebot_gym.observations import LOCATED_ROOM, ROOM, TRACKS
from turtlebot_gym_agents.policies import make_policy

class Logged:
    terms, name = ROOM, "vfh"

    def __init__(self, *, robot, dt):
        self._policy = make_policy(self.name, robot=robot, dt=dt)

    def reset(self, mask):
        self._policy.reset(mask)

    def __call__(self, observation):
        action = np.asarray(self._policy(observation), np.float32)
        with open(os.environ["LOGGED_IN"], "ab") as log:
            log.write(np.asarray(observation, np.float32).tobytes() + action.tobytes())
        return action

class Located(Logged):
    terms = LOCATED_ROOM

class Tracking(Logged):
    terms, name = (*ROOM, TRACKS), "vfh+yield"
"""
"""VFH+, with memory, which keeps what it is given and answers; with a localizer's evidence; and with a stop for people."""


@pytest.fixture(autouse=True)
def the_policy_is_found(tmp_path, monkeypatch):
    """In this process, and in those of the graph."""
    (tmp_path / "logged_policy.py").write_text(LOGGED)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), *sys.path[1:]]))


@pytest.fixture
def logged(tmp_path, monkeypatch):
    """Call something, and return its result and what the policy was given and answered meanwhile, shape (T, shown + 2)."""

    def call(function, *arguments, shown=50, **options):
        path = tmp_path / f"{len(list(tmp_path.iterdir()))}.log"
        monkeypatch.setenv("LOGGED_IN", str(path))
        result = function(*arguments, **options)
        monkeypatch.delenv("LOGGED_IN")
        content = path.read_bytes()
        width = 4 * (shown + 2)
        return result, np.frombuffer(content[: len(content) // width * width], np.float32).reshape(-1, shown + 2)

    return call


@pytest.mark.parametrize(
    ("world", "lidar", "noise", "seed", "processes"),
    [
        ("dense", "lds01", "tutorial", 3, False),
        *(
            pytest.param(*case, marks=pytest.mark.slow)
            for case in (
                ("office", "a1", "rough", 1, False),
                ("dense", "lds01", "tutorial", 5, True),
            )
        ),
    ],
)
def test_the_graph_is_the_environment(compare, logged, world, lidar, noise, seed, processes):
    drive = compare.RoomDrive("logged_policy:Logged", world=world, lidar=lidar, noise=noise, seed=seed)
    given_alike(compare, logged, drive, processes=processes)


def given_alike(compare, logged, drive, *steps, shown=50, processes=False):
    """Return the observations and actions of some steps or all, after it is sure that the graph's are the environment's."""
    expected, given = logged(compare.room_episode, drive, *steps, shown=shown)
    count = len(expected.clearance) - 1
    live, seen = logged(compare.room_live, drive, count, shown=shown, processes=processes)
    differ = compare.room_differences(expected, live)
    assert max(differ.values()) == 0.0, differ
    assert count == len(given) <= len(seen)
    np.testing.assert_array_equal(seen[:count], given)
    assert room_metrics(live) == room_metrics(expected)
    return given


@pytest.mark.parametrize(("world", "seed"), [("office", 1), pytest.param("crowd", 3, marks=pytest.mark.slow)])
def test_a_robot_with_an_unknown_start_is_the_environments_with_its_localizers_evidence(compare, logged, world, seed):
    lost = {"noise": "wheel", "localizer": "match", "start": "unknown", "observation": "located"}
    drive = compare.RoomDrive("logged_policy:Located", world=world, seed=seed, **lost)
    given = given_alike(compare, logged, drive, 100, shown=54)
    assert {0.0, 1.0} < {*given[:, 16].tolist()}  # the weight of the best hypothesis: lost, in doubt, sure


@pytest.mark.parametrize("lidar", ["lds01", pytest.param("a1", marks=pytest.mark.slow)])
def test_tracks_of_people_are_those_of_the_environment(compare, logged, lidar):
    drive = compare.RoomDrive(
        "logged_policy:Tracking", world="people", lidar=lidar, noise="wheel", observation="ekf,tracks", seed=2
    )
    given = given_alike(compare, logged, drive, 60, shown=90)
    assert (given[:, 57] == 1.0).any(), "nobody was tracked: the test saw too little"


def test_a_localizer_in_a_map_is_the_environments(compare, tmp_path, write_map):
    drive = compare.RoomDrive(world=str(write_map(tmp_path)), noise="wheel", seed=3, localizer="match")
    expected = compare.first(compare.room_episode(drive), 60)
    differ = compare.room_differences(expected, compare.room_live(drive, 60))
    assert max(differ.values()) == 0.0, differ
