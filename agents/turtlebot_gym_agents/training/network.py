"""A torch network as ONNX, and the check that a bundle acts as what it was made from."""

from __future__ import annotations

import io
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray
from torch import nn

from turtlebot_gym.files import replacing
from turtlebot_gym_agents.policies import PolicyWithMemory
from turtlebot_gym_agents.policies.bundle import BundlePolicy, Card, write_bundle

if TYPE_CHECKING:
    from onnx import ModelProto

TOLERANCE = 1e-5
"""Largest accepted difference between an action of the original and of its bundle."""
STEPS, ROWS = 1000, 8
"""Steps of the check, and environments that it drives in."""
_SEED, _RESTARTS, _STRAY = 2**43, 0.01, 0.5
"""The check's first seed; share of the steps after which an episode is begun anew, and share of random actions."""


def write_checked(
    model: ModelProto, path: str | Path, card: Card, original: PolicyWithMemory, envs: VectorEnv, *, steps: int = STEPS
) -> float:
    """Write a bundle, if it acts like its original.

    Args:
        model: The network as ONNX, see `OnnxNetwork`.
        path: The file, replaced atomically.
        card: Card of the bundle.
        original: The policy by its own library, with all that it was trained with.
        envs: The environments of the training, in the mode SAME_STEP.
        steps: Number of steps to compare, with episodes that begin anew, before a sample of the whole observation space.

    Returns:
        The largest difference between the bundle's actions and the original's.

    Raises:
        RuntimeError: If it is larger than `TOLERANCE`; then nothing is written.
        ValueError: If an action depends on the other rows.
    """
    with replacing(path) as beside:
        write_bundle(beside, model, card)
        bundle = BundlePolicy(beside)
        difference = _difference(bundle, original, envs, steps)
        if not difference <= TOLERANCE:
            raise RuntimeError(f"{path} is not written: its actions would differ from the network's by {difference:.2g}.")
    return difference


def _difference(bundle: BundlePolicy, original: PolicyWithMemory, envs: VectorEnv, steps: int) -> float:
    """Return the largest difference of two policies in an environment."""
    random, space = np.random.default_rng(0), envs.single_observation_space
    observations, _ = envs.reset(seed=_SEED)
    _require_rows(bundle, observations)
    begins, largest = np.ones(envs.num_envs, np.bool_), 0.0
    for _ in range(steps):
        if begins.any():
            _begin(bundle, original, begins)
        expected, actions = original(observations), bundle(observations)
        largest = max(largest, float(np.abs(expected - actions).max()))
        stray = random.uniform(-1.0, 1.0, actions.shape)
        chosen = np.where(random.random((len(actions), 1)) < _STRAY, stray, actions).astype(np.float32)
        observations, _, terminated, truncated, _ = envs.step(chosen)
        begins, again = terminated | truncated, random.random(envs.num_envs) < _RESTARTS
        if again.any():
            observations, _ = envs.reset(options={"reset_mask": again})
            begins = begins | again
    anywhere = random.uniform(space.low, space.high, (1000, *space.shape)).astype(np.float32)  # pyright: ignore
    _begin(bundle, original, np.ones(len(anywhere), np.bool_))
    return max(largest, float(np.abs(original(anywhere) - bundle(anywhere)).max()))


def _begin(bundle: Any, original: PolicyWithMemory, mask: NDArray[np.bool_]) -> None:
    """Begin episodes of both policies."""
    original.reset(mask)
    if bundle.memory:
        bundle.reset(mask)


def _require_rows(bundle: BundlePolicy, observations: NDArray[np.float32]) -> None:
    """Refuse a policy whose actions depend on the other rows."""
    if bundle.memory:
        bundle.reset(np.ones(len(observations), np.bool_))
    together, alone = bundle(observations), list[NDArray[np.float32]]()
    for row in observations:
        if bundle.memory:
            bundle.reset(np.ones((), np.bool_))
        alone.append(bundle(row))
    if not np.abs(np.array(alone) - together).max() <= TOLERANCE:
        raise ValueError("model must act on each observation by itself, but its actions depend on the others of a batch.")


def program_of(network: nn.Module, size: int, memory: int = 0) -> ModelProto:
    """Return a network as ONNX, by torch's exporter for traced modules: the newer one takes twenty times as long.

    Args:
        network: A map from observations (n, size), and from a memory (n, memory) if it has one, to actions and the next memory.
        size: Numbers of an observation.
        memory: Numbers of the memory.

    Raises:
        ValueError: If torch cannot export it, or only for a fixed number of observations.
    """
    import onnx

    inputs = (torch.zeros(2, size), *((torch.zeros(2, memory),) if memory else ()))
    names = ["observation", "memory", "action", "next_memory"][:: 1 if memory else 2]
    ends: Any = {"input_names": names[: len(inputs)], "output_names": names[len(inputs) :]}
    content: Any = io.BytesIO()
    is_function = not any(True for _ in network.parameters())  # a trace would not see the weights that it holds
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # torch prefers its newer exporter
            if is_function:
                shapes = tuple({0: torch.export.Dim("n")} for _ in inputs)
                program = torch.onnx.export(network.eval(), inputs, dynamic_shapes=shapes, dynamo=True, verbose=False, **ends)
                assert program is not None
                return program.model_proto
            axes = {name: {0: "n"} for name in names}
            torch.onnx.export(network.eval(), inputs, content, dynamic_axes=axes, dynamo=False, **ends)
    except Exception as error:  # torch's exporter has errors of its own, whose text is long
        reason = " ".join(str(error).split())[:200]
        raise ValueError(f"model cannot be exported by torch: {type(error).__name__}: {reason}") from error
    return onnx.load_from_string(content.getvalue())
