"""A room in the live graph: the environment's episode to the bit, what is refused, and what a lost scan does."""

import os
import sys
from pathlib import Path

import numpy as np
import pytest

from turtlebot_gym_ros.graph.bringup import room_metrics

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
WIDTH = 4 * (50 + 2)
"""Bytes that `wary` logs of a step."""


@pytest.fixture(autouse=True)
def the_policy_is_found(monkeypatch):
    """In this process, and in those of the graph."""
    monkeypatch.syspath_prepend(BENCHMARKS)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(BENCHMARKS), *sys.path[1:]]))


@pytest.fixture
def logged(tmp_path, monkeypatch):
    """Call something, and return its result and what the policy was given and answered meanwhile, shape (T, 52)."""

    def call(function, *arguments, **options):
        path = tmp_path / f"{len(list(tmp_path.iterdir()))}.log"
        monkeypatch.setenv("WARY_LOG", str(path))
        result = function(*arguments, **options)
        monkeypatch.delenv("WARY_LOG")
        content = path.read_bytes()
        return result, np.frombuffer(content[: len(content) // WIDTH * WIDTH], np.float32).reshape(-1, 52)

    return call


@pytest.mark.parametrize(
    ("world", "lidar", "noise", "seed", "processes"),
    [
        ("dense", "lds01", "tutorial", 3, False),
        ("office", "a1", "rough", 1, False),
        ("crowd", "lds02", "documented", 2, False),
        ("dense", "lds01", "tutorial", 5, True),
    ],
)
def test_the_graph_is_the_environment(compare, logged, world, lidar, noise, seed, processes):
    drive = compare.RoomDrive(world=world, lidar=lidar, noise=noise, seed=seed)
    expected, given = logged(compare.room_episode, drive)
    steps = len(expected.clearance) - 1
    told, seen = logged(compare.room_live, drive, steps, processes=processes)
    differ = compare.room_differences(expected, told)
    assert max(differ.values()) == 0.0, differ
    assert steps == len(given) <= len(seen)
    np.testing.assert_array_equal(seen[:steps], given)  # each observation of 50 numbers, and each action
    assert room_metrics(*told) == room_metrics(*expected)
