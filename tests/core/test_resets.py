"""What a reset is given, and where episodes end."""

import math
from dataclasses import replace

import gymnasium as gym
import numpy as np
import own_parts
import pytest

from turtlebot_gym import NAV, Task


def make(name="Nav", **options):
    return gym.make(f"turtlebot_gym/TurtleBot{name.partition(',')[0]}-v0", **options)


def vector(name="Nav", **options):
    return gym.make_vec(f"turtlebot_gym/TurtleBot{name}-v0", **{"num_envs": 3} | options)


@pytest.mark.parametrize("seed", [0, 5, 2**31 - 1, 2**63 - 3, 2**80])
def test_seeds_of_any_size_and_kind_count_up_from_row_to_row(seed):
    env, envs = make(), vector()
    expected, _ = envs.reset(seed=seed)
    assert len(np.unique(expected, axis=0)) == 3
    if seed < 2**63:  # larger ones are cut
        for i in range(3):
            np.testing.assert_array_equal(env.reset(seed=seed + i)[0], expected[i])
    if seed == 5:
        for same in (np.int64(5), np.array(5), [5, 6, 7], np.array([5, 6, 7]), (5, np.uint8(6), 7)):
            np.testing.assert_array_equal(envs.reset(seed=same)[0], expected)
        for same in (np.int64(5), np.array(5)):
            np.testing.assert_array_equal(env.reset(seed=same)[0], expected[0])


def test_episodes_differ_and_those_of_a_seed_can_be_repeated():
    env = make()
    first, _ = env.reset()
    starts = [first, env.reset()[0], make().reset()[0], *vector().reset()[0]]
    assert len(np.unique(starts, axis=0)) == 6
    drawn = env.unwrapped.np_random_seed  # it has 128 bits, of which the lowest 63 count
    for seed in (drawn, drawn % 2**63):
        np.testing.assert_array_equal([env.reset(seed=seed)[0], env.reset()[0]], starts[:2])


LONG = Task(radius=0.01, max_steps=350.0)
ENDLESS, SHORT = replace(LONG, max_steps=math.inf), replace(LONG, max_steps=40.0)


@pytest.mark.parametrize(
    ("make", "options", "limit"),
    [
        (vector, {"task": LONG, "max_episode_steps": 350}, 350),
        (vector, {"task": ENDLESS}, 300),
        (vector, {"task": replace(NAV, radius=0.01)}, 300),
        (make, {"task": SHORT}, 40),
        (make, {"task": LONG, "max_episode_steps": 500}, 350),
        (make, {"task": ENDLESS}, 300),
    ],
)
def test_an_episode_ends_at_the_tasks_own_limit_or_at_the_environments(make, options, limit):
    env = make(**options)
    env.reset(seed=0)
    for step in range(1, limit + 1):
        _, _, terminated, truncated, _ = env.step(np.zeros(env.action_space.shape, np.float32))
        assert (np.any(terminated), np.any(truncated)) == (False, step == limit)


# Poses that are given.

OPEN = {
    "Nav": {},
    "Pose": {"noise": "wheel"},
    "Nav, its past in plain Python": {"observation": "ekf,uncertainty*3", "filter": own_parts.Extended},
    "Nav, late fixes": {"noise": "wheel", "fix": "late"},
}
"""Environments on open ground whose loops are different ones."""


@pytest.mark.parametrize("name", OPEN)
def test_poses_that_the_task_would_draw_change_no_bit(name):
    _, info = make(name, **OPEN[name]).reset(seed=3)
    drawn, drives = {"start": info["true_state"][:3], "goal": info["reference"]}, []
    for given in ({}, drawn, {"start": drawn["start"]}, {"goal": drawn["goal"]}):
        env = make(name, **OPEN[name])
        observation, info = env.reset(seed=3, options=given)
        drives.append([observation.tolist(), info["true_state"].tolist(), info["reference"].tolist()])
        drives[-1] += [env.step(np.array([0.5, 0.02 * step], np.float32))[0].tolist() for step in range(5)]
    assert all(each == drives[0] for each in drives)


@pytest.mark.parametrize("name", ["Nav", "Pose", "Rooms"])
def test_a_heading_that_is_left_out_is_0(name):
    env = make(name)
    _, info = env.reset(seed=0, options={"goal": (1, 1)})
    assert info["reference"].tolist() == [1.0, 1.0, 0.0]
    _, info = env.reset(seed=0, options={"goal": np.array([1.0, 1.0, 7.0]), "start": [-1.5, 0.2]})
    np.testing.assert_allclose(info["reference"], [1.0, 1.0, 7.0 - 2.0 * math.pi])
    assert info["true_state"].tolist() == [-1.5, 0.2, 0.0, 0.0, 0.0]
