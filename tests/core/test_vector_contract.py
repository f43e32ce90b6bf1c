"""What clients ask of a vector environment: what `SyncVectorEnv` does, bare and in Gymnasium's wrappers."""

import gymnasium as gym
import numpy as np
import pytest
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


def actions(step):
    return np.random.default_rng(step).uniform(-1.0, 1.0, (N, 2)).astype(np.float32)


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


@pytest.mark.parametrize("id", IDS)
@pytest.mark.parametrize("mode", AutoresetMode)
def test_every_environment_is_sync_vector_env(id, mode):
    ours, theirs, mask, compared = native(id, mode, info="full"), sync(id, mode), np.array([False, True, False]), 0
    assert (ours.observation_space, ours.action_space) == (theirs.observation_space, theirs.action_space)
    for seen, expected in zip(drive(ours, mode, mask), drive(theirs, mode, mask), strict=True):
        for outcome, other in zip(seen[:-1], expected[:-1], strict=True):
            np.testing.assert_array_equal(outcome, other)
            assert (outcome.dtype, outcome.shape) == (other.dtype, other.shape)
        compared += compare(seen[-1], expected[-1])
    assert compared > 100


@pytest.mark.parametrize("wrapper", [vector.RecordEpisodeStatistics, vector.NormalizeReward, vector.NormalizeObservation])
def test_within_gymnasiums_wrappers_too(wrapper):
    for seen, expected in zip(drive(wrapper(native()), NEXT_STEP), drive(wrapper(sync()), NEXT_STEP), strict=True):
        for outcome, other in zip(seen[:-1], expected[:-1], strict=True):
            np.testing.assert_array_equal(outcome, other)
