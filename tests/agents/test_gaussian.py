"""The policy in fewer operations is that of Stable-Baselines3: the same weights, samples, likelihoods and gradients."""

import numpy as np
import pytest
import torch
from stable_baselines3.common.policies import ActorCriticPolicy

from turtlebot_gym_agents.training.config import TrainingConfig
from turtlebot_gym_agents.training.gaussian import GaussianPolicy
from turtlebot_gym_agents.training.model import make_model

HYPER = {"n_envs": 8, "n_timesteps": 64, "n_steps": 8, "batch_size": 64, "policy_kwargs": {"net_arch": [8]}}
OBSERVATIONS = torch.from_numpy(np.random.default_rng(0).normal(size=(50, 13)).astype(np.float32))


def make(**hyper):
    config = TrainingConfig(config=HYPER | hyper)
    return make_model(config, config.make_training()).policy


@pytest.fixture
def both():
    """Return our policy, and that of Stable-Baselines3 with its weights."""
    ours = make()
    theirs = ActorCriticPolicy(**ours._get_constructor_parameters())
    theirs.load_state_dict(ours.state_dict())
    with torch.no_grad():
        for policy in (ours, theirs):
            policy.action_net.weight.mul_(100.0)
            policy.log_std.copy_(torch.tensor([-0.3, 0.4]))
    assert type(ours) is GaussianPolicy
    return ours, theirs


@pytest.mark.parametrize("deterministic", [False, True])
def test_actions_values_and_likelihoods_are_the_same(both, deterministic):
    results = []
    for policy in both:
        torch.manual_seed(3)
        results.append(policy(OBSERVATIONS, deterministic=deterministic))
    for ours, theirs in zip(*results, strict=True):
        assert ours.shape == theirs.shape
        torch.testing.assert_close(ours, theirs)


def test_evaluated_actions_and_gradients_are_the_same(both):
    torch.manual_seed(3)
    actions, weights = torch.randn(50, 2), torch.randn(3, 50)
    for policy in both:
        evaluated = policy.evaluate_actions(OBSERVATIONS, actions)
        sum((weight * one.flatten()).sum() for weight, one in zip(weights, evaluated, strict=True)).backward()
    for ours, theirs in zip(*(policy.evaluate_actions(OBSERVATIONS, actions) for policy in both), strict=True):
        assert ours.shape == theirs.shape
        torch.testing.assert_close(ours, theirs)
    for ours, theirs in zip(*(policy.parameters() for policy in both), strict=True):
        torch.testing.assert_close(ours.grad, theirs.grad)


@pytest.mark.parametrize("hyper", [{"use_sde": True}, {"policy_kwargs": {"net_arch": [8], "share_features_extractor": False}}])
def test_other_policies_are_left_to_stable_baselines3(hyper):
    assert type(make(**hyper)) is ActorCriticPolicy
