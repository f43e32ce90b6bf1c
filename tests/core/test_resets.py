"""What a reset is given and where episodes end, without losing a word; a pickled environment goes on as the original does."""

import copy
import math
import pickle
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

from turtlebot_gym import NAV, SQUARE, Task
from turtlebot_gym.compiled.batch import PARALLEL_FROM

ID = "turtlebot_gym/TurtleBotNav-v0"


def vector(**options):
    return gym.make_vec(ID, **{"num_envs": 3} | options)


@pytest.mark.parametrize("seed", [0, 5, 2**31 - 1, 2**63 - 3, 2**80])
def test_seeds_of_any_size_and_kind_count_up_from_row_to_row(seed):
    env, envs = gym.make(ID), vector()
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


def test_unseeded_environments_differ_and_the_seed_that_gymnasium_drew_repeats_an_episode():
    env = gym.make(ID)
    first, _ = env.reset()
    starts = [first, env.reset()[0], gym.make(ID).reset()[0], *vector().reset()[0]]
    assert len(np.unique(starts, axis=0)) == 6
    drawn = env.unwrapped.np_random_seed  # it has 128 bits, of which the lowest 63 count
    for seed in (drawn, drawn % 2**63):
        np.testing.assert_array_equal(env.reset(seed=seed)[0], first)


def test_episodes_of_a_seed_differ_and_can_be_repeated():
    env = gym.make(ID)
    first, again = ([env.reset(seed=4)[0], *(env.reset()[0] for _ in range(3))] for _ in range(2))
    np.testing.assert_array_equal(first, again)
    assert len(np.unique(first, axis=0)) == 4


def test_each_environment_has_spaces_of_its_own():
    made = [env.unwrapped for env in (gym.make(ID), gym.make(ID), vector(), vector())]
    spaces = [space for env in made for space in (env.action_space, env.observation_space)]
    spaces += [space for env in made[2:] for space in (env.single_action_space, env.single_observation_space)]
    assert len({id(space) for space in spaces}) == len(spaces)


LONG = Task(radius=0.01, max_steps=350.0)
ENDLESS, SHORT = replace(LONG, max_steps=math.inf), replace(LONG, max_steps=40.0)


def steps_until_the_end(env):
    """Return how many steps an episode has in which the robot stands still."""
    env.reset(seed=0)
    for steps in range(1, 401):
        _, _, terminated, truncated, _ = env.step(np.zeros(env.action_space.shape, np.float32))
        assert not np.any(terminated)
        if np.any(truncated):
            return steps
    return None


@pytest.mark.parametrize(
    ("make", "options", "steps"),
    [
        (vector, {"task": LONG, "max_episode_steps": 350}, 350),
        (vector, {"task": ENDLESS}, 300),
        (vector, {"task": replace(NAV, radius=0.01)}, 300),
        (gym.make, {"task": SHORT}, 40),
        (gym.make, {"task": LONG, "max_episode_steps": 500}, 350),
        (gym.make, {"task": ENDLESS}, 300),
    ],
)
def test_an_episode_ends_at_the_tasks_own_limit_or_at_the_environments(make, options, steps):
    assert steps_until_the_end(make(**options) if make is vector else make(ID, **options)) == steps


@pytest.mark.parametrize(("task", "steps"), [(LONG, 350), (SQUARE, 600)])
def test_a_tasks_own_limit_and_the_vector_environments_must_agree(task, steps):
    rule = rf"^max_episode_steps must be that of the task, {steps}, .* got 300"
    with pytest.raises(ValueError, match=rule):
        vector(task=task)


KINDS = {
    "Nav": {},
    "Pose": {"filter": "gated", "noise": "rough", "delay": 2},
    "Square": {"switch": "time", "laps": 2, "fix": "late", "noise": "wheel"},
    "Rooms": {"world": "clutter", "lidar": "ideal"},
}


def vector_of_copies(id, num_envs=3, **options):
    return gym.make_vec(id, num_envs=num_envs, info="full", **options)


def driven(maker, kind="Nav", steps=7, **options):
    id = f"turtlebot_gym/TurtleBot{kind}-v0"
    env = maker(id, max_episode_steps=20, **KINDS[kind], **options)
    if steps:
        env.reset(seed=3)
    for _ in range(steps):
        env.step(np.full(env.action_space.shape, 0.5, np.float32))
    return env


def numbers(parts):
    """Yield all arrays and numbers in what a reset or a step returns."""
    for part in parts.values() if isinstance(parts, dict) else parts:
        if isinstance(part, (dict, tuple)):
            yield from numbers(part)
        else:
            yield np.asarray(part)


def drive(env):
    """Return a drive that goes on beyond the end of an episode."""
    log = []
    for step in range(30):
        returned = env.step(np.full(env.action_space.shape, 0.1 + 0.02 * step, np.float32))
        log += [*numbers(returned)]
        if isinstance(returned[2], bool) and (returned[2] or returned[3]):
            log += [*numbers(env.reset())]
    return log


def pickled(env):
    return pickle.loads(pickle.dumps(env))


@pytest.mark.sample(6)
@pytest.mark.parametrize("copied", [pickled, copy.deepcopy])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("maker", [gym.make, vector_of_copies])
def test_a_copied_environment_goes_on_as_the_original_does(maker, kind, copied):
    env = driven(maker, kind)
    other = copied(env)
    for first, second in zip(drive(env), drive(other), strict=True):
        np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize("maker", [gym.make, vector_of_copies])
def test_an_environment_can_be_pickled_before_its_first_reset_and_while_it_draws(maker, monkeypatch):
    env = driven(maker, steps=0)
    np.testing.assert_array_equal(pickled(env).reset(seed=1)[0], env.reset(seed=1)[0])
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    drawn, same = (driven(maker, render_mode="rgb_array") for _ in range(2))
    drawn.render()
    np.testing.assert_array_equal(pickled(drawn).render(), same.render())


LOADING = """
import json, pickle, sys
import numpy as np
with open(sys.argv[1], "rb") as file:
    env = pickle.load(file)
print(json.dumps(env.step(np.zeros((env.num_envs, 2)))[0].tobytes().hex()))
"""


def test_an_environment_that_ran_in_parallel_goes_on_in_another_process(tmp_path, run):
    env, path = driven(vector_of_copies, num_envs=2 * PARALLEL_FROM), tmp_path / "env.pickle"
    path.write_bytes(pickle.dumps(env))
    assert run(LOADING, path) == env.step(np.zeros((env.num_envs, 2)))[0].tobytes().hex()
