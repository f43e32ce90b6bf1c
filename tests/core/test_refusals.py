"""Whatever an environment is given, it works with finite numbers or answers with one line that names what is wrong."""

from __future__ import annotations

import math
from dataclasses import fields, replace
from typing import get_type_hints

import gymnasium as gym
import numpy as np
import pytest

from turtlebot_gym import FixNoise, Noise, OdometryNoise, ProcessNoise, Reward, Robot, Task, make_parameters
from turtlebot_gym.parameters import FilterTuning
from turtlebot_gym.plants import MujocoBurger
from turtlebot_gym.rooms.lidar import Lidar
from turtlebot_gym.rooms.rules import RoomRules

NAV, SQUARE, ROOMS = (f"turtlebot_gym/TurtleBot{name}-v0" for name in ("Nav", "Square", "Rooms"))
VALID = [
    Robot(max_linear=0.2, max_angular=2.0),
    ProcessNoise(),
    OdometryNoise(),
    Noise(),
    FixNoise(R=(0.1, 0.1, 0.1)),
    FilterTuning(Q=(0.1,) * 5, R=(0.1,) * 3),
    Reward(),
    Task(),
    RoomRules(),
    Lidar(),
    MujocoBurger(),
]
FIELDS = [(value, item.name) for value in VALID for item in fields(value)]
NUMBERS = [(value, name) for value, name in FIELDS if get_type_hints(type(value))[name] in (float, int)]
FLAGS = [(value, name) for value, name in FIELDS if get_type_hints(type(value))[name] is bool]
NO_NUMBERS = (None, "1", "", b"1", True, [], [1.0], {}, object(), 1j, math.nan, -math.inf, -1e308, 1e308)


def named(value):
    return value if isinstance(value, str) else type(value).__name__


@pytest.mark.parametrize(("value", "name"), NUMBERS, ids=named)
def test_no_number_is_anything_else(value, name):
    for bad in NO_NUMBERS:
        with pytest.raises(ValueError, match=rf"^{named(value)}\.{name} ") as caught:
            replace(value, **{name: bad})
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("value", "name"), FLAGS, ids=named)
def test_no_truth_value_is_anything_else(value, name):
    for bad in (None, "x", "True", 0, 1, math.nan, 1e308, []):
        with pytest.raises(ValueError, match=rf"^{named(value)}\.{name} must be True or False, got"):
            replace(value, **{name: bad})


@pytest.mark.parametrize(("value", "name"), [pair for pair in FIELDS if pair not in NUMBERS + FLAGS], ids=named)
def test_no_sequence_and_no_part_is_anything_else(value, name):
    for bad in (None, "x", 0, 1.0, math.nan, ["x"], [[None]], {"x": 1}, object()):
        with pytest.raises(ValueError, match=rf"^{named(value)}\.{name}[: \[]"):
            replace(value, **{name: bad})


@pytest.mark.parametrize(("value", "name"), NUMBERS, ids=named)
def test_numbers_of_numpy_are_numbers(value, name):
    kept = getattr(value, name)
    for given_ in (np.float64(kept), np.array(kept)) if type(kept) is float else (np.int64(kept), np.array(kept)):
        again = replace(value, **{name: given_})
        assert again == value
        assert type(getattr(again, name)) is type(kept)


@pytest.mark.parametrize("maker", [gym.make, gym.make_vec], ids=["scalar", "vector"])
@pytest.mark.parametrize("name", ["reward", "robot", "noise", "filter"])
@pytest.mark.parametrize("bad", ["", [], 0, 0.5, True, ["x"], {"nonsense": 1.0}, Ellipsis], ids=str)
def test_parameters_are_given_as_such_or_by_their_fields(maker, name, bad):
    with pytest.raises(ValueError, match=rf"^{name}\b") as caught:
        maker(NAV, **{name: bad})
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["task", "integrator", "observation", "arrival", "fix", "plant"])
@pytest.mark.parametrize("bad", ["", [], {}, 0, True, {"nonsense": 1.0}, Ellipsis], ids=str)
def test_choices_are_one_of_those_that_there_are(name, bad):
    for maker in (gym.make, gym.make_vec):
        with pytest.raises(ValueError, match=rf"^{name}\b"):
            maker(NAV, **{name: bad})


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"dt": "0.1"}, "dt must be a number from 0.0001 to 10 s, got '0.1'"),
        ({"dt": True}, "dt must be a number from 0.0001 to 10 s, got True"),
        ({"dt": 1e300}, "dt must be a number from 0.0001 to 10 s, got 1e\\+300"),
        ({"dt": 1e-5}, "dt must be a number from 0.0001 to 10 s, got 1e-05"),
        ({"delay": 1.0}, "delay must be a whole number from 0 to 3, got 1.0"),
        ({"delay": 4}, "delay must be a whole number from 0 to 3, got 4"),
        ({"delay": True}, "delay must be a whole number from 0 to 3, got True"),
        ({"dt": 1e-4, "fix": "late"}, "fix must come at most 25 steps late, got 0.3 s with dt 0.0001 s"),
        ({"laps": True}, "laps must be a whole number of at least 1, got True"),
        (
            {"waypoints": [(1e300, 0.0, 0.0)]},
            r"waypoints must be one or more finite poses \(x, y, theta\), at most 1e\+09 m away",
        ),
        ({"waypoints": 3}, "waypoints must be one or more finite poses"),
        ({"waypoints": "abc"}, "waypoints must be one or more finite poses"),
        ({"robot": {"max_linear": 0.2}}, "robot: Robot needs max_angular"),
        ({"noise": {"odometry": {"R": [1, 2]}}}, "OdometryNoise.R must be 3 numbers or a diagonal"),
        ({"reward": {"time": "much"}}, "Reward.time must be a number from .*, got 'much'"),
    ],
)
def test_other_arguments_are_refused_by_name(options, told):
    for maker in (gym.make, gym.make_vec):
        with pytest.raises(ValueError, match=f"^{told}"):
            maker(SQUARE, **options)


@pytest.mark.parametrize("name", ["world", "lidar"])
@pytest.mark.parametrize("bad", ["", [], 0, True, {"nonsense": 1.0}, Ellipsis], ids=str)
def test_rooms_are_refused_by_name(name, bad):
    for maker in (gym.make, gym.make_vec):
        with pytest.raises(ValueError, match=rf"^{name}\b"):
            maker(ROOMS, **{name: bad})


def test_mappings_stand_for_parameters():
    given_ = make_parameters(
        reward={"time": 0.2},
        noise={"odometry": {"R": (0.01, 0.01, 0.02)}, "process": {"alpha1": 0.1}},
        robot={"max_linear": 0.3, "max_angular": 1.0, "reverse": False},
        filter={"Q": (0.1,) * 5, "R": (0.1,) * 3},
        fix={"R": (0.1, 0.1)},
    )
    assert given_.reward == Reward(time=0.2)
    assert given_.noise == Noise(odometry=OdometryNoise(R=(0.01, 0.01, 0.02)), process=ProcessNoise(alpha1=0.1))
    assert given_.robot == Robot(max_linear=0.3, max_angular=1.0, reverse=False)
    assert given_.tuning == FilterTuning(Q=(0.1,) * 5, R=(0.1,) * 3)
    assert given_.fix == FixNoise(R=(0.1, 0.1))
