"""The adapter to Stable-Baselines3 over a scripted environment, with everything it reports written down; its bootstrapping."""

import time

import gymnasium as gym
import numpy as np
import pytest
import torch
from gymnasium.vector import AutoresetMode
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import VecNormalize

import turtlebot_gym  # noqa: F401  # registers its environments
from turtlebot_gym_agents.training.sb3_vec_env import Sb3VecEnv

NAV = "turtlebot_gym/TurtleBotNav-v0"


class Scripted(gym.vector.VectorEnv):
    """Three environments with scripted numbers, all different.

    Every third step the first one ends in success and the second times out; the third never ends.
    """

    metadata = {"autoreset_mode": AutoresetMode.SAME_STEP}

    def __init__(self):
        self.num_envs = 3
        self.single_observation_space = gym.spaces.Box(-100.0, 100.0, (1,), np.float32)
        self.single_action_space = gym.spaces.Box(-1.0, 1.0, (1,), np.float32)
        self.calls, self.at, self.closed_by_user = [], 0, False

    def reset(self, *, seed=None, options=None):
        self.calls.append((seed, options))
        self.at = 0
        return np.zeros((3, 1), np.float32), {"place": np.array([7, 8, 9]), "_place": np.array([True, False, True])}

    def step(self, actions):
        self.at += 1
        end = self.at % 3 == 0
        ended = np.array([end, end, False])
        observations = np.full((3, 1), self.at, np.float32)
        infos = {}
        if end:
            infos = {
                "final_obs": np.array([[10.0], [20.0], [0.0]], np.float32),
                "_final_obs": ended,
                "final_info": {
                    "is_success": np.array([True, False, False]),
                    "_is_success": ended,
                    "only_first": np.array([5, 0, 0]),
                    "_only_first": np.array([True, False, False]),
                    "inner": {"depth": np.array([1, 2, 3]), "_depth": ended},
                    "_inner": ended,
                },
                "_final_info": ended,
            }
        rewards = np.array([1.0, 0.1234567, -1.0]) + actions[:, 0]
        return observations, rewards, np.array([end, False, False]), np.array([False, end, False]), infos

    def render(self):
        return tuple(np.full((2, 2, 3), row, np.uint8) for row in range(3))

    def compute_reward(self, achieved, desired, info):
        return desired - achieved

    def close(self, **kwargs):
        self.closed_by_user = True


STILL = np.zeros((3, 1), np.float32)


def test_all_that_sb3_receives():
    env = Sb3VecEnv(Scripted())
    env.seed(40)
    np.testing.assert_array_equal(env.reset(), np.zeros((3, 1)))
    assert env.envs.calls == [(40, None)]
    assert env.reset_infos == [{"place": 7}, {}, {"place": 9}]
    for lap in range(2):
        for step in (1, 2):
            observations, rewards, dones, infos = env.step(STILL)
            np.testing.assert_array_equal(observations, np.full((3, 1), 3 * lap + step))
            np.testing.assert_array_equal(rewards, np.array([1.0, 0.1234567, -1.0], np.float32))
            assert dones.tolist() == [False, False, False]
            assert infos == [{}, {}, {}]
        observations, rewards, dones, infos = env.step(STILL)
        assert dones.tolist() == [True, True, False]
        first, second, third = infos
        assert first.pop("terminal_observation").tolist() == [10.0]
        assert second.pop("terminal_observation").tolist() == [20.0]
        episodes = first.pop("episode"), second.pop("episode")
        assert all(0.0 <= episode.pop("t") < 60.0 for episode in episodes)
        assert episodes == ({"r": 3.0, "l": 3}, {"r": 0.37037, "l": 3})  # 3 * 0.1234567, to six places, as Monitor has it
        assert first == {"is_success": True, "only_first": 5, "inner": {"depth": 1}, "TimeLimit.truncated": False}
        assert second == {"is_success": False, "inner": {"depth": 2}, "TimeLimit.truncated": True}
        assert third == {}


def test_a_reset_begins_returns_and_lengths_anew_and_the_clock_is_the_adapters(monkeypatch):
    now = 1_000_000.0
    monkeypatch.setattr(time, "time", lambda: now)
    env = Sb3VecEnv(Scripted())
    env.reset()
    env.step(STILL)
    now += 5.0
    env.reset()
    now += 2.1234567
    for action in (0.5, 0.5, 0.0):
        *_, infos = env.step(STILL + action)
    assert infos[0]["episode"] == {"r": 4.0, "l": 3, "t": 7.123457}  # to a microsecond, as Monitor has it


@pytest.mark.parametrize(
    ("starts", "calls"),
    [
        (0, [(None, 0)]),  # one for all
        ([0, 1, 0], [([True, False, True], 0), ([False, True, False], 1)]),
        ([None, None, 1], [([True, True, False], None), ([False, False, True], 1)]),
    ],
)
def test_seeds_and_options_count_for_one_reset_of_the_rows_that_they_are_for(starts, calls):
    def option(start):
        return {} if start is None else {"start": np.full(2, start)}

    env = Sb3VecEnv(Scripted())
    env.seed(9)
    env.set_options([option(start) for start in starts] if isinstance(starts, list) else option(starts))
    env.reset()
    env.reset()
    *made, again = env.envs.calls
    assert again == (None, None)
    if len(calls) > 1:
        assert made.pop(0) == (9, None)  # the first reset must include all rows
    assert [seed for seed, _ in made] == [9] * len(calls)
    for (_, options), (mask, start) in zip(made, calls, strict=True):
        np.testing.assert_equal({"reset_mask": mask, **option(start)}, {"reset_mask": None, **options})


def test_rows_that_share_their_attributes_answer_together():
    env = Sb3VecEnv(Scripted())
    assert env.get_attr("at") == [0, 0, 0]
    assert env.get_attr("at", 1) == [0]
    assert env.get_attr("at", [0, 2]) == [0, 0]
    env.set_attr("mark", 4)
    env.set_attr("mark", 5, [0, 1, 2])
    assert env.envs.mark == 5
    with pytest.raises(ValueError, match=r"^The rows of Scripted share their attributes: set it for all of them\.$"):
        env.set_attr("mark", 6, [0, 1])
    with pytest.raises(ValueError, match=r"^The rows of Scripted share their methods: call it for all of them\.$"):
        env.env_method("reset", seed=3, indices=[1])
    assert len(env.env_method("reset", seed=3)) == 3
    assert env.envs.calls == [(3, None)]  # once, for all
    assert env.env_method("compute_reward", 1.0, 3.0, {}, indices=[0]) == [2.0]  # no row's own
    assert env.env_is_wrapped(Monitor) == [True, True, True]
    assert env.env_is_wrapped(Monitor, [0]) == [True]
    assert env.env_is_wrapped(gym.Wrapper, [0, 1]) == [False, False]
    assert [image.max() for image in env.get_images()] == [0, 1, 2]
    env.envs.render = lambda: None
    assert env.get_images() == [None, None, None]
    env.close()
    assert env.envs.closed_by_user


def test_bootstrapping_adds_the_discounted_value_of_timed_out_episodes_alone():
    env = Sb3VecEnv(Scripted())
    model = PPO("MlpPolicy", env, device="cpu", gamma=0.9, seed=0)
    env.bootstrap_with(model)
    env.reset()
    for _ in range(2):
        _, rewards, *_ = env.step(STILL)
        np.testing.assert_array_equal(rewards, np.array([1.0, 0.1234567, -1.0], np.float32))
    _, rewards, _, infos = env.step(STILL)
    value = model.policy.predict_values(torch.tensor([[20.0]])).item()
    assert abs(value) > 1e-3
    np.testing.assert_allclose(rewards, [1.0, 0.1234567 + 0.9 * value, -1.0], atol=1e-6)
    assert [infos[row]["TimeLimit.truncated"] for row in (0, 1)] == [False, False]
    assert infos[1]["episode"]["r"] == 0.37037  # the return is the environment's


def test_other_autoreset_modes_are_refused():
    envs = Scripted()
    envs.metadata = {"autoreset_mode": AutoresetMode.NEXT_STEP}
    with pytest.raises(ValueError, match=r"resets within the step, got .*NEXT_STEP: make it with autoreset_mode"):
        Sb3VecEnv(envs)
    envs.metadata = {}
    with pytest.raises(ValueError, match="got None"):
        Sb3VecEnv(envs)


class Remembers(PPO):
    """An on-policy algorithm whose policy values an observation together with a memory, as sb3-contrib's RecurrentPPO."""

    def _setup_model(self):
        super()._setup_model()
        plain = self.policy.predict_values
        self.policy.predict_values = lambda obs, lstm_states, episode_starts: plain(obs)


def test_bootstrap_refuses_models_that_it_would_be_wrong_for():
    env = Sb3VecEnv(gym.make_vec(NAV, num_envs=2, autoreset_mode=AutoresetMode.SAME_STEP))
    for model, message in (
        (SAC("MlpPolicy", env, buffer_size=10, device="cpu"), "on-policy"),
        (PPO("MlpPolicy", VecNormalize(env), device="cpu"), "whose env is this adapter"),
        (Remembers("MlpPolicy", env, device="cpu"), "needs lstm_states and episode_starts, which only its rollouts know"),
    ):
        with pytest.raises(ValueError, match=message):
            env.bootstrap_with(model)
