"""What clients ask of a vector environment: what `SyncVectorEnv` does, and laws of rows, arrays, masks and modes."""

from copy import deepcopy

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers import vector

import turtlebot_gym  # noqa: F401  # registers the environments

OPTIONS = {"Nav": {}, "Pose": {"info": "full"}, "Square": {"noise": "rough"}, "Rooms": {"world": "office", "lidar": "a1"}}
NEXT_STEP, DISABLED = AutoresetMode.NEXT_STEP, AutoresetMode.DISABLED
N, LIMIT, STEPS = 3, 5, 16
FIRST = np.arange(N) == 0

each_mode = pytest.mark.parametrize("mode", AutoresetMode)
each = pytest.mark.parametrize("name", OPTIONS)


def make(name="Nav", mode=NEXT_STEP, num_envs=N, **options):
    options = {"autoreset_mode": mode, "max_episode_steps": LIMIT, **OPTIONS[name], **options}
    return gym.make_vec(f"turtlebot_gym/TurtleBot{name}-v0", num_envs=num_envs, **options)


def sync(name="Nav", mode=NEXT_STEP):
    options = {key: value for key, value in OPTIONS[name].items() if key != "info"}
    alone = lambda: gym.make(f"turtlebot_gym/TurtleBot{name}-v0", max_episode_steps=LIMIT, **options)  # noqa: E731
    return SyncVectorEnv([alone] * N, autoreset_mode=mode)


def actions(step, junk=0):
    return np.random.default_rng((step, junk)).uniform(-1.0, 1.0, (N, 2)).astype(np.float32)


def drive(envs, mode, mask=None, steps=14):
    """Yield what an environment returns, as most training loops would call it; a mask breaks some episodes off."""
    yield envs.reset(seed=3)
    for step in range(steps):
        returned = envs.step(actions(step))
        yield returned
        done = returned[2] | returned[3]
        if mode is DISABLED and done.any():
            yield envs.reset(options={"reset_mask": done})
        elif step == 8:
            yield envs.reset(seed=[5, None, None])
        elif step == 2 and mask is not None:
            yield envs.reset(options={"reset_mask": mask.copy()})


def compare(values, expected):
    """Compare infos for the keys that both have, but for times; and return how many numbers those were."""
    if isinstance(values, list):
        return sum(compare(value, other) for value, other in zip(values, expected, strict=True))
    count = 0
    assert ("final_obs" in values) == ("final_obs" in expected)
    for key in set(values) & set(expected) - {"t"}:
        if isinstance(values[key], dict):
            count += compare(values[key], expected[key])
        else:
            for value, other in zip(np.atleast_1d(values[key]), np.atleast_1d(expected[key]), strict=True):
                np.testing.assert_array_equal(value, other, err_msg=key)
                assert key != "final_obs" or getattr(value, "dtype", None) == getattr(other, "dtype", None)
            count += np.size(values[key])
    return count


@each
@each_mode
def test_every_environment_is_sync_vector_env(name, mode):
    ours, theirs, mask, compared = make(name, mode, info="full"), sync(name, mode), np.array([False, True, False]), 0
    assert (ours.observation_space, ours.action_space) == (theirs.observation_space, theirs.action_space)
    assert ours.metadata["autoreset_mode"] is ours.autoreset_mode is mode
    for seen, expected in zip(drive(ours, mode, mask), drive(theirs, mode, mask), strict=True):
        assert seen[0] in ours.observation_space
        for outcome, other in zip(seen[:-1], expected[:-1], strict=True):
            np.testing.assert_array_equal(outcome, other)
            assert (outcome.dtype, outcome.shape) == (other.dtype, other.shape)
        assert all(seen[-1][key].dtype == np.bool_ for key in seen[-1] if key.startswith("_"))
        compared += compare(seen[-1], expected[-1])
    assert compared > 100
    for _ in range(2):
        ours.close()
    assert ours.closed


@pytest.mark.parametrize("wrapper", [vector.RecordEpisodeStatistics, vector.NormalizeReward, vector.NormalizeObservation])
def test_within_gymnasiums_wrappers_too(wrapper):
    for seen, expected in zip(drive(wrapper(make()), NEXT_STEP), drive(wrapper(sync()), NEXT_STEP), strict=True):
        for outcome, other in zip(seen[:-1], expected[:-1], strict=True):
            np.testing.assert_array_equal(outcome, other)


# What `SyncVectorEnv` cannot show.


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
