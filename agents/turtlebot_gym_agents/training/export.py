"""Convert a Stable-Baselines3 model into a policy bundle, and verify that both act alike."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import stable_baselines3
import torch
from gymnasium import spaces
from stable_baselines3.common.base_class import BaseAlgorithm

from turtlebot_gym.systems import SIZES
from turtlebot_gym_agents.policies.bundle import Card
from turtlebot_gym_agents.training.graph import graph_of
from turtlebot_gym_agents.training.network import program_of, write_checked

_MARKS = {"target_entropy": "SAC", "policy_delay": "TD3", "clip_range_vf": "PPO", "gae_lambda": "A2C"}
"""Attribute of a saved model that identifies its algorithm."""


def load_model(path: Path, *, allow_pickle: bool = False) -> BaseAlgorithm:
    """Load a model saved by Stable-Baselines3, with SAC, TD3 (also DDPG), PPO or A2C as the file's content says.

    Args:
        path: A zip file.
        allow_pickle: Must be true: the file holds pickled objects, and loading them runs any code in them.

    Raises:
        ValueError: If ``allow_pickle`` is false, or the file is not such a model.
    """
    if not allow_pickle:
        raise ValueError(
            f"{path} holds pickled objects, and loading those can run any code. If you trust its source, add "
            "--allow-pickle; policies are passed on as bundles, which `turtlebot-gym export` makes."
        )
    try:
        with zipfile.ZipFile(path) as archive:
            keys = json.loads(archive.read("data"))
    except (zipfile.BadZipFile, KeyError, ValueError) as error:
        raise ValueError(f"{path} is not a model of Stable-Baselines3: {error}.") from error
    name = next((name for mark, name in _MARKS.items() if mark in keys), None)
    if name is None:
        raise ValueError(f"{path} must hold a model of {', '.join(_MARKS.values())}.")
    return getattr(stable_baselines3, name).load(path, device="cpu")


class _Deterministic(torch.nn.Module):
    """The deterministic action of an SB3 policy, without its distributions."""

    def __init__(self, policy: torch.nn.Module) -> None:
        super().__init__()
        self.policy = policy

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        policy: Any = self.policy
        if hasattr(policy, "mlp_extractor"):  # PPO, A2C
            features = policy.extract_features(observation, policy.pi_features_extractor)
            action = policy.action_net(policy.mlp_extractor.forward_actor(features))
        elif hasattr(policy.actor, "get_action_dist_params"):  # SAC, whose actor is stochastic
            action = torch.tanh(policy.actor.get_action_dist_params(observation)[0])
        else:  # TD3, DDPG
            action = policy.actor(observation)
        return torch.clamp(action, -1.0, 1.0)


def export(model: BaseAlgorithm, path: Path, card: Card, *, samples: int = 10_000) -> float:
    """Write a model's deterministic policy as a bundle, if the two act alike.

    Args:
        model: A trained model for one of this package's environments.
        path: The bundle's file, replaced atomically.
        card: Card of the bundle.
        samples: Number of observations, uniform in the observation space, on which the actions are compared.

    Returns:
        The largest difference between their actions.

    Raises:
        ValueError: If the model's observations or actions have other shapes.
        RuntimeError: If the difference is larger than `network.TOLERANCE`.
    """
    size = SIZES[card.layout]
    space, shapes = model.observation_space, (model.observation_space.shape, model.action_space.shape)
    if shapes != ((size,), (2,)) or not isinstance(space, spaces.Box):
        raise ValueError(f"model must map observations ({size},) to actions (2,), got {shapes[0]} and {shapes[1]}.")
    graph = graph_of(model.policy) or program_of(_Deterministic(model.policy).eval(), size)
    observations = np.random.default_rng(0).uniform(space.low, space.high, (samples, size)).astype(np.float32)
    expected, _ = model.predict(observations, deterministic=True)
    return write_checked(graph, path, card, observations, expected)
