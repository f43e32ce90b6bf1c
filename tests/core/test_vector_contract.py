"""What clients ask of a vector environment: beside `SyncVectorEnv`, bare and in Gymnasium's wrappers."""

from functools import partial

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers import vector

import turtlebot_gym  # noqa: F401  # registers the environments

IDS = [f"turtlebot_gym/TurtleBot{name}-v0" for name in ("Nav", "Pose", "Square", "Rooms")]
NAV = IDS[0]
NEXT_STEP, SAME_STEP, DISABLED = AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP, AutoresetMode.DISABLED
N, LIMIT = 3, 6


def native(id=NAV, mode=NEXT_STEP, **options):
    return gym.make_vec(id, num_envs=N, autoreset_mode=mode, max_episode_steps=LIMIT, **options)


def sync(id=NAV, mode=NEXT_STEP):
    return SyncVectorEnv([lambda: gym.make(id, max_episode_steps=LIMIT)] * N, autoreset_mode=mode)


def doubled(x):
    return 2 * x


WRAPPERS = {
    "bare": lambda envs: envs,
    "transformed": partial(
        vector.TransformObservation, func=doubled, single_observation_space=spaces.Box(-np.inf, np.inf, (13,), np.float32)
    ),
    "normalized": vector.NormalizeObservation,
    "actions row by row": lambda envs: vector.VectorizeTransformAction(envs, gym.wrappers.ClipAction),
    "normalized rewards": vector.NormalizeReward,
    "statistics": vector.RecordEpisodeStatistics,
}
REFUSED = {("transformed", SAME_STEP), ("normalized", SAME_STEP), ("normalized", DISABLED)}
"""Modes in which Gymnasium refuses to put a wrapper around an environment."""


def actions(step):
    return np.random.default_rng(step).uniform(-1.0, 1.0, (N, 2)).astype(np.float32)


def drive(envs, mode, steps=16, mask=None):
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


def assert_same(ours, theirs, mode, *how):
    """Require the same of two environments in a drive; return how many numbers of their infos were compared."""
    compared = 0
    for seen, expected in zip(drive(ours, mode, *how), drive(theirs, mode, *how), strict=True):
        for outcome, other in zip(seen[:-1], expected[:-1], strict=True):
            np.testing.assert_array_equal(outcome, other)
            assert (outcome.dtype, outcome.shape) == (other.dtype, other.shape)
        compared += compare(seen[-1], expected[-1])
    return compared


@pytest.mark.parametrize("mode", AutoresetMode)
@pytest.mark.parametrize("name", WRAPPERS)
def test_within_gymnasiums_wrappers_ours_is_sync_vector_env(name, mode):
    if (name, mode) in REFUSED:
        with pytest.raises(ValueError, match="autoreset_mode"):
            WRAPPERS[name](native(mode=mode))
        return
    ours, theirs = WRAPPERS[name](native(mode=mode)), WRAPPERS[name](sync(mode=mode))
    assert ours.observation_space == theirs.observation_space
    assert ours.action_space == theirs.action_space
    assert assert_same(ours, theirs, mode) > 100


@pytest.mark.parametrize("id", IDS)
@pytest.mark.parametrize("mode", AutoresetMode)
def test_every_environment_is_sync_vector_env(id, mode):
    assert assert_same(native(id, mode, info="full"), sync(id, mode), mode, 14, np.array([False, True, False])) > 100
