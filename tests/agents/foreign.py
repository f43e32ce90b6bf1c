"""Policies trained by other libraries in their own ways, and these libraries' own actions on any sequence of observations."""

from copy import deepcopy

import gymnasium as gym
import numpy as np
import torch
from sb3_contrib import TQC, RecurrentPPO
from stable_baselines3 import A2C, PPO, SAC, TD3
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize
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
    "tqc": (TQC, "MlpPolicy", OFF, plain),
    "squashed": (PPO, "MlpPolicy", ON | {"use_sde": True, "policy_kwargs": FREE | {"squash_output": True}}, plain),
    "normalized": (PPO, "MlpPolicy", ON, normalized),
    "only-rewards": (PPO, "MlpPolicy", ON, only_rewards),
    "recurrent": (RecurrentPPO, "MlpLstmPolicy", LSTM, plain),
    "recurrent-normalized": (RecurrentPPO, "MlpLstmPolicy", LSTM, normalized),
}
"""Algorithm, policy, hyper-parameters, and wrappers of the environment."""


def envs_of():
    return DummyVecEnv([lambda: gym.make(NAV)] * 2)


def trained(kind):
    """Train a kind of policy as its library's users do."""
    algorithm, policy, arguments, wrap = deepcopy(KINDS[kind])  # an algorithm changes its arguments
    return algorithm(policy, wrap(envs_of()), device="cpu", seed=0, **arguments).learn(128)


def library_actions(model, observations, begins):
    """Return what a library's own predict does with the statistics that it was trained with."""
    statistics, state, actions = model.get_vec_normalize_env(), None, []
    seen = observations if statistics is None else statistics.normalize_obs(observations)
    for row, begin in zip(seen, begins, strict=True):
        action, state = model.predict(row[None], state=state, episode_start=np.array([begin]), deterministic=True)
        actions.append(action[0])
    return np.array(actions)


def torch_actions(network, observations):
    with torch.no_grad():
        return np.clip(network(torch.from_numpy(observations)).numpy(), -1.0, 1.0)


def deployed(bundle):
    """Drive a deployment on a random walk; return its observations, where episodes began, and its actions."""
    random, deployment = np.random.default_rng(4), Deployment(bundle)
    exact = Covariance(*[1e-4] * len(Covariance._fields))
    observations, actions = [], []
    begins = np.arange(300) % 97 == 0
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
