"""Policies trained by other libraries in their own ways, and these libraries' own actions on any sequence of observations."""

from copy import deepcopy

import gymnasium as gym
import numpy as np
import torch
from sb3_contrib import TQC, RecurrentPPO
from stable_baselines3 import A2C, DDPG, PPO, SAC, TD3
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv, VecNormalize
from torch import nn

from turtlebot_gym import State
from turtlebot_gym.values import Covariance, Pose
from turtlebot_gym_agents import Deployment
from turtlebot_gym_agents.commands.cli import main

NAV, ROOMS = "turtlebot_gym/TurtleBotNav-v0", "turtlebot_gym/TurtleBotRooms-v0"
SMALL = {"net_arch": [32, 32]}
FREE = SMALL | {"ortho_init": False}  # otherwise first actions hardly differ from each other
ON = {"n_steps": 32, "policy_kwargs": FREE}
OFF = {"learning_starts": 50, "buffer_size": 500, "batch_size": 16, "policy_kwargs": SMALL}
LSTM = ON | {"n_epochs": 2, "batch_size": 32, "policy_kwargs": FREE | {"lstm_hidden_size": 16, "n_lstm_layers": 2}}


def plain(venv):
    return venv


def normalized(venv):
    return VecNormalize(venv, clip_obs=3.0)


def only_rewards(venv):
    return VecNormalize(venv, norm_obs=False)


KINDS = {
    "ppo": (PPO, "MlpPolicy", ON, plain),
    "a2c": (A2C, "MlpPolicy", ON | {"use_sde": True}, plain),
    "sac": (SAC, "MlpPolicy", OFF, plain),
    "td3": (TD3, "MlpPolicy", OFF, plain),
    "ddpg": (DDPG, "MlpPolicy", OFF, plain),
    "tqc": (TQC, "MlpPolicy", OFF, plain),
    "squashed": (PPO, "MlpPolicy", ON | {"use_sde": True, "policy_kwargs": FREE | {"squash_output": True}}, plain),
    "normalized": (PPO, "MlpPolicy", ON, normalized),
    "normalized-sac": (SAC, "MlpPolicy", OFF, normalized),
    "only-rewards": (PPO, "MlpPolicy", ON, only_rewards),
    "recurrent": (RecurrentPPO, "MlpLstmPolicy", LSTM, plain),
    "recurrent-normalized": (RecurrentPPO, "MlpLstmPolicy", LSTM, normalized),
}
"""Algorithm, policy, hyper-parameters, and wrappers of the environment."""


def envs_of(env=NAV, count=2, **options):
    return DummyVecEnv([lambda: gym.make(env, **options)] * count)


def trained(kind, folder, *, env=NAV, steps=128, **options):
    """Train a kind of policy as its library's users do; save the model, and its statistics beside it."""
    algorithm, policy, arguments, wrap = deepcopy(KINDS[kind])  # an algorithm changes its arguments
    model = algorithm(policy, wrap(envs_of(env, **options)), device="cpu", seed=0, **arguments).learn(steps)
    model.save(folder / "model.zip")
    if (statistics := model.get_vec_normalize_env()) is not None:
        statistics.save(folder / "vecnormalize.pkl")
    return model


class Played(VecEnv):
    """A vector environment of one row that shows given observations, whatever is done."""

    def __init__(self, observations, begins, space):
        self._observations, self._begins, self._at = observations, begins, 0
        super().__init__(1, space, gym.spaces.Box(-1.0, 1.0, (2,), np.float32))

    def reset(self):
        return self._observations[:1].copy()

    def step_async(self, actions):
        self._at += 1

    def step_wait(self):
        done = self._begins[self._at]
        info = {"terminal_observation": self._observations[self._at - 1]} if done else {}
        return self._observations[self._at][None].copy(), np.zeros(1, np.float32), np.array([done]), [info]

    def close(self): ...

    def get_attr(self, name, indices=None):
        return [None]

    set_attr = env_method = get_attr

    def env_is_wrapped(self, wrapper, indices=None):
        return [False]


def library_actions(model, observations, begins):
    """Return what a library's own predict does within the wrappers that it was trained in, without learning."""
    chain, layer = [], model.get_env()
    while hasattr(layer, "venv"):
        chain.append(layer)
        layer = layer.venv
    venv = Played(observations, begins, layer.observation_space)
    for wrapper in reversed(chain):
        statistics, venv = wrapper, VecNormalize(venv, training=False, norm_obs=wrapper.norm_obs, clip_obs=wrapper.clip_obs)
        if wrapper.norm_obs:
            venv.obs_rms = statistics.obs_rms
    seen, state, starts, actions = venv.reset(), None, np.ones(1, np.bool_), []
    for at in range(len(observations)):
        action, state = model.predict(seen, state=state, episode_start=starts, deterministic=True)
        actions.append(action[0])
        if at + 1 < len(observations):
            seen, _, starts, _ = venv.step(action)
    return np.array(actions)


def torch_actions(network, observations):
    with torch.no_grad():
        return np.clip(network(torch.from_numpy(observations)).numpy(), -1.0, 1.0)


def deployed(bundle, steps=300, every=97):
    """Drive a deployment on a random walk; return its observations, where episodes began, and its actions."""
    random, deployment = np.random.default_rng(4), Deployment(bundle)
    exact = Covariance(*[1e-4] * len(Covariance._fields))
    observations, actions = [], []
    begins = np.arange(steps) % every == 0
    pose, goal = np.zeros(3), Pose(1.0, 0.5, 0.3)
    for begin in begins:
        if begin:
            deployment.reset()
            pose, goal = np.zeros(3), Pose(*random.uniform(-2.0, 2.0, 3))
        pose = pose + random.normal(size=3) * (0.02, 0.02, 0.2)
        twist = random.uniform((-0.2, -2.0), (0.2, 2.0))
        deployment.command(State(*pose, *twist), exact, float(random.uniform(0.0, 5.0)), goal, goal)
        observations.append(deployment.observation.copy())
        actions.append(deployment.action.copy())
    return np.array(observations), begins, np.array(actions)


def exported(capsys, *words):
    status = main(["export", *map(str, words)])
    output = capsys.readouterr()
    return status, " ".join((output.out + output.err).split())


def mlp(outputs=2):
    torch.manual_seed(0)
    return nn.Sequential(nn.Linear(13, 16), nn.Tanh(), nn.Dropout(0.5), nn.Linear(16, outputs)).eval()


class Agent(nn.Module):
    """The structure of CleanRL's agents (ppo_continuous_action.py): no forward, but named parts."""

    def __init__(self):
        super().__init__()
        self.critic, self.actor_mean, self.actor_logstd = mlp(1), mlp(), nn.Parameter(torch.zeros(1, 2))
