"""The adapter to Stable-Baselines3, over a scripted environment and the package's own; environments that begin staggered."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.monitor import Monitor

import turtlebot_gym  # noqa: F401  # registers its environments
from turtlebot_gym_agents.training.sb3_vec_env import GROUPS, Sb3VecEnv, Staggered


class Scripted(gym.vector.VectorEnv):
    """Three environments with scripted numbers, all different.

    Every third step the first one ends in success and the second times out; the third never ends.
    """

    metadata = {"autoreset_mode": AutoresetMode.SAME_STEP}

    def __init__(self):
        self.num_envs = 3
        self.single_observation_space = gym.spaces.Box(-100.0, 100.0, (1,), np.float32)
        self.single_action_space = gym.spaces.Box(-1.0, 1.0, (1,), np.float32)
        self.calls, self.at = [], 0

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
        assert episodes == ({"r": 3.0, "l": 3}, {"r": 0.37037, "l": 3})  # 3 * 0.1234567, to six places, as Monitor has it
        assert first == {"is_success": True, "only_first": 5, "inner": {"depth": 1}, "TimeLimit.truncated": False}
        assert second == {"is_success": False, "inner": {"depth": 2}, "TimeLimit.truncated": True}
        assert third == {}


def test_rows_that_share_their_attributes_answer_together():
    env = Sb3VecEnv(Scripted())
    assert env.get_attr("at", [0, 2]) == [0, 0]
    env.set_attr("mark", 5, [0, 1, 2])
    assert env.envs.mark == 5
    with pytest.raises(ValueError, match="The rows of Scripted share their attributes and methods"):
        env.set_attr("mark", 6, [0, 1])
    with pytest.raises(ValueError, match="The rows of Scripted share their attributes and methods"):
        env.env_method("reset", seed=3, indices=[1])
    assert len(env.env_method("reset", seed=3)) == 3
    assert env.envs.calls == [(3, None)]  # once, for all
    assert env.env_is_wrapped(Monitor, [0]) == [True]
    assert [image.max() for image in env.get_images()] == [0, 1, 2]


def test_other_autoreset_modes_are_refused():
    envs = Scripted()
    envs.metadata = {"autoreset_mode": AutoresetMode.NEXT_STEP}
    with pytest.raises(ValueError, match=r"resets within the step, got .*NEXT_STEP: make it with autoreset_mode"):
        Sb3VecEnv(envs)


def native(n, *, reward_scale=1.0, **options):
    envs = gym.make_vec("turtlebot_gym/TurtleBotNav-v0", num_envs=n, autoreset_mode=AutoresetMode.SAME_STEP, **options)
    return Sb3VecEnv(envs, reward_scale=reward_scale)


def test_a_reset_of_some_rows_continues_the_others_and_their_returns():
    env, still = native(2, max_episode_steps=4), np.zeros((2, 2), np.float32)
    env.reset()
    before = env.step(still)[0]
    env.set_options({"reset_mask": np.array([True, False])})
    assert (env.reset() != before).any(axis=1).tolist() == [bool(info) for info in env.reset_infos] == [True, False]
    lengths = [[info["episode"]["l"] for info in env.step(still)[3] if info] for _ in range(4)]
    assert lengths == [[], [], [4], [4]]


def test_the_algorithm_sees_scaled_rewards_and_infos_those_of_the_environment():
    rows = [native(3, max_episode_steps=3, reward_scale=scale) for scale in (1.0, 0.25)]
    for adapter in rows:
        adapter.seed(4)
        adapter.reset()
    for _ in range(3):
        (_, plain, dones, infos), (_, scaled, _, others) = (adapter.step(np.ones((3, 2), np.float32)) for adapter in rows)
        np.testing.assert_allclose(scaled, 0.25 * plain, rtol=1e-6)
    assert dones.all()
    assert [info["episode"]["r"] for info in others] == [info["episode"]["r"] for info in infos]


# Staggered environments.


class Clocks(gym.vector.VectorEnv):
    """Observations are the number of steps since the row's reset."""

    def __init__(self, rows):
        self.num_envs = rows
        self.single_observation_space = gym.spaces.Box(0.0, np.inf, (1,), np.float32)
        self.single_action_space = gym.spaces.Box(-1.0, 1.0, (1,), np.float32)
        self.clocks = np.zeros((rows, 1), np.float32)

    def reset(self, *, seed=None, options=None):
        self.clocks[(options or {}).get("reset_mask", np.ones(self.num_envs, np.bool_))] = 0.0
        return self.clocks.copy(), {}

    def step(self, actions):
        self.clocks += 1.0
        return self.clocks.copy(), np.zeros(len(actions)), *np.zeros((2, len(actions)), np.bool_), {}


def stand(observations):
    return np.zeros((len(observations), 1), np.float32)


@pytest.mark.parametrize(("rows", "times"), [(2 * GROUPS, 2 * [*range(GROUPS)]), (3, range(3)), (1, [0])])
def test_rows_begin_at_times_spread_over_the_steps_and_again_after_a_reset_of_all(rows, times):
    envs = Staggered(Clocks(rows), stand, 10 * min(GROUPS, rows))
    for _ in range(2):
        observations, _ = envs.reset(seed=0)
        assert sorted(observations.ravel()) == [10.0 * time for time in sorted(times)]
    np.testing.assert_array_equal(envs.step(stand(observations))[0], observations + 1.0)


def test_chosen_rows_begin_at_once():
    envs = Staggered(Clocks(2 * GROUPS), stand, 10 * GROUPS)
    before, _ = envs.reset(seed=0)
    chosen = np.arange(2 * GROUPS) < 5
    after, _ = envs.reset(options={"reset_mask": chosen})
    np.testing.assert_array_equal(after, np.where(chosen[:, None], 0.0, before))
