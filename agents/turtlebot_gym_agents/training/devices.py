"""Choice of the device on which a network learns."""

from __future__ import annotations

import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm


def choose_device(device: str, algorithm: type[BaseAlgorithm]) -> str:
    """Return "cpu" or "cuda".

    Args:
        device: Either of them, or "auto": the CPU for on-policy algorithms, whose rollouts pass each observation through a
            small network by itself; a GPU, if there is one, for off-policy ones, which spend their time on batches.
        algorithm: The algorithm.

    Raises:
        ValueError: If ``device`` is "cuda" and torch finds no GPU.

    References:
        Stable-Baselines3 2.9, documentation of PPO: "meant to be run primarily on the CPU" unless the policy is a CNN.
    """
    there = torch.cuda.is_available()
    if device == "cuda" and not there:
        raise ValueError(f"device 'cuda' is not available: torch {torch.__version__} finds no GPU; use --device cpu.")
    if device == "auto":
        return "cuda" if there and issubclass(algorithm, OffPolicyAlgorithm) else "cpu"
    return device
