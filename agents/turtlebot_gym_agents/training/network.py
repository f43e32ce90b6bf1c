"""Convert a torch network of any library into a policy bundle, and verify that both return the same actions.

Wrap a library's policy as a ``torch.nn.Module`` from observations (n, 13), in a room (n, 50), to mean actions (n, 2) without
exploration. torch, onnx and onnxscript suffice; Stable-Baselines3, for whose models there is `export`, is not needed.
"""

from __future__ import annotations

import logging
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from turtlebot_gym.files import replacing
from turtlebot_gym_agents.policies.bundle import BundlePolicy, Card, write_bundle

if TYPE_CHECKING:
    from onnx import ModelProto

TOLERANCE = 1e-5
"""Largest accepted difference between an action of the network and of its bundle."""


def export_network(
    network: nn.Module, path: str | Path, env: str, *, training: Mapping[str, Any] | None = None, **options: Any
) -> float:
    """Write a network as a bundle, if both return the same actions; those beyond 1 are clipped.

    Args:
        network: A map from float32 observations (n, k) to actions (n, 2). It is left in evaluation mode.
        path: The bundle's file, replaced atomically.
        env: Id of the environment in which it was trained.
        training: Entries for the card about the training, such as library, version, algorithm, steps and seed.
        **options: Arguments of the environment, ``robot``, ``noise``, ``filter`` and so on.

    Returns:
        The largest difference between their actions, on 10,000 observations, uniform in the observation space.

    Raises:
        ValueError: If the network's actions have another shape, or it only works for a fixed number of observations.
        RuntimeError: If the difference is larger than `TOLERANCE`.
    """
    made = gym.make(env, **options)
    space: Any = made.observation_space
    card = Card.of(env, options, made.unwrapped.parameters, training or {})  # pyright: ignore[reportAttributeAccessIssue]
    made.close()
    observations = np.random.default_rng(0).uniform(space.low, space.high, (10_000, *space.shape)).astype(np.float32)
    network.cpu().eval()
    with torch.no_grad():
        expected = np.clip(network(torch.from_numpy(observations)).numpy(), -1.0, 1.0)
    if expected.shape != (len(observations), 2):
        raise ValueError(f"network must give actions (n, 2), got {expected.shape} for {len(observations)} observations.")
    model = program_of(network, space.shape[0])
    if not model.graph.input[0].type.tensor_type.shape.dim[0].dim_param:
        raise ValueError(
            "network must not depend on how many observations it is given, as len(x) or a loop over them makes it: "
            "pass its layers, nn.Sequential(body, head)."
        )
    return write_checked(model, path, card, observations, expected)


def write_checked(
    model: ModelProto, path: str | Path, card: Card, observations: NDArray[np.float32], expected: NDArray[np.float32]
) -> float:
    """Write a bundle, if it acts like its network.

    Args:
        model: The network as ONNX.
        path: The file, replaced atomically.
        card: Card of the bundle.
        observations: Shape (n, size), float32.
        expected: The network's actions for them, shape (n, 2).

    Returns:
        The largest difference between the bundle's actions and the network's.

    Raises:
        RuntimeError: If it is larger than `TOLERANCE`; then nothing is written.
    """
    with replacing(path) as beside:
        write_bundle(beside, model, card)
        difference = float(np.abs(expected - BundlePolicy(beside)(observations)).max())
        if not difference <= TOLERANCE:
            raise RuntimeError(f"{path} is not written: its actions would differ from the network's by {difference:.2g}.")
    return difference


def program_of(network: nn.Module, size: int) -> ModelProto:
    """Return a network with clipped actions as ONNX, by torch's exporter."""
    registration = logging.getLogger("torch.onnx._internal.exporter._registration")
    level = registration.level
    registration.setLevel(logging.ERROR)  # it warns that torchvision is not installed
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # torch's exporter uses deprecated parts of torch
            program = torch.onnx.export(
                nn.Sequential(network, nn.Hardtanh()).eval(),  # clips to [-1, 1]
                (torch.zeros(2, size),),
                input_names=["observation"],
                output_names=["action"],
                dynamic_shapes=({0: torch.export.Dim("n")},),
                dynamo=True,
                verbose=False,
            )
    finally:
        registration.setLevel(level)
    assert program is not None
    return program.model_proto
