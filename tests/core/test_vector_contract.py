"""What clients ask of a vector environment: ours beside `SyncVectorEnv`, bare and within Gymnasium's wrappers."""

from __future__ import annotations

import copy
from functools import partial

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.vector.utils import batch_space
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


ONE = spaces.Box(-np.inf, np.inf, (13,), np.float32)
TWO = spaces.Box(-1.0, 1.0, (2,), np.float32)
WRAPPERS = {
    "bare": lambda envs: envs,
    "transformed": partial(vector.TransformObservation, func=doubled, single_observation_space=ONE),
    "row by row": lambda envs: vector.VectorizeTransformObservation(
        envs, gym.wrappers.TransformObservation, func=doubled, observation_space=ONE
    ),
    "flat": vector.FlattenObservation,
    "reshaped": partial(vector.ReshapeObservation, shape=(13, 1)),
    "rescaled": partial(vector.RescaleObservation, min_obs=np.float32(0.0), max_obs=np.float32(1.0)),
    "normalized": vector.NormalizeObservation,
    "actions": partial(vector.TransformAction, func=lambda actions: 0.5 * actions, single_action_space=TWO),
    "clipped": vector.ClipAction,
    "rescaled actions": partial(vector.RescaleAction, min_action=np.float32(-2.0), max_action=np.float32(2.0)),
    "actions row by row": lambda envs: vector.VectorizeTransformAction(envs, gym.wrappers.ClipAction),
    "rewards": partial(vector.TransformReward, func=doubled),
    "clipped rewards": partial(vector.ClipReward, min_reward=0.0, max_reward=0.01),
    "normalized rewards": vector.NormalizeReward,
    "rewards row by row": lambda envs: vector.VectorizeTransformReward(envs, gym.wrappers.TransformReward, func=doubled),
    "statistics": vector.RecordEpisodeStatistics,
    "lists": vector.DictInfoToList,
    "both": lambda envs: vector.DictInfoToList(vector.RecordEpisodeStatistics(envs)),
}
OF_OBSERVATIONS = ("transformed", "row by row", "flat", "reshaped", "rescaled", "normalized")
"""Those that Gymnasium refuses to put around an environment in the mode SAME_STEP."""
ONE_MODE = ("normalized",)
"""Those that it refuses in DISABLED too."""


def actions(step):
    return np.random.default_rng(step).uniform(-1.0, 1.0, (N, 2)).astype(np.float32)


def drive(envs, mode, steps=16):
    """Yield what an environment returns, as most training loops would call it."""
    yield envs.reset(seed=3)
    for step in range(steps):
        returned = envs.step(actions(step))
        yield returned
        done = returned[2] | returned[3]
        if mode is DISABLED and done.any():
            yield envs.reset(options={"reset_mask": done})
        elif step == 8:
            yield envs.reset(seed=[5, None, None])


def compare(told, expected):
    """Compare infos for the keys that both have, but for times; and return how many numbers those were."""
    if isinstance(told, list):
        return sum(compare(one, other) for one, other in zip(told, expected, strict=True))
    count = 0
    for key in set(told) & set(expected) - {"t"}:
        if isinstance(told[key], dict):
            count += compare(told[key], expected[key])
        elif key.lstrip("_") != "final_obs":
            np.testing.assert_array_equal(told[key], expected[key], err_msg=key)
            count += np.size(told[key])
    return count


@pytest.mark.parametrize("mode", AutoresetMode)
@pytest.mark.parametrize("name", WRAPPERS)
def test_within_gymnasiums_wrappers_ours_is_sync_vector_env(name, mode):
    if name in (OF_OBSERVATIONS if mode is SAME_STEP else ONE_MODE if mode is DISABLED else ()):
        with pytest.raises(ValueError, match="autoreset_mode"):
            WRAPPERS[name](native(mode=mode))
        return
    ours, theirs = WRAPPERS[name](native(mode=mode)), WRAPPERS[name](sync(mode=mode))
    assert ours.observation_space == theirs.observation_space
    assert ours.action_space == theirs.action_space
    compared = 0
    for seen, expected in zip(drive(ours, mode), drive(theirs, mode), strict=True):
        assert len(seen) == len(expected)
        for one, other in zip(seen[:-1], expected[:-1], strict=True):
            np.testing.assert_array_equal(one, other)
            assert (one.dtype, one.shape) == (other.dtype, other.shape)
        compared += compare(seen[-1], expected[-1])
    assert compared > 100
    for envs in (ours, theirs):
        envs.close()


@pytest.mark.parametrize("id", IDS)
@pytest.mark.parametrize("mode", AutoresetMode)
def test_every_environment_is_sync_vector_env(id, mode):
    for seen, expected in zip(drive(native(id, mode), mode, 9), drive(sync(id, mode), mode, 9), strict=True):
        for one, other in zip(seen[:-1], expected[:-1], strict=True):
            np.testing.assert_array_equal(one, other)
        assert compare(seen[-1], expected[-1]) > 0


@pytest.mark.parametrize("id", IDS)
def test_spaces_are_batches_of_the_scalar_ones(id):
    envs, env = native(id), gym.make(id)
    assert envs.num_envs == N
    assert envs.single_observation_space == env.observation_space
    assert envs.single_action_space == env.action_space
    assert envs.observation_space == batch_space(env.observation_space, N)
    assert envs.action_space == batch_space(env.action_space, N)
    assert envs.spec.id == id
    assert id in repr(envs)
    envs.action_space.seed(0)
    other = native(id)
    other.action_space.seed(0)
    envs.action_space.sample()
    np.testing.assert_array_equal(other.action_space.sample(), native_sample(id))


def native_sample(id):
    space = native(id).action_space
    space.seed(0)
    return space.sample()


@pytest.mark.parametrize("id", IDS)
def test_seeds(id):
    envs = native(id)
    first, _ = envs.reset(seed=7)
    assert len({row.tobytes() for row in first}) == N
    for seed in (7, np.int64(7), [7, 8, 9], (7, 8, 9)):
        np.testing.assert_array_equal(envs.reset(seed=seed)[0], first)
    np.testing.assert_array_equal(envs.reset(seed=[9, 7, 8])[0], first[[2, 0, 1]])
    envs.reset(seed=7)
    then, _ = envs.reset()
    assert (then != first).any(axis=1).all()
    envs.reset(seed=7)
    np.testing.assert_array_equal(envs.reset(seed=[None, None, None])[0], then)
    for seeds in ([1, 2], [1, 2, 3, 4]):
        with pytest.raises(ValueError, match=f"seed must hold 3 seeds, got {len(seeds)}"):
            envs.reset(seed=seeds)
    assert envs.np_random_seed == 7
    assert isinstance(envs.np_random, np.random.Generator)


@pytest.mark.parametrize("mode", AutoresetMode)
def test_a_mask_seeds_the_rows_in_it(mode):
    envs, mask = native(mode=mode), np.array([True, False, True])
    before, _ = envs.reset(seed=1)
    after, _ = envs.reset(seed=50, options={"reset_mask": mask})
    np.testing.assert_array_equal(after[1], before[1])
    np.testing.assert_array_equal(after[mask], native().reset(seed=50)[0][mask])


OTHER_MASKS = [[True, False, True], np.ones(2, np.bool_), np.ones((3, 1), np.bool_), np.array([1, 0, 1]), np.zeros(3, np.bool_)]


@pytest.mark.parametrize("mask", OTHER_MASKS, ids=["list", "short", "deep", "numbers", "empty"])
def test_a_mask_of_another_form_is_refused(mask):
    envs = native()
    envs.reset(seed=0)
    with pytest.raises(ValueError, match="reset_mask must be"):
        envs.reset(options={"reset_mask": mask})


def test_what_was_returned_stays():
    envs = native(mode=SAME_STEP, info="full")
    kept = []
    for returned in drive(envs, SAME_STEP):
        kept.append((returned, copy.deepcopy(returned)))
    for returned, before in kept:
        for one, other in zip(returned[:-1], before[:-1], strict=True):
            np.testing.assert_array_equal(one, other)
        assert compare(returned[-1], before[-1]) > 0


def test_none_in_final_obs_is_what_clients_test_for():
    envs, last = native(mode=SAME_STEP), []
    envs.reset(seed=0)
    envs.step(actions(0))
    envs.reset(options={"reset_mask": np.array([False, True, False])})
    for step in range(LIMIT):
        observations, _, _, truncated, infos = envs.step(actions(step))
        for row, obs in enumerate(infos.get("final_obs", [])):
            if obs is not None:
                assert obs in envs.single_observation_space
                assert (obs != observations[row]).any()
                last.append(row)
        if "final_obs" in infos:
            np.testing.assert_array_equal(infos["_final_obs"], truncated)
            assert np.stack(infos["final_obs"][truncated]).shape == (truncated.sum(), 13)
    assert last == [0, 2, 1]


def test_closing_is_for_good_and_may_be_repeated():
    envs = native(render_mode="rgb_array")
    envs.reset(seed=0)
    envs.render()
    assert not envs.closed
    for _ in range(2):
        envs.close()
    assert envs.closed
