"""A pickled environment goes on, after it is loaded, as the original does."""

from __future__ import annotations

import copy
import pickle
import subprocess
import sys
from importlib.util import find_spec

import gymnasium as gym
import numpy as np
import pytest

KINDS = {
    "Nav": {},
    "Pose": {"filter": "mixture", "noise": "rough", "delay": 2},
    "Square": {"switch": "time", "laps": 2, "fix": "late", "noise": "wheel"},
    "Rooms": {"world": "clutter", "lidar": "ideal"},
}
if find_spec("mujoco"):
    KINDS["MuJoCo"] = {"plant": "mujoco", "noise": "rough", "fix": "late"}
MAKERS = {"scalar": gym.make, "vector": lambda id, **options: gym.make_vec(id, num_envs=3, info="full", **options)}


def made(maker, kind, **options):
    id = "turtlebot_gym/TurtleBotNav-v0" if kind == "MuJoCo" else f"turtlebot_gym/TurtleBot{kind}-v0"
    env = MAKERS[maker](id, max_episode_steps=20, **KINDS[kind], **options)
    env.reset(seed=3)
    for _ in range(7):
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


@pytest.mark.parametrize("copied", [lambda env: pickle.loads(pickle.dumps(env)), copy.deepcopy], ids=["pickle", "deepcopy"])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("maker", MAKERS)
def test_a_copied_environment_goes_on_as_the_original_does(maker, kind, copied):
    env = made(maker, kind)
    other = copied(env)
    for one, two in zip(drive(env), drive(other), strict=True):
        np.testing.assert_array_equal(one, two)


def test_an_environment_that_was_never_reset_can_be_pickled():
    for maker in MAKERS.values():
        env = maker("turtlebot_gym/TurtleBotNav-v0")
        other = pickle.loads(pickle.dumps(env))
        np.testing.assert_array_equal(env.reset(seed=1)[0], other.reset(seed=1)[0])


def test_an_environment_that_draws_can_be_pickled(monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    for maker in MAKERS:
        env = made(maker, "Nav", render_mode="rgb_array")
        env.render()
        np.testing.assert_array_equal(
            pickle.loads(pickle.dumps(env)).render(), made(maker, "Nav", render_mode="rgb_array").render()
        )


LOADING = """
import pickle, sys
import numpy as np
env = pickle.load(open(sys.argv[1], "rb"))
print(env.step(np.zeros((3, 2)))[0].tolist())
"""


def test_another_process_loads_an_environment(tmp_path):
    env = made("vector", "Nav")
    path = tmp_path / "env.pickle"
    path.write_bytes(pickle.dumps(env))
    printed = subprocess.check_output([sys.executable, "-c", LOADING, str(path)], text=True)
    assert printed.strip() == str(env.step(np.zeros((3, 2)))[0].tolist())
