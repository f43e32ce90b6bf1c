"""Whatever environments, resets and steps are given, they accept it or answer with one line that names what is wrong."""

import math

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.error import Error, InvalidAction, ResetNeeded

NAV, SQUARE, ROOMS = (f"turtlebot_gym/TurtleBot{name}-v0" for name in ("Nav", "Square", "Rooms"))
NAN, INF = math.nan, math.inf


def refused(call, named, error=ValueError):
    """Require an error of one line that begins with a name, a regular expression."""
    with pytest.raises(error, match=f"^{named}") as caught:
        call()
    assert "\n" not in str(caught.value)


def vector(id=NAV, **options):
    return gym.make_vec(id, **{"num_envs": 3} | options)


@pytest.fixture(params=[gym.make, vector], ids=["scalar", "vector"])
def maker(request):
    """Make an environment of one or of three."""
    return request.param


CHOICES = ("", [], 0, 0.5, ["x"], {"nonsense": 1.0}, Ellipsis)
WRONG = {
    **dict.fromkeys(("integrator", "arrival", "switch", "observation", "reward"), CHOICES),
    "dt": ("0.1", True, 10.1, 0.9e-4, NAN),
    "delay": (1.0, 4, True),
    "laps": (0, True),
    "waypoints": ([], 3, "abc", [(1e300, 0.0, 0.0)], [(0.0, NAN, 0.0)]),
    "world": ("dense",),
}


@pytest.mark.parametrize("name", WRONG)
def test_options_are_refused_by_name(maker, name):
    for wrong in WRONG[name]:
        refused(lambda wrong=wrong: maker(SQUARE, **{name: wrong}), rf"(a term of )?{name}\b")


VECTORS = {"num_envs": 0, "info": "some", "autoreset_mode": "later", "render_mode": "human", "max_episode_steps": 0}


@pytest.mark.parametrize("name", VECTORS)
def test_arguments_of_a_vector_environment_are_refused_by_name(name):
    refused(lambda: vector(**{name: VECTORS[name]}), name)


def test_a_seed_is_a_whole_number_for_each_environment(maker):
    for seed in (1.5, True, "1", -1, NAN, np.float32(1.0), b"1", {}):
        refused(lambda seed=seed: maker(NAV).reset(seed=seed), "seed must be a whole number")
    for seed in ((), [1, 2], [1, 2, 3, 4], [1, 2.5, 3], [1, 2, True], [1, 2, -3], np.array([0.5, 1.0, 2.0])):
        refused(lambda seed=seed: vector().reset(seed=seed), r"seed must hold 3 seeds|seed\[\d\] must be a whole number")


@pytest.mark.parametrize("id", [NAV, ROOMS])
def test_unknown_options_of_a_reset_are_refused_and_begin_nothing(maker, id):
    env = maker(id)
    for options in ({"begin": 1}, {3: 4}, {1: 2, "b": 3}, "world", 3, ["reset_mask"]):
        refused(lambda options=options: env.reset(seed=0, options=options), "options must be")
    for name, pose in (("goal", (1.0, NAN)), ("start", (1e10, 0.0, 0.0)), ("goal", "door"), ("goal", (1.0,))):
        refused(lambda name=name, pose=pose: env.reset(seed=0, options={name: pose}), f"{name}|start and goal|options must be")
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


@pytest.mark.parametrize("bad", [(NAN, 0.0), (0.0, NAN), (INF, 0.0), (0.0, -INF), (INF, -INF)], ids=str)
def test_an_action_that_is_not_finite_is_refused_with_the_environments_index_and_changes_nothing(maker, bad):
    env, other, row = maker(NAV), maker(NAV), 0 if maker is gym.make else 2
    actions = np.full(env.action_space.shape, 0.5, np.float32)
    for environment in (env, other):
        environment.reset(seed=0)
        environment.step(actions)
    wrong = actions.copy()
    np.atleast_2d(wrong)[row] = bad
    refused(lambda: env.step(wrong), f"Environment {row}: .*finite", InvalidAction)
    np.testing.assert_array_equal(env.step(actions)[0], other.step(actions)[0])


def test_actions_of_another_kind_or_shape_are_refused(maker):
    env = maker(NAV)
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
