"""A reset takes a start and a goal where the task draws them: on open ground as in rooms."""

import math

import gymnasium as gym
import numpy as np
import own_parts
import pytest
from gymnasium.error import ResetNeeded

import turtlebot_gym  # noqa: F401  # registers the environments

OPEN = {
    "Nav": {},
    "Pose": {"noise": "wheel"},
    "Nav, its past in plain Python": {"observation": "ekf,uncertainty*3", "filter": own_parts.Extended},
    "Nav, late fixes": {"noise": "wheel", "fix": "late"},
}
"""Environments on open ground whose loops are different ones."""
START, GOAL = (0.5, -1.0, 2.0), (1.0, 1.5, -0.5)


def make(name, **options):
    return gym.make(f"turtlebot_gym/TurtleBot{name.partition(',')[0]}-v0", **options)


def driven(env, **reset):
    """Return what an environment tells at a reset and in five steps after it."""
    observation, info = env.reset(**reset)
    told = [(*observation, *info["true_state"], *info["reference"], info["distance"])]
    for _ in range(5):
        observation, reward, *_, info = env.step(np.array([0.5, 0.2], np.float32))
        told.append((*observation, reward, *info["estimate"], info["distance"]))
    return told


@pytest.mark.parametrize("name", OPEN)
def test_poses_that_the_task_would_draw_change_no_bit(name):
    usual = driven(make(name, **OPEN[name]), seed=3)
    _, info = make(name, **OPEN[name]).reset(seed=3)
    drawn = {"start": info["true_state"][:3], "goal": info["reference"]}
    for given in (drawn, {"start": drawn["start"]}, {"goal": drawn["goal"]}):
        assert driven(make(name, **OPEN[name]), seed=3, options=given) == usual


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", ["Nav", "Pose", "Rooms", "Missions"])
def test_a_heading_that_is_left_out_is_0(name):
    env = make(name)
    _, info = env.reset(seed=0, options={"goal": (1, 1)})
    assert info["reference"].tolist() == [1.0, 1.0, 0.0]
    _, info = env.reset(seed=0, options={"goal": np.array([1.0, 1.0, 7.0]), "start": [-1.5, 0.2]})
    np.testing.assert_allclose(info["reference"], [1.0, 1.0, 7.0 - 2.0 * math.pi])
    assert info["true_state"].tolist() == [-1.5, 0.2, 0.0, 0.0, 0.0]


def test_a_goal_that_is_not_given_is_as_far_away_as_any():
    env = make("Nav")
    for seed in range(50):
        _, info = env.reset(seed=seed, options={"start": (1.9, 1.9)})
        assert info["distance"] >= env.unwrapped.parameters.task.min_distance


@pytest.mark.parametrize(
    ("name", "options", "named"),
    [
        ("Square", {"start": START, "goal": (1, 1)}, "start and goal"),
        ("Nav", {"goal": (1.0, math.nan)}, "goal"),
        ("Nav", {"start": (1e10, 0.0, 0.0)}, "start"),
        ("Nav", {"goal": "door"}, "goal"),
        ("Nav", {"goal": (1.0,)}, "goal"),
        ("Nav", {"goals": (1, 1)}, "options .*'goals'"),
        ("Nav", {"world": "office"}, "options .*'world'"),
    ],
)
def test_other_options_of_a_reset_are_refused_and_begin_nothing(name, options, named):
    env = make(name)
    with pytest.raises(ValueError, match=f"^{named}[^\n]*$"):
        env.reset(seed=0, options=options)
    with pytest.raises(ResetNeeded):
        env.unwrapped.step(np.zeros(env.action_space.shape, np.float32))
