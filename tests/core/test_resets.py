"""What environments, resets and steps are given: they accept it, or answer with one line that names what is wrong."""

import math
from dataclasses import replace

import gymnasium as gym
import numpy as np
import own_parts
import pytest
from gymnasium.error import Error, InvalidAction, ResetNeeded

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


# What is refused.


def refused(call, named, error=ValueError):
    """Require an error of one line that begins with a name, a regular expression."""
    with pytest.raises(error, match=f"^{named}") as caught:
        call()
    assert "\n" not in str(caught.value)


@pytest.fixture(params=[make, vector], ids=["scalar", "vector"])
def maker(request):
    """Make an environment of one or of three."""
    return request.param


CHOICES = ("", [], 0, 0.5, ["x"], {"nonsense": 1.0}, Ellipsis)
WRONG = {
    **dict.fromkeys(("integrator", "arrival", "switch", "observation", "reward"), CHOICES),
    "dt": ("0.1", True, 10.1, 0.9e-4, math.nan),
    "delay": (1.0, 4, True),
    "laps": (0, True),
    "waypoints": ([], 3, "abc", [(1e300, 0.0, 0.0)], [(0.0, math.nan, 0.0)]),
    "world": ("dense",),
}


@pytest.mark.parametrize("name", WRONG)
def test_options_are_refused_by_name(maker, name):
    for wrong in WRONG[name]:
        refused(lambda wrong=wrong: maker("Square", **{name: wrong}), rf"(a term of )?{name}\b")


VECTORS = {"num_envs": 0, "info": "some", "autoreset_mode": "later", "render_mode": "human", "max_episode_steps": 0}


@pytest.mark.parametrize("name", VECTORS)
def test_arguments_of_a_vector_environment_are_refused_by_name(name):
    refused(lambda: vector(**{name: VECTORS[name]}), name)


def test_a_seed_is_a_whole_number_for_each_environment(maker):
    for seed in (1.5, True, "1", -1, math.nan, np.float32(1.0), b"1", {}):
        refused(lambda seed=seed: maker().reset(seed=seed), "seed must be a whole number")
    for seed in ((), [1, 2], [1, 2, 3, 4], [1, 2.5, 3], [1, 2, True], [1, 2, -3], np.array([0.5, 1.0, 2.0])):
        refused(lambda seed=seed: vector().reset(seed=seed), r"seed must hold 3 seeds|seed\[\d\] must be a whole number")


@pytest.mark.parametrize("name", ["Nav", "Rooms"])
def test_unknown_options_of_a_reset_are_refused_and_begin_nothing(maker, name):
    env = maker(name)
    for options in ({"begin": 1}, {3: 4}, {1: 2, "b": 3}, "world", 3, ["reset_mask"]):
        refused(lambda options=options: env.reset(seed=0, options=options), "options must be")
    for key, pose in (("goal", (1.0, math.nan)), ("start", (1e10, 0.0, 0.0)), ("goal", "door"), ("goal", (1.0,))):
        refused(lambda key=key, pose=pose: env.reset(seed=0, options={key: pose}), f"{key}|start and goal|options must be")
    refused(lambda: env.unwrapped.step(np.zeros(env.action_space.shape)), r"Call reset\(\) before step", ResetNeeded)


def test_a_mask_is_of_truths_for_each_environment_and_leaves_out_none_that_was_never_reset():
    envs, options = vector(), {"reset_mask": np.array([True, False, True])}
    for _ in range(2):
        refused(lambda: envs.reset(seed=0, options=options), "Environment 1: call reset", ResetNeeded)
        refused(lambda: envs.step(np.zeros((3, 2))), "Call reset", ResetNeeded)
    envs.reset(seed=0)
    for mask in (
        [True, False, True],
        np.ones(2, np.bool_),
        np.ones((3, 1), np.bool_),
        np.array([1, 0, 1]),
        np.zeros(3, np.bool_),
    ):
        refused(lambda mask=mask: envs.reset(options={"reset_mask": mask}), "reset_mask must be")


@pytest.mark.parametrize(
    "bad", [(math.nan, 0.0), (0.0, math.nan), (math.inf, 0.0), (0.0, -math.inf), (math.inf, -math.inf)], ids=str
)
def test_an_action_that_is_not_finite_is_refused_with_the_environments_index_and_changes_nothing(maker, bad):
    env, other, row = maker(), maker(), 0 if maker is make else 2
    actions = np.full(env.action_space.shape, 0.5, np.float32)
    for environment in (env, other):
        environment.reset(seed=0)
        environment.step(actions)
    wrong = actions.copy()
    np.atleast_2d(wrong)[row] = bad
    refused(lambda: env.step(wrong), f"Environment {row}: .*finite", InvalidAction)
    np.testing.assert_array_equal(env.step(actions)[0], other.step(actions)[0])


def test_actions_of_another_kind_or_shape_are_refused(maker):
    env = maker()
    env.reset(seed=0)
    ahead = np.array([1.0, 0.0], np.float32)
    kinds = ({"v": 1.0}, {0.1, 0.2}, None, "ab", [0.1, None], [[0.1], [0.1, 0.2]], 1j * ahead, ahead.astype("M8[s]"))
    for bad in (*kinds, *(np.zeros(shape, np.float32) for shape in ((), (1,), (3,), (2, 1), (1, 2), (0,)))):
        refused(lambda bad=bad: env.step(bad), "An action must hold real numbers|Actions have shape", InvalidAction)


def test_stepping_an_ended_environment_is_an_error_where_autoreset_is_disabled():
    env = vector(autoreset_mode="DISABLED", max_episode_steps=3)
    env.reset(seed=0)
    env.step(np.zeros((3, 2), np.float32))
    env.reset(options={"reset_mask": np.array([True, False, False])})
    for _ in range(2):
        _, _, _, truncated, _ = env.step(np.zeros((3, 2), np.float32))
    assert truncated.tolist() == [False, True, True]
    refused(lambda: env.step(np.zeros((3, 2), np.float32)), "Environment 1", Error)
