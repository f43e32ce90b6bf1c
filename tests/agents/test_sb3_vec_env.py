"""The adapter to Stable-Baselines3 beside SB3's own vector environment, row by row, and under SB3's wrappers."""

import copy

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from stable_baselines3 import PPO
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, VecCheckNan, VecFrameStack, VecMonitor, VecNormalize, VecVideoRecorder

import turtlebot_gym  # noqa: F401  # registers its environments
from turtlebot_gym_agents.training.sb3_vec_env import Sb3VecEnv

SAME_STEP = AutoresetMode.SAME_STEP
NAV = "turtlebot_gym/TurtleBotNav-v0"
SPACES = {
    "box": spaces.Box(-1.0, 1.0, (2, 2), np.float32),
    "discrete": spaces.Discrete(9),
    "binary": spaces.MultiBinary(3),
    "choices": spaces.MultiDiscrete([3, 4]),
    "dict": spaces.Dict({"far": spaces.Box(-1.0, 1.0, (2,), np.float32), "near": spaces.Discrete(5)}),
    "tuple": spaces.Tuple((spaces.Discrete(5), spaces.Box(-1.0, 1.0, (2,), np.float32))),
}

SCALES = {}, {"reward_scale": 0.25}


class Noted(gym.Env):
    """Notes the options of its resets, and ends after a given number of steps."""

    def __init__(self, name: int, space: spaces.Space, steps: int = 3):
        self.name, self.steps, self.observation_space = name, steps, space
        self.action_space = spaces.Box(-1.0, 1.0, (1,), np.float32)
        self.resets, self.at = [], 0

    def _sample(self):
        self.observation_space.seed(1000 * self.name + self.at)
        return self.observation_space.sample()

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.resets.append((seed, options))
        self.at = 0
        return self._sample(), {"seed": -1 if seed is None else seed}

    def step(self, action):
        self.at += 1
        return self._sample(), float(action[0]) + self.name, self.at >= self.steps and self.name != 1, self.at >= self.steps, {}

    def shout(self, times, *, end="!"):
        return f"{self.name}" * times + end


def ours(space="box", n=3, **options):
    return Sb3VecEnv(SyncVectorEnv([row(i, space) for i in range(n)], autoreset_mode=SAME_STEP, **options))


def theirs(space="box", n=3):
    return DummyVecEnv([row(i, space) for i in range(n)])


def row(i, space):
    return lambda: Monitor(Noted(i, SPACES[space]))


def same(value, other):
    if not isinstance(value, (dict, tuple)):
        return np.array_equal(value, other)
    keys = value if isinstance(value, dict) else range(len(value))
    return (
        isinstance(value, dict) == isinstance(other, dict)
        and len(value) == len(other)
        and all(same(value[key], other[key]) for key in keys)
    )


WRAPPERS = {"stacked": lambda env: VecFrameStack(env, 3), "normalized": VecNormalize}


@pytest.mark.parametrize(("space", "wrapper"), [*((space, None) for space in SPACES), *(("box", name) for name in WRAPPERS)])
def test_every_kind_of_space_and_what_wrappers_see_is_as_with_sb3s_own(space, wrapper):
    wrap = WRAPPERS.get(wrapper, lambda env: env)
    actions = [np.full((3, 1), 0.1 * step, np.float32) for step in range(8)]
    assert compared(wrap(ours(space)), wrap(theirs(space)), actions)[0] == 6


def test_episodes_are_those_of_sb3s_own_vector_environment():
    random, shape = np.random.default_rng(7), (650, 20)
    # In circles, so that some arrive, while others time out.
    actions = np.stack([np.full(shape, 0.5), random.uniform(0.0, 0.1, shape)], axis=-1).astype(np.float32)
    ends, timeouts = compared(native(20), DummyVecEnv([lambda: Monitor(gym.make(NAV))] * 20), actions)
    assert 0 < timeouts < ends  # else half of this was not tested


def compared(mine, other, steps):
    """Require the same answers of two environments to the same actions; return how many episodes ended and timed out."""
    assert (mine.observation_space, mine.action_space) == (other.observation_space, other.action_space)
    assert mine.seed(40) == other.seed(40)
    assert same(mine.reset(), other.reset())
    ends, timeouts = 0, 0
    for actions in steps:
        observations, rewards, dones, infos = mine.step(actions)
        expected, expected_rewards, expected_dones, expected_infos = copy.deepcopy(other.step(actions))
        assert same(observations, expected)
        np.testing.assert_array_equal(rewards, expected_rewards)
        np.testing.assert_array_equal(dones, expected_dones)
        assert (rewards.dtype, dones.dtype) == (expected_rewards.dtype, np.bool_)
        for info, other_info in zip(infos, expected_infos, strict=True):
            assert ("terminal_observation" in info) == ("terminal_observation" in other_info)
            if info:
                ends, timeouts = ends + 1, timeouts + info["TimeLimit.truncated"]
                assert same(info["terminal_observation"], other_info["terminal_observation"])
                assert info["TimeLimit.truncated"] == other_info["TimeLimit.truncated"]
                assert all(info["episode"][name] == other_info["episode"][name] for name in ("r", "l"))
                assert info.get("is_success") == other_info.get("is_success")
    return ends, timeouts


def native(n, **options):
    return Sb3VecEnv(gym.make_vec(NAV, num_envs=n, autoreset_mode=SAME_STEP, **options))


def test_sb3_records_videos_and_tiles_of_the_first_rows(tmp_path, monkeypatch):
    pytest.importorskip("moviepy")
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    inner = native(3, render_mode="rgb_array", render_rows=2)
    env = VecVideoRecorder(inner, str(tmp_path), lambda step: step == 0, video_length=4)
    assert (env.frames_per_sec, env.render_mode) == (10, "rgb_array")
    env.reset()
    np.testing.assert_array_equal(inner.render(), np.concatenate(inner.get_images()))
    for _ in range(6):
        env.step(np.zeros((3, 2), np.float32))
    env.close()
    (film,) = tmp_path.glob("*.mp4")
    assert film.stat().st_size > 1000
    with pytest.warns(UserWarning, match="render_mode"):
        native(3).render()


def test_sb3s_wrappers_work_on_top():
    with pytest.warns(UserWarning, match="overwritten by the `VecMonitor` ones"):  # which they may well be
        monitored = VecMonitor(native(8))
    env = VecCheckNan(VecNormalize(VecFrameStack(monitored, 2)), raise_exception=True)
    model = PPO("MlpPolicy", env, n_steps=320, batch_size=512, n_epochs=1, device="cpu", seed=0)
    model.learn(8 * 320)
    assert len(model.ep_info_buffer) >= 8
    assert {"r", "l", "t"} <= set(model.ep_info_buffer[0])
    assert env.get_attr("num_envs") == [8] * 8


def test_a_reset_of_some_rows_continues_the_others_and_their_returns():
    env, still = native(2, max_episode_steps=4), np.zeros((2, 2), np.float32)
    env.reset()
    before = env.step(still)[0]
    env.set_options({"reset_mask": np.array([True, False])})
    assert (env.reset() != before).any(axis=1).tolist() == [bool(info) for info in env.reset_infos] == [True, False]
    lengths = [[info["episode"]["l"] for info in env.step(still)[3] if info] for _ in range(4)]
    assert lengths == [[], [], [4], [4]]
    env.set_options([{}, {"start": 1}])
    with pytest.raises(ValueError, match="options must be one for all rows"):
        env.reset()


def test_the_algorithm_sees_scaled_rewards_and_infos_those_of_the_environment():
    rows = [Sb3VecEnv(SyncVectorEnv([row(i, "box") for i in range(3)], autoreset_mode=SAME_STEP), **more) for more in SCALES]
    for adapter in rows:
        adapter.reset()
    for _ in range(3):
        (_, plain, dones, infos), (_, scaled, _, others) = (adapter.step(np.ones((3, 1), np.float32)) for adapter in rows)
        np.testing.assert_array_equal(scaled, 0.25 * plain)
    assert dones.all()
    assert [info["episode"]["r"] for info in others] == [info["episode"]["r"] for info in infos] == [3.0, 6.0, 9.0]
