"""What a reset is given, and where episodes end: nothing of it is lost without a word."""

from __future__ import annotations

import math
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

from turtlebot_gym import NAV, SQUARE, Task

ID, SQUARE_ID, ROOMS_ID = (f"turtlebot_gym/TurtleBot{name}-v0" for name in ("Nav", "Square", "Rooms"))
STILL = np.zeros(2, np.float32)


@pytest.fixture
def envs():
    return gym.make_vec(ID, num_envs=3)


@pytest.fixture
def env():
    return gym.make(ID)


def test_seeds_of_numpy_are_seeds(env, envs):
    expected, _ = envs.reset(seed=[5, 6, 7])
    for seed in (5, np.int64(5), np.array(5), np.array([5, 6, 7]), (5, np.uint8(6), 7)):
        np.testing.assert_array_equal(envs.reset(seed=seed)[0], expected)
    for seed in (5, np.int64(5), np.array(5)):
        np.testing.assert_array_equal(env.reset(seed=seed)[0], expected[0])


def test_the_seed_that_gymnasium_drew_repeats_an_episode(env):
    """It has 128 bits, of which the lowest 63 count."""
    first, _ = env.reset()
    drawn = env.unwrapped.np_random_seed
    env.reset()
    for seed in (drawn, drawn % 2**63):
        np.testing.assert_array_equal(env.reset(seed=seed)[0], first)


def test_each_environment_has_spaces_of_its_own():
    made = [gym.make(ID).unwrapped for _ in range(2)] + [gym.make_vec(ID, num_envs=2) for _ in range(2)]
    spaces = [space for one in made for space in (one.action_space, one.observation_space)]
    spaces += [space for one in made[2:] for space in (one.single_action_space, one.single_observation_space)]
    assert len({id(space) for space in spaces}) == len(spaces)
    one, other = gym.make(ID), gym.make(ID)
    one.action_space.seed(0)
    expected = one.action_space.sample()
    one.action_space.seed(0)
    other.action_space.sample()
    np.testing.assert_array_equal(one.action_space.sample(), expected)


LONG = Task(radius=0.01, max_steps=350.0)


def steps_until_the_end(one, limit):
    """Return how many steps an episode has in which the robot stands still."""
    one.reset(seed=0)
    for steps in range(1, limit + 1):
        _, _, terminated, truncated, _ = one.step(one.action_space.sample() * 0.0)
        assert not np.any(terminated)
        if np.any(truncated):
            return steps
    return None


def test_a_tasks_own_limit_and_the_vector_environments_must_agree():
    with pytest.raises(
        ValueError, match=r"^task ends episodes after 350 steps \(Task.max_steps\), max_episode_steps after 300"
    ):
        gym.make_vec(ID, num_envs=2, task=LONG)
    with pytest.raises(ValueError, match=r"^task ends episodes after 600 steps \("):
        gym.make_vec(ID, num_envs=2, task=SQUARE)
    assert steps_until_the_end(gym.make_vec(ID, num_envs=2, task=LONG, max_episode_steps=350), 400) == 350
    endless = replace(LONG, max_steps=math.inf)
    assert steps_until_the_end(gym.make_vec(ID, num_envs=2, task=endless), 400) == 300
    assert steps_until_the_end(gym.make_vec(ID, num_envs=2, task=replace(NAV, radius=0.01)), 400) == 300


def test_a_tasks_own_limit_counts_in_the_scalar_environment():
    assert steps_until_the_end(gym.make(ID, task=replace(LONG, max_steps=40.0)), 400) == 40
    assert steps_until_the_end(gym.make(ID, task=LONG, max_episode_steps=500), 400) == 350
    assert steps_until_the_end(gym.make(ID, task=replace(LONG, max_steps=math.inf)), 400) == 300


def test_a_limit_that_cuts_a_task_short_causes_a_warning():
    env = gym.make(ID, task=LONG)
    assert steps_until_the_end(env, 400) == 300
    with pytest.warns(
        UserWarning, match=r"cut after 300 steps, though Task.max_steps is 350: gym.make\(..., max_episode_steps"
    ):
        env.reset()
    for _ in range(20):
        env.step(STILL)
    env.reset()  # of somebody's own accord: nothing was cut


def test_a_task_has_no_limit_of_its_own_unless_it_is_given_one():
    assert Task().max_steps == math.inf
    assert (NAV.max_steps, SQUARE.max_steps) == (300.0, 600.0)
