"""What Stable-Baselines3 expects of a VecEnv's rows, asked of the adapter over `SyncVectorEnv` and of its own `DummyVecEnv`."""

from __future__ import annotations

import warnings

import gymnasium as gym
import numpy as np
import pytest
import torch
from gymnasium import spaces
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv
from gymnasium.wrappers.vector import RecordEpisodeStatistics
from stable_baselines3 import PPO, SAC, HerReplayBuffer
from stable_baselines3.common.envs import BitFlippingEnv
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, VecFrameStack, VecNormalize, VecVideoRecorder

import turtlebot_gym  # noqa: F401  # registers its environments
from turtlebot_gym_agents.training.sb3_vec_env import Sb3VecEnv

SAME_STEP = AutoresetMode.SAME_STEP
NAV, ROOMS = "turtlebot_gym/TurtleBotNav-v0", "turtlebot_gym/TurtleBotRooms-v0"
torch.set_num_threads(1)

SPACES = {
    "box": spaces.Box(-1.0, 1.0, (2, 2), np.float32),
    "discrete": spaces.Discrete(9),
    "binary": spaces.MultiBinary(3),
    "choices": spaces.MultiDiscrete([3, 4]),
    "dict": spaces.Dict({"far": spaces.Box(-1.0, 1.0, (2,), np.float32), "near": spaces.Discrete(5)}),
    "tuple": spaces.Tuple((spaces.Discrete(5), spaces.Box(-1.0, 1.0, (2,), np.float32))),
}


class Noted(gym.Env):
    """Notes with what it was reset, and ends after as many steps as it is told."""

    def __init__(self, name: int, space: spaces.Space, steps: int = 3):
        self.name, self.steps, self.observation_space = name, steps, space
        self.action_space = spaces.Box(-1.0, 1.0, (1,), np.float32)
        self.resets, self.at = [], 0

    def _told(self):
        self.observation_space.seed(1000 * self.name + self.at)
        return self.observation_space.sample()

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.resets.append((seed, options))
        self.at = 0
        return self._told(), {"seed": -1 if seed is None else seed}

    def step(self, action):
        self.at += 1
        return self._told(), float(action[0]) + self.name, self.at >= self.steps and self.name != 1, self.at >= self.steps, {}

    def shout(self, times, *, end="!"):
        return f"{self.name}" * times + end


def ours(space="box", n=3, **options):
    return Sb3VecEnv(SyncVectorEnv([row(i, space) for i in range(n)], autoreset_mode=SAME_STEP, **options))


def theirs(space="box", n=3):
    return DummyVecEnv([row(i, space) for i in range(n)])


def row(i, space):
    return lambda: Monitor(Noted(i, SPACES[space]))


both = pytest.mark.parametrize("make", [ours, theirs], ids=["ours", "theirs"])


@both
def test_rows_are_addressed_one_by_one(make):
    env = make()
    assert env.get_attr("name") == [0, 1, 2]
    assert env.get_attr("name", 1) == [1]
    assert env.get_attr("name", [2, 0]) == [2, 0]
    assert env.env_method("shout", 2) == ["00!", "11!", "22!"]
    assert env.env_method("shout", 1, indices=[1], end="?") == ["1?"]
    assert env.env_method("shout", times=3, indices=2) == ["222!"]
    env.set_attr("mark", "all")
    env.set_attr("mark", "one", 1)
    env.set_attr("mark", "two", [0])
    assert env.get_attr("mark") == ["two", "one", "all"]
    assert (env.has_attr("name"), env.has_attr("nothing")) == (True, False)
    with pytest.raises(AttributeError, match="nothing"):
        env.get_attr("nothing")
    with pytest.raises(AttributeError, match="nothing"):
        env.env_method("nothing")
    assert env.env_is_wrapped(Monitor) == [True, True, True]
    assert env.env_is_wrapped(gym.wrappers.TimeLimit, [0, 1]) == [False, False]


def test_an_attribute_is_set_where_it_is():
    env = ours()
    env.set_attr("steps", 1, 2)  # SB3's own would set it on the Monitor around, which nothing reads
    env.reset()
    assert env.step(np.zeros((3, 1), np.float32))[2].tolist() == [False, False, True]


def test_wrappers_of_rows_are_seen():
    made = [lambda: gym.wrappers.TimeLimit(Noted(0, SPACES["box"]), 5), lambda: Noted(1, SPACES["box"])]
    env = Sb3VecEnv(SyncVectorEnv(made, autoreset_mode=SAME_STEP))
    assert env.env_is_wrapped(gym.wrappers.TimeLimit) == [True, False]


@both
def test_seeds_and_options_are_those_of_each_row_and_count_once(make):
    env = make()
    env.seed(7)
    env.reset()
    assert [info["seed"] for info in env.reset_infos] == [7, 8, 9]
    for _ in range(2):
        env.reset()
    assert [info["seed"] for info in env.reset_infos] == [-1, -1, -1]
    env.seed(20)
    env.set_options([{"a": 1}, {"a": 2}, {}])
    env.reset()
    env.reset()
    for resets, name, options in zip(env.get_attr("resets"), range(3), ({"a": 1}, {"a": 2}, {}), strict=True):
        (seed, told), (after, none) = resets[-2:]
        assert (seed, told or {}, after, none or {}) == (20 + name, options, None, {})


def test_options_of_one_row_count_at_the_first_reset_too():
    env = ours()
    env.seed(3)
    env.set_options([{}, {"a": 2}, {}])
    env.reset()
    assert [resets[-1][0] for resets in env.get_attr("resets")] == [3, 4, 5]
    assert [bool(resets[-1][1]) for resets in env.get_attr("resets")] == [False, True, False]
    assert [info["seed"] for info in env.reset_infos] == [3, 4, 5]


def same(one, other):
    if isinstance(one, (dict, tuple)):
        keys = one if isinstance(one, dict) else range(len(one))
        assert isinstance(one, dict) == isinstance(other, dict)
        assert len(one) == len(other)
        assert all(same(one[key], other[key]) for key in keys)
        return True
    np.testing.assert_array_equal(one, other)
    return True


@pytest.mark.parametrize("space", SPACES)
def test_observations_of_every_kind_of_space_are_sb3s(space):
    mine, other = ours(space), theirs(space)
    assert (mine.observation_space, mine.action_space) == (other.observation_space, other.action_space)
    assert same(mine.reset(), other.reset())
    ends = 0
    for step in range(8):
        actions = np.full((3, 1), 0.1 * step, np.float32)
        observations, rewards, dones, infos = mine.step(actions)
        expected, expected_rewards, expected_dones, expected_infos = other.step(actions)
        assert same(observations, expected)
        np.testing.assert_array_equal(rewards, expected_rewards)
        np.testing.assert_array_equal(dones, expected_dones)
        for info, told in zip(infos, expected_infos, strict=True):
            assert ("terminal_observation" in info) == ("terminal_observation" in told)
            if info:
                ends += 1
                assert same(info["terminal_observation"], told["terminal_observation"])
                assert info["TimeLimit.truncated"] == told["TimeLimit.truncated"]
    assert ends == 6


def test_returned_arrays_do_not_change_afterwards():
    env = ours()
    seen = [env.reset()]
    kept = [seen[0].copy()]
    for _ in range(4):
        seen.append(env.step(np.ones((3, 1), np.float32))[0])
        kept.append(seen[-1].copy())
    np.testing.assert_array_equal(seen, kept)


def test_stacked_frames_have_the_last_ones_at_an_end():
    mine, other = VecFrameStack(ours(), 3), VecFrameStack(theirs(), 3)
    assert same(mine.reset(), other.reset())
    for _ in range(7):
        observations, _, _, infos = mine.step(np.zeros((3, 1), np.float32))
        expected, _, _, told = other.step(np.zeros((3, 1), np.float32))
        assert same(observations, expected)
        assert all(
            same(a.get("terminal_observation", 0), b.get("terminal_observation", 0)) for a, b in zip(infos, told, strict=True)
        )


def test_normalized_observations_are_sb3s():
    mine, other = (VecNormalize(make()) for make in (ours, theirs))
    assert same(mine.reset(), other.reset())
    for _ in range(7):
        for one, two in zip(
            mine.step(np.ones((3, 1), np.float32))[:3], other.step(np.ones((3, 1), np.float32))[:3], strict=True
        ):
            np.testing.assert_array_equal(one, two)


def test_hindsight_asks_a_row_for_its_reward():
    made = [lambda: BitFlippingEnv(n_bits=3, continuous=True, max_steps=3)] * 2
    env = Sb3VecEnv(SyncVectorEnv(made, autoreset_mode=SAME_STEP))
    options = {"learning_starts": 20, "buffer_size": 100, "device": "cpu", "seed": 0, "policy_kwargs": {"net_arch": [8]}}
    model = SAC("MultiInputPolicy", env, replay_buffer_class=HerReplayBuffer, **options)
    model.learn(60)
    assert model.replay_buffer.size() > 0


def test_what_is_behind_wrappers_is_reached():
    env = Sb3VecEnv(RecordEpisodeStatistics(gym.make_vec(NAV, num_envs=2, autoreset_mode=SAME_STEP), stats_key="statistics"))
    (parameters, _) = env.get_attr("parameters")
    env.env_method("set_parameters", parameters)
    env.set_attr("mark", 1)
    assert env.get_attr("mark") == [1, 1]
    with pytest.raises(AttributeError, match="nothing"):
        env.get_attr("nothing")
    rows = Sb3VecEnv(RecordEpisodeStatistics(SyncVectorEnv([row(0, "box"), row(1, "box")], autoreset_mode=SAME_STEP)))
    assert rows.get_attr("name", 1) == [1]


def test_rows_in_other_processes_answer_together():
    env = Sb3VecEnv(AsyncVectorEnv([lambda: gym.make("Pendulum-v1")] * 2, autoreset_mode=SAME_STEP))
    try:
        env.seed(5)
        env.reset()
        assert env.get_attr("max_torque", 1) == [2.0]
        env.set_attr("g", 9.0)
        assert env.get_attr("g") == [9.0, 9.0]
        with pytest.raises(ValueError, match="The rows of AsyncVectorEnv share their attributes: set it for all of them"):
            env.set_attr("g", 8.0, 0)
        with pytest.raises(ValueError, match="The rows of AsyncVectorEnv share their methods: call it for all of them"):
            env.env_method("has_wrapper_attr", "g", indices=[0])
        assert env.env_method("has_wrapper_attr", "g") == [True, True]
    finally:
        env.close()


def native(id, n, **options):
    return Sb3VecEnv(gym.make_vec(id, num_envs=n, autoreset_mode=SAME_STEP, **options))


@pytest.mark.parametrize(("id", "n"), [(NAV, 2), (ROOMS, 6)])
def test_sb3_records_videos_of_the_first_rows(id, n, tmp_path, monkeypatch):
    pytest.importorskip("moviepy")
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    env = VecVideoRecorder(native(id, n, render_mode="rgb_array"), str(tmp_path), lambda step: step == 0, video_length=4)
    assert env.frames_per_sec == 10
    env.reset()
    for _ in range(6):
        env.step(np.zeros((n, 2), np.float32))
    env.close()
    (film,) = tmp_path.glob("*.mp4")
    assert film.stat().st_size > 1000


def test_pictures_are_tiles():
    env = native(NAV, 3, render_mode="rgb_array", render_rows=2)
    env.reset()
    upper, lower = env.get_images()
    np.testing.assert_array_equal(env.render(), np.concatenate([upper, lower]))
    assert env.render_mode == "rgb_array"
    with pytest.warns(UserWarning, match="render_mode"):
        native(NAV, 3).render()


class Remembers(PPO):
    """An on-policy algorithm whose policy values an observation together with a memory, as sb3-contrib's RecurrentPPO."""

    def _setup_model(self):
        super()._setup_model()
        plain = self.policy.predict_values
        self.policy.predict_values = lambda obs, lstm_states, episode_starts: plain(obs)


def test_bootstrap_refuses_models_with_a_memory():
    env = native(NAV, 2)
    model = Remembers("MlpPolicy", env, device="cpu")
    with pytest.raises(ValueError, match="Remembers needs lstm_states and episode_starts, which only its rollouts know"):
        env.bootstrap_with(model)


def test_recurrent_ppo_is_refused_for_the_bootstrap_and_trains_without():
    contrib = pytest.importorskip("sb3_contrib", reason="needs sb3-contrib")
    env = native(NAV, 2, max_episode_steps=6)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = contrib.RecurrentPPO("MlpLstmPolicy", env, n_steps=8, batch_size=8, device="cpu", seed=0)
    with pytest.raises(ValueError, match="RecurrentPPO needs lstm_states and episode_starts"):
        env.bootstrap_with(model)
    model.learn(32)
