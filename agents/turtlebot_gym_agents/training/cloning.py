"""Begin a training with the network of a known policy: clone its actions, then fit the critic to the clone's returns.

The clone learns on the states that it reaches itself: in each round it drives, the known policy says what it would have done
there, and the network is fitted to all rounds so far. An untrained critic would undo the cloning in the first updates, so at
first PPO updates only the critic.

References:
    Ross, Gordon, Bagnell, "A reduction of imitation learning and structured prediction to no-regret online learning",
    *AISTATS* (2011).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import torch
from gymnasium.vector import VectorEnv
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm
from stable_baselines3.common.policies import ActorCriticPolicy
from torch import nn

from turtlebot_gym_agents.policies import Policy, make_policy
from turtlebot_gym_agents.policies.fit import parameters_of, require_terms
from turtlebot_gym_agents.policies.policy import PolicyWithMemory, shown
from turtlebot_gym_agents.training.config import TrainingConfig

CLONING_SEED = 2**43
"""Seed of the environments in which a policy is cloned, separate from others."""
STEPS, ROUNDS, PASSES, BATCH, RATE = 100, 4, 3, 2048, 2e-3
"""Most steps of a round; rounds; passes over the data after each; rows of an update, and its learning rate."""
ROWS = 25_600
"""Most steps of all environments together in a round."""
DEVIATION = 0.3
"""Standard deviation of the clone's actions, with which it explores in rounds and at first in the training."""
WARM_UP = 0.1
"""Share of the training's steps in which only the critic learns."""


def begin_with(model: BaseAlgorithm, envs: VectorEnv, config: TrainingConfig) -> BaseCallback:
    """Let a training begin with the policy of its configuration, and return the callback that it needs.

    Args:
        model: The model.
        envs: The training's environments.
        config: Configuration of the training, which names a policy.

    Raises:
        ValueError: If the policy was made for another robot, rate or observation.
    """
    assert config.from_policy is not None
    assert isinstance(model, OnPolicyAlgorithm)
    parameters = parameters_of(envs)
    policy = make_policy(config.from_policy, robot=parameters.robot, dt=parameters.dt, noise=parameters.noise)
    require_terms(policy, config.from_policy, config.env)
    terms: Any = getattr(envs.unwrapped, "observation_terms")  # noqa: B009  # Gymnasium's type does not have it
    policy = shown(policy, config.from_policy, terms)
    clone(model, envs, policy, seed=CLONING_SEED + config.seed)
    return _WarmUpCallback(round(WARM_UP * config.total))


def clone(model: OnPolicyAlgorithm, envs: VectorEnv, policy: Policy, *, seed: int) -> None:
    """Fit the mean actions of a model's network to a policy.

    Args:
        model: Model with a Gaussian policy, whose critic has layers of its own.
        envs: The training's environments, in the mode SAME_STEP.
        policy: The policy, for their robot and rate.
        seed: Seed of the environments.
    """
    network = model.policy
    assert isinstance(network, ActorCriticPolicy)
    with torch.no_grad():
        network.log_std.fill_(float(np.log(DEVIATION)))
    optimizer = torch.optim.Adam(_actor(network), lr=RATE)
    random = np.random.default_rng(seed)
    observations, _ = envs.reset(seed=seed)
    over = np.ones(envs.num_envs, np.bool_)
    observed, labels = [], []
    for number in range(ROUNDS):
        for _ in range(min(STEPS, max(1, ROWS // envs.num_envs))):
            if isinstance(policy, PolicyWithMemory) and over.any():
                policy.reset(over)
            label = np.clip(policy(observations), -1.0, 1.0).astype(np.float32)
            observed.append(observations)
            labels.append(label)
            drives = label if number == 0 else mean_actions(network, torch.from_numpy(observations)).detach().numpy()
            stray = drives + random.normal(0.0, DEVIATION, drives.shape).astype(np.float32)
            observations, _, terminated, truncated, _ = envs.step(stray)
            over = terminated | truncated
        _fit(network, optimizer, *(torch.from_numpy(np.concatenate(rows)) for rows in (observed, labels)))


def mean_actions(policy: ActorCriticPolicy, observations: torch.Tensor) -> torch.Tensor:
    """Return the means of a Gaussian policy's actions."""
    return policy.action_net(policy.mlp_extractor.forward_actor(policy.pi_features_extractor(observations)))


def _actor(network: ActorCriticPolicy) -> Iterator[nn.Parameter]:
    """Yield the parameters on which the actions depend."""
    yield network.log_std
    yield from network.mlp_extractor.policy_net.parameters()
    yield from network.action_net.parameters()


def _fit(network: ActorCriticPolicy, optimizer: torch.optim.Optimizer, observed: torch.Tensor, labels: torch.Tensor) -> None:
    """Reduce the mean squared difference between actions and labels."""
    for _ in range(PASSES):
        for rows in torch.randperm(len(observed)).split(BATCH):
            optimizer.zero_grad()
            nn.functional.mse_loss(mean_actions(network, observed[rows]), labels[rows]).backward()
            optimizer.step()


class _WarmUpCallback(BaseCallback):
    """Let only the critic learn at first.

    Args:
        steps: Number of steps until the actions learn too.
    """

    def __init__(self, steps: int) -> None:
        super().__init__()
        self._steps = steps

    def _on_step(self) -> bool:
        return True

    def _on_rollout_start(self) -> None:
        assert isinstance(self.model.policy, ActorCriticPolicy)
        for parameter in _actor(self.model.policy):
            parameter.requires_grad_(self.num_timesteps >= self._steps)
