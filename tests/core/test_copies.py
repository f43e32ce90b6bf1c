"""A pickled environment goes on, after it is loaded, as the original does."""

import copy
import pickle
from importlib.util import find_spec

import gymnasium as gym
import numpy as np
import pytest

from turtlebot_gym.compiled.batch import PARALLEL_FROM

KINDS = {
    "Nav": {},
    "Pose": {"filter": "mixture", "noise": "rough", "delay": 2},
    "Square": {"switch": "time", "laps": 2, "fix": "late", "noise": "wheel"},
    "Rooms": {"world": "clutter", "lidar": "ideal"},
}
if find_spec("mujoco"):
    KINDS["MuJoCo"] = {"plant": "mujoco", "noise": "rough", "fix": "late"}


def vector(id, num_envs=3, **options):
    return gym.make_vec(id, num_envs=num_envs, info="full", **options)


def driven(maker, kind="Nav", steps=7, **options):
    id = f"turtlebot_gym/TurtleBot{'Nav' if kind == 'MuJoCo' else kind}-v0"
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


@pytest.mark.parametrize("copied", [pickled, copy.deepcopy])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("maker", [gym.make, vector])
def test_a_copied_environment_goes_on_as_the_original_does(maker, kind, copied):
    env = driven(maker, kind)
    other = copied(env)
    for one, two in zip(drive(env), drive(other), strict=True):
        np.testing.assert_array_equal(one, two)


@pytest.mark.parametrize("maker", [gym.make, vector])
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
    env, path = driven(vector, num_envs=2 * PARALLEL_FROM), tmp_path / "env.pickle"
    path.write_bytes(pickle.dumps(env))
    assert run(LOADING, path) == env.step(np.zeros((env.num_envs, 2)))[0].tobytes().hex()
