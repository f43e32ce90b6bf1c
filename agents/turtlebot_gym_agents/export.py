"""From a Stable-Baselines3 model to a policy bundle, with the proof that both do the same."""

from __future__ import annotations

import logging
import warnings
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch

from turtlebot_gym.tasks import OBSERVATION_HIGH, OBSERVATION_LOW
from turtlebot_gym_agents.bundle import BundlePolicy, Card, write_bundle

if TYPE_CHECKING:
    from stable_baselines3.common.base_class import BaseAlgorithm

TOLERANCE = 1e-5
"""Largest difference between an action of the model and one of its bundle: both compute in float32."""


class _Deterministic(torch.nn.Module):
    """The deterministic action of an SB3 policy, without the distributions that it is otherwise wrapped in."""

    def __init__(self, policy: torch.nn.Module) -> None:
        super().__init__()
        self.policy = policy

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        policy = self.policy
        if hasattr(policy, "mlp_extractor"):  # PPO, A2C
            features = policy.extract_features(observation, policy.pi_features_extractor)
            action = policy.action_net(policy.mlp_extractor.forward_actor(features))
        else:  # SAC, TD3, DDPG
            action = policy.actor(observation)
        return torch.clamp(action, -1.0, 1.0)


def export(model: BaseAlgorithm, path: Path, card: Card, *, samples: int = 10_000) -> float:
    """Write a model's deterministic policy as a bundle, and compare the two.

    Args:
        model: A trained model with one-dimensional observations.
        path: The bundle's file.
        card: What it is for.
        samples: Observations on which the actions are compared, uniform in the observation space.

    Returns:
        The largest difference between their actions.

    Raises:
        RuntimeError: If it is larger than `TOLERANCE`.
    """
    network = _Deterministic(model.policy).eval()
    registration = logging.getLogger("torch.onnx._internal.exporter._registration")
    level = registration.level
    registration.setLevel(logging.ERROR)  # it warns that torchvision is not installed
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # torch's exporter uses what torch deprecates
            program = torch.onnx.export(
                network,
                (torch.zeros(2, len(OBSERVATION_LOW)),),
                input_names=["observation"],
                output_names=["action"],
                dynamic_shapes=({0: torch.export.Dim("n")},),
                dynamo=True,
                verbose=False,
            )
    finally:
        registration.setLevel(level)
    assert program is not None
    write_bundle(path, program.model_proto.SerializeToString(), card)

    observations = np.random.default_rng(0).uniform(OBSERVATION_LOW, OBSERVATION_HIGH, (samples, len(OBSERVATION_LOW)))
    observations = observations.astype(np.float32)
    actions, _ = model.predict(observations, deterministic=True)
    difference = float(np.abs(actions - BundlePolicy(path)(observations)).max())
    if not difference <= TOLERANCE:
        raise RuntimeError(f"{path}: its actions differ from the model's by up to {difference:.2g}.")
    return difference
