"""The adapter to Stable-Baselines3: equal to SB3's own vector environment over the scalar one, and fit for SB3's wrappers."""

import copy

import gymnasium as gym
import numpy as np
import pytest
import torch
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from stable_baselines3 import A2C, PPO, SAC
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, VecCheckNan, VecFrameStack, VecMonitor, VecNormalize

import turtlebot_gym  # noqa: F401  # registers its environments
from turtlebot_gym_agents.training.sb3_vec_env import Sb3VecEnv

NAV = "turtlebot_gym/TurtleBotNav-v0"
N = 6
SAME_STEP = AutoresetMode.SAME_STEP
torch.set_num_threads(1)  # on a busy machine, threads that wait for each other make small networks many times slower


def nav(n: int = N, **options) -> Sb3VecEnv:
    return Sb3VecEnv(gym.make_vec(NAV, num_envs=n, autoreset_mode=SAME_STEP, **options))


def cartpole(n: int = N) -> Sb3VecEnv:
    return Sb3VecEnv(SyncVectorEnv([lambda: gym.make("CartPole-v1", max_episode_steps=20)] * n, autoreset_mode=SAME_STEP))


def actions_for(space: gym.Space, steps: int, n: int) -> np.ndarray:
    random = np.random.default_rng(7)
    if isinstance(space, gym.spaces.Discrete):
        return random.integers(space.n, size=(steps, n))
    forward = np.full((steps, n), 0.5)  # in circles, so that some arrive, while others time out
    return np.stack([forward, random.uniform(0.0, 0.1, (steps, n))], axis=-1).astype(np.float32)


@pytest.mark.parametrize(
    ("make", "make_row", "steps"),
    [
        (lambda: nav(20), lambda: gym.make(NAV), 650),
        (cartpole, lambda: gym.make("CartPole-v1", max_episode_steps=20), 100),
    ],
    ids=["native", "sync"],
)
def test_equals_sb3s_own_vector_environment(make, make_row, steps):
    ours = make()
    theirs = DummyVecEnv([lambda: Monitor(make_row())] * ours.num_envs)
    assert ours.seed(40) == theirs.seed(40)
    np.testing.assert_array_equal(ours.reset(), theirs.reset())
    ends, timeouts = 0, 0
    for actions in actions_for(ours.action_space, steps, ours.num_envs):
        observations, rewards, dones, infos = ours.step(actions)
        expected, expected_rewards, expected_dones, expected_infos = copy.deepcopy(theirs.step(actions))
        np.testing.assert_array_equal(observations, expected)
        np.testing.assert_array_equal(rewards, expected_rewards)
        np.testing.assert_array_equal(dones, expected_dones)
        assert (observations.dtype, rewards.dtype, dones.dtype) == (expected.dtype, expected_rewards.dtype, np.bool_)
        for row in np.flatnonzero(dones):
            info, other = infos[row], expected_infos[row]
            np.testing.assert_array_equal(info["terminal_observation"], other["terminal_observation"])
            assert info["TimeLimit.truncated"] == other["TimeLimit.truncated"]
            assert info["episode"]["r"] == other["episode"]["r"]
            assert info["episode"]["l"] == other["episode"]["l"]
            assert info.get("is_success") == other.get("is_success")
            ends += 1
            timeouts += info["TimeLimit.truncated"]
    assert 0 < timeouts < ends  # else half of this was not tested


def test_infos_of_running_episodes_are_empty():
    env = nav()
    env.reset()
    *_, infos = env.step(np.zeros((N, 2), np.float32))
    assert infos == [{}] * N
    assert all("distance" in info for info in env.reset_infos)


def test_refuses_another_autoreset_mode():
    with pytest.raises(ValueError, match="SAME_STEP"):
        Sb3VecEnv(gym.make_vec("CartPole-v1", num_envs=2, vectorization_mode="vector_entry_point"))


@pytest.mark.parametrize("algorithm", [PPO, A2C])
def test_batched_bootstrap_equals_sb3s_own(algorithm):
    def rollout(bootstrap: bool) -> torch.Tensor:
        env = nav(64, noise="rough")
        options = {"n_steps": 310, "gamma": 0.97, "seed": 3, "device": "cpu"}
        model = algorithm("MlpPolicy", env, **options, **({"batch_size": 64 * 310} if algorithm is PPO else {}))
        if bootstrap:
            env.bootstrap_with(model)
        _, callback = model._setup_learn(64 * 310)
        callback.on_training_start(locals(), globals())
        assert model.collect_rollouts(model.env, callback, model.rollout_buffer, n_rollout_steps=310)
        return model.rollout_buffer

    ours, theirs = rollout(True), rollout(False)
    np.testing.assert_array_equal(ours.observations, theirs.observations)
    np.testing.assert_allclose(ours.rewards, theirs.rewards, rtol=0, atol=1e-5)
    np.testing.assert_allclose(ours.advantages, theirs.advantages, rtol=0, atol=1e-4)


def test_bootstrap_changes_the_rewards_of_timeouts_alone():
    env, plain = nav(16), nav(16)
    model = PPO("MlpPolicy", env, device="cpu")
    env.bootstrap_with(model)
    for one in (env, plain):
        one.seed(0)
        one.reset()
    stay = np.zeros((16, 2), np.float32)
    for step in range(300):
        _, rewards, dones, infos = env.step(stay)
        _, expected, _, others = plain.step(stay)
        if step < 299:
            np.testing.assert_array_equal(rewards, expected)
    assert dones.all()
    last = np.array([info["terminal_observation"] for info in infos])
    values = model.policy.predict_values(torch.as_tensor(last)).detach().numpy().ravel()
    np.testing.assert_allclose(rewards, expected + model.gamma * values, atol=1e-5)
    assert not any(info["TimeLimit.truncated"] for info in infos)
    assert all(info["TimeLimit.truncated"] for info in others)
    assert [info["episode"]["r"] for info in infos] == [info["episode"]["r"] for info in others]


def test_bootstrap_refuses_models_that_it_would_be_wrong_for():
    env = nav()
    with pytest.raises(ValueError, match="on-policy"):
        env.bootstrap_with(SAC("MlpPolicy", env, buffer_size=10, device="cpu"))
    with pytest.raises(ValueError, match="whose env is this adapter"):
        env.bootstrap_with(PPO("MlpPolicy", VecNormalize(env), device="cpu"))


def test_sb3s_wrappers_work_on_top():
    with pytest.warns(UserWarning, match="overwritten by the `VecMonitor` ones"):  # which they may well be
        monitored = VecMonitor(nav(8))
    env = VecCheckNan(VecNormalize(VecFrameStack(monitored, 2)), raise_exception=True)
    model = PPO("MlpPolicy", env, n_steps=320, batch_size=512, n_epochs=1, device="cpu", seed=0)
    model.learn(8 * 320)
    assert len(model.ep_info_buffer) >= 8
    assert {"r", "l", "t"} <= set(model.ep_info_buffer[0])
    assert env.get_attr("num_envs") == [8] * 8


def test_evaluates_without_the_warning_that_a_monitor_is_missing():
    model = PPO("MlpPolicy", nav(), device="cpu", seed=0)
    returns, lengths = evaluate_policy(model, nav(), n_eval_episodes=N, return_episode_rewards=True)
    assert len(returns) == len(lengths) == N


def test_off_policy_algorithms_train_and_see_timeouts():
    model = SAC(
        "MlpPolicy", nav(4), learning_starts=1200, buffer_size=4000, device="cpu", seed=0, policy_kwargs={"net_arch": [8]}
    )
    model.learn(1240)
    assert model.replay_buffer.timeouts.any()


def test_attributes_are_those_of_the_vector_environment():
    env = nav()
    assert env.get_attr("parameters", [0, 1]) == [env.envs.parameters] * 2
    env.set_attr("mark", 3)
    assert env.get_attr("mark", 0) == [3]
    with pytest.raises(ValueError, match="all"):
        env.set_attr("mark", 4, 0)
    with pytest.raises(AttributeError):
        env.get_attr("nothing_of_that_name")
    env.env_method("set_parameters", env.envs.parameters)
    env.close()


def test_options_reach_the_rows_that_they_are_for():
    env = nav()
    before = env.reset()
    env.set_options({"reset_mask": np.arange(N) < 2})
    changed = (env.reset() != before).any(axis=1)
    np.testing.assert_array_equal(changed, np.arange(N) < 2)
    assert [bool(info) for info in env.reset_infos] == changed.tolist()
    env.set_options([{}, *([{"reset_mask": np.ones(N, np.bool_)}] * (N - 1))])
    with pytest.raises(ValueError, match="the same for all rows where they hold a reset_mask"):
        env.reset()
    env.set_options([{}])
    with pytest.raises(ValueError, match=f"options must be one for all or {N}, got 1"):
        env.reset()


def test_a_reset_of_some_goes_on_with_the_returns_of_the_others():
    env = nav(2, max_episode_steps=4)
    env.reset()
    still = np.zeros((2, 2), np.float32)
    env.step(still)
    env.set_options({"reset_mask": np.array([True, False])})
    env.reset()
    lengths = [[info["episode"]["l"] for info in env.step(still)[3] if info] for _ in range(4)]
    assert lengths == [[], [], [4], [4]]
