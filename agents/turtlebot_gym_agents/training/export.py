"""Convert a Stable-Baselines3 model into a policy bundle, and verify that both return the same actions.

The graph of the layers that this package's policies have is written directly, in milliseconds, where torch's exporter takes
seconds; other networks are left to torch's exporter. Either graph is compared with its network.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import stable_baselines3
import torch
from gymnasium import spaces
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.torch_layers import FlattenExtractor
from torch import nn

from turtlebot_gym.observations import size_of
from turtlebot_gym_agents.policies.bundle import Card, term_on
from turtlebot_gym_agents.policies.yielding import NEAR
from turtlebot_gym_agents.training.model import data_of
from turtlebot_gym_agents.training.network import program_of, write_checked
from turtlebot_gym_agents.training.normalization import CLIP, NormalizedObservation, split_at

if TYPE_CHECKING:
    from onnx import ModelProto

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
        keys = data_of(path)
    except (RuntimeError, KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{path} is not a model of Stable-Baselines3: {' '.join(str(error).split())}") from error
    name = next((name for mark, name in _MARKS.items() if mark in keys), None)
    if name is None:
        raise ValueError(f"{path} must hold a model of {', '.join(_MARKS.values())}.")
    rates = dict.fromkeys(("learning_rate", "lr_schedule", "clip_range"), 0.0)  # of training, and possibly of unknown classes
    return getattr(stable_baselines3, name).load(path, device="cpu", custom_objects=rates)


def export(model: BaseAlgorithm, path: Path, card: Card, *, samples: int = 10_000) -> float:
    """Write a model's deterministic policy as a bundle, if both return the same actions.

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
    size = size_of([term_on(path, term) for term in card.terms])
    space, shapes = model.observation_space, (model.observation_space.shape, model.action_space.shape)
    if shapes != ((size,), (2,)) or not isinstance(space, spaces.Box):
        raise ValueError(f"model must map observations ({size},) to actions (2,), got {shapes[0]} and {shapes[1]}.")
    layers = _layers_of(model.policy)
    graph = _graph_of(layers, size) or program_of(nn.Sequential(*layers), size)
    observations = np.random.default_rng(0).uniform(space.low, space.high, (samples, size)).astype(np.float32)
    expected, _ = model.predict(observations, deterministic=True)
    return write_checked(graph, path, card, observations, expected)


OPSET, IR_VERSION = 20, 10
"""The same versions as torch's exporter; onnxruntime reads them from 1.18."""


def _layers_of(policy: Any) -> list[nn.Module]:
    """Return the layers from an observation to the deterministic action of an SB3 policy."""
    if hasattr(policy, "mlp_extractor"):  # PPO, A2C
        layers = [policy.pi_features_extractor, policy.mlp_extractor.policy_net, policy.action_net]
    elif hasattr(policy.actor, "latent_pi"):  # SAC, whose actor is stochastic
        layers = [policy.actor.features_extractor, policy.actor.latent_pi, policy.actor.mu, nn.Tanh()]
    else:  # TD3, DDPG
        layers = [policy.actor.features_extractor, policy.actor.mu]
    return list(_flat(layers))


def _flat(layers: Iterable[nn.Module]) -> Iterator[nn.Module]:
    for layer in layers:
        if type(layer) is nn.Sequential:
            yield from _flat(layer)
        else:
            yield layer


def _graph_of(layers: Sequence[nn.Module], size: int) -> ModelProto | None:
    """Return a chain of layers as ONNX, from observations (n, size) to actions (n, 2), clipped to [-1, 1].

    None if a layer is of an unsupported kind.
    """
    from onnx import TensorProto, helper

    if not all(type(layer) in _WRITERS for layer in layers):
        return None
    graph = _OnnxGraph("observation")
    for layer in layers:
        _WRITERS[type(layer)](graph, layer)
    graph.add("Clip", _numbers(-1.0), _numbers(1.0), result="action")
    ends = [
        [helper.make_tensor_value_info(name, TensorProto.FLOAT, ["n", width])]
        for name, width in (("observation", size), ("action", 2))
    ]
    made = helper.make_graph(graph.nodes, "policy", *ends, initializer=graph.constants)
    opset = [helper.make_opsetid("", OPSET)]
    return helper.make_model(made, opset_imports=opset, ir_version=IR_VERSION, producer_name="turtlebot_gym")


def _numbers(values: Any) -> np.ndarray:
    return np.asarray(values, np.float32)


class _OnnxGraph:
    """A chain of operations, each on the result of the one before."""

    def __init__(self, begin: str) -> None:
        self.nodes: list[Any] = []
        self.constants: list[Any] = []
        self.last = begin

    def constant(self, values: torch.Tensor | np.ndarray) -> str:
        from onnx import numpy_helper

        array = values.detach().cpu().numpy() if isinstance(values, torch.Tensor) else values
        name = f"constant_{len(self.constants)}"
        self.constants.append(numpy_helper.from_array(array, name))
        return name

    def add(self, operation: str, *inputs: torch.Tensor | np.ndarray, result: str = "", **attributes: Any) -> None:
        """Add an operation on the last result and further inputs."""
        names = [self.last, *map(self.constant, inputs)]
        self.last = self._node(operation, names, [result or f"result_{len(self.nodes)}"], **attributes)[0]

    def _node(self, operation: str, inputs: list[str], results: list[str], **attributes: Any) -> list[str]:
        from onnx import helper

        self.nodes.append(helper.make_node(operation, inputs, results, **attributes))
        return results

    def spread_ranges(self, ranges: tuple[int, int], size: int) -> None:
        """Add `normalization.spread_ranges`, for observations of so many numbers."""
        sizes = self.constant(np.array(split_at(ranges, size), np.int64))
        before, self.last, after = self._node("Split", [self.last, sizes], ["before", "ranges", "after"], axis=1)
        self.add("Add", _numbers(NEAR))
        self.add("Log")
        self.last = self._node("Concat", [before, self.last, after], ["spread"], axis=1)[0]


def _linear(graph: _OnnxGraph, layer: Any) -> None:
    graph.add("Gemm", *(part for part in (layer.weight, layer.bias) if part is not None), transB=1)


def _normalized(graph: _OnnxGraph, layer: Any) -> None:
    if layer.ranges[0] < layer.ranges[1]:
        graph.spread_ranges(layer.ranges, len(layer.mean))
    graph.add("Sub", layer.mean)
    graph.add("Div", layer.std)
    graph.add("Clip", _numbers(-CLIP), _numbers(CLIP))


_WRITERS: dict[type[nn.Module], Callable[[_OnnxGraph, Any], None]] = {
    NormalizedObservation: _normalized,
    FlattenExtractor: lambda graph, layer: graph.add("Flatten"),
    nn.Linear: _linear,
    nn.ReLU: lambda graph, layer: graph.add("Relu"),
    nn.Tanh: lambda graph, layer: graph.add("Tanh"),
}
"""Function that adds each kind of layer to a graph."""
