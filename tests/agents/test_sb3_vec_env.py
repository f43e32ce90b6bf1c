"""The adapter to Stable-Baselines3 over the package's own vector environment."""

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode

import turtlebot_gym  # noqa: F401  # registers its environments
from turtlebot_gym_agents.training.sb3_vec_env import Sb3VecEnv


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
