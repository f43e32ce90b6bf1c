"""Laws of a vector environment that `SyncVectorEnv` cannot show: rows, arrays, masks and modes, of every kind."""

from copy import deepcopy

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space

import turtlebot_gym  # noqa: F401  # registers the environments

OPTIONS = {"Nav": {}, "Pose": {"info": "full"}, "Square": {"noise": "rough"}, "Rooms": {"world": "office", "lidar": "a1"}}
NEXT_STEP, SAME_STEP, DISABLED = AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP, AutoresetMode.DISABLED
N, LIMIT, STEPS = 3, 5, 16
FIRST = np.arange(N) == 0

each_mode = pytest.mark.parametrize("mode", AutoresetMode)
each = pytest.mark.parametrize("name", OPTIONS)


def make(name="Nav", mode=NEXT_STEP, num_envs=N):
    options = {"autoreset_mode": mode, "max_episode_steps": LIMIT, **OPTIONS[name]}
    return gym.make_vec(f"turtlebot_gym/TurtleBot{name}-v0", num_envs=num_envs, **options)


def actions(step, junk=0):
    return np.random.default_rng((step, junk)).uniform(-1.0, 1.0, (N, 2)).astype(np.float32)


def play(envs, mode, junk=0, change=lambda returned: None):
    """Return copies of what each call returned; `change` sees the arrays themselves, and ended rows take `junk` actions."""
    returned = [envs.reset(seed=3)]
    kept = deepcopy(returned)
    change(returned[0])
    ended = np.zeros(N, np.bool_)
    for step in range(STEPS):
        given = actions(step)
        if mode is NEXT_STEP and junk:
            given[ended] = actions(step, junk)[ended]
        before = given.copy()
        returned.append(envs.step(given))
        np.testing.assert_array_equal(given, before)
        kept.append(deepcopy(returned[-1]))
        ended = kept[-1][2] | kept[-1][3]
        change(returned[-1])
        if mode is DISABLED and ended.any():
            envs.reset(options={"reset_mask": ended.copy()})
    return kept, returned


def scribble(value):
    """Overwrite all arrays of numbers."""
    if isinstance(value, np.ndarray) and value.dtype != object and value.flags.writeable:
        value[...] = 1
    elif isinstance(value, (tuple, list, dict, np.ndarray)):
        for item in value.values() if isinstance(value, dict) else value:
            scribble(item)


@each
@each_mode
def test_arrays_are_the_callers_own(name, mode):
    kept, returned = play(make(name, mode), mode)
    assert data_equivalence(returned, kept, exact=True)  # no later step wrote into an earlier one's arrays
    assert data_equivalence(play(make(name, mode), mode, change=scribble)[0], kept, exact=True)


@each
def test_the_next_step_after_an_end_ignores_its_action(name):
    assert data_equivalence(play(make(name), NEXT_STEP)[0], play(make(name), NEXT_STEP, junk=1)[0], exact=True)


@each
@each_mode
def test_spaces_mode_masks_and_truncation(name, mode):
    envs = make(name, mode)
    assert envs.metadata["autoreset_mode"] is envs.autoreset_mode is mode
    assert (envs.observation_space, envs.num_envs) == (batch_space(envs.single_observation_space, N), N)
    kept, _ = play(envs, mode)
    assert all(returned[0] in envs.observation_space for returned in kept)
    assert kept[LIMIT][3].all() or kept[LIMIT][2].any()
    for infos in (returned[-1] for returned in kept):
        assert all(infos[f"_{key}"].dtype == np.bool_ for key in infos if not key.startswith("_"))
    for _ in range(2):
        envs.close()
    assert envs.closed


@each
def test_a_mask_begins_its_rows_anew_and_leaves_the_others_and_the_options(name):
    envs, twin, options = make(name), make(name), {"reset_mask": FIRST.copy()}
    envs.reset(seed=1)
    twin.reset(seed=1)
    for step in range(2):
        last = envs.step(actions(step))[0]
        twin.step(actions(step))
    observations, infos = envs.reset(seed=50, options=options)
    np.testing.assert_array_equal(options["reset_mask"], FIRST)
    np.testing.assert_array_equal(observations[1:], last[1:])
    assert not any((infos[key] & ~FIRST).any() for key in infos if key.startswith("_"))
    np.testing.assert_array_equal(observations[0], make(name, num_envs=1).reset(seed=50)[0][0])
    np.testing.assert_array_equal(envs.step(actions(2))[0][1:], twin.step(actions(2))[0][1:])
    with pytest.raises(ValueError, match="seed"):
        envs.reset(seed=[1] * (N + 1))
