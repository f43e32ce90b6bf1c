"""The ONNX graph of a chain of layers, written directly in milliseconds, where torch's exporter takes seconds.

It supports the layers of this package's policies. `export` uses torch's exporter for networks with other layers, and compares
either graph with its network.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import FlattenExtractor
from stable_baselines3.sac.policies import SACPolicy
from stable_baselines3.td3.policies import TD3Policy
from torch import nn

from turtlebot_gym.rooms.lidar import SECTORS
from turtlebot_gym.systems import ROOM_LAYOUT, SIZES
from turtlebot_gym_agents.training.normalization import CLIP, NEAR, NormalizedObservation

if TYPE_CHECKING:
    from onnx import ModelProto

OPSET, IR_VERSION = 20, 10
"""The same versions as torch's exporter; onnxruntime reads them from 1.18."""


def graph_of(policy: Any) -> ModelProto | None:
    """Return the ONNX model from observations (n, size) to deterministic actions of an SB3 policy, clipped to [-1, 1].

    Args:
        policy: A policy with one-dimensional box spaces.

    Returns:
        The model; None if the policy or one of its layers is of an unsupported kind.
    """
    from onnx import TensorProto, helper

    chain = list(_flat(_layers_of(policy)))
    if not chain or not all(type(layer) in _WRITERS for layer in chain):
        return None
    graph = _Graph("observation")
    for layer in chain:
        _WRITERS[type(layer)](graph, layer)
    graph.add("Clip", _numbers(-1.0), _numbers(1.0), result="action")
    ends = [
        [helper.make_tensor_value_info(name, TensorProto.FLOAT, ["n", *space.shape])]
        for name, space in (("observation", policy.observation_space), ("action", policy.action_space))
    ]
    made = helper.make_graph(graph.nodes, "policy", *ends, initializer=graph.constants)
    opset = [helper.make_opsetid("", OPSET)]
    return helper.make_model(made, opset_imports=opset, ir_version=IR_VERSION, producer_name="turtlebot_gym")


def _layers_of(policy: Any) -> list[nn.Module]:
    """Return the layers from an observation to the deterministic action; empty if the policy is of an unsupported kind."""
    if type(policy) is ActorCriticPolicy:  # PPO, A2C
        return [policy.pi_features_extractor, policy.mlp_extractor.policy_net, policy.action_net]
    if type(policy) is SACPolicy:
        return [policy.actor.features_extractor, policy.actor.latent_pi, policy.actor.mu, nn.Tanh()]
    if type(policy) is TD3Policy:  # TD3, DDPG
        return [policy.actor.features_extractor, policy.actor.mu]
    return []


def _flat(layers: Sequence[nn.Module]) -> Iterator[nn.Module]:
    for layer in layers:
        if type(layer) is nn.Sequential:
            yield from _flat(list(layer))
        else:
            yield layer


def _numbers(values: Any) -> np.ndarray:
    return np.asarray(values, np.float32)


class _Graph:
    """A graph to which operations are appended, each with the previous result as its first input."""

    def __init__(self, begin: str) -> None:
        self.nodes: list[Any] = []
        self.constants: list[Any] = []
        self.last = begin

    def constant(self, values: torch.Tensor | np.ndarray) -> str:
        """Add an array, and return its name."""
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

    def spread_ranges(self) -> None:
        """Add `normalization.spread_ranges`, for the layout of rooms."""
        before = SIZES[ROOM_LAYOUT] - SECTORS - 1
        sizes = self.constant(np.array([before, SECTORS, 1], np.int64))
        belief, ranges, age = self._node("Split", [self.last, sizes], ["belief", "ranges", "age"], axis=1)
        self.last = ranges
        self.add("Add", _numbers(NEAR))
        self.add("Log")
        self.last = self._node("Concat", [belief, self.last, age], ["spread"], axis=1)[0]


def _linear(graph: _Graph, layer: Any) -> None:
    graph.add("Gemm", *(part for part in (layer.weight, layer.bias) if part is not None), transB=1)


def _normalized(graph: _Graph, layer: Any) -> None:
    if len(layer.mean) == SIZES[ROOM_LAYOUT]:
        graph.spread_ranges()
    graph.add("Sub", layer.mean)
    graph.add("Div", layer.std)
    graph.add("Clip", _numbers(-CLIP), _numbers(CLIP))


_WRITERS: dict[type[nn.Module], Callable[[_Graph, Any], None]] = {
    NormalizedObservation: _normalized,
    FlattenExtractor: lambda graph, layer: graph.add("Flatten"),
    nn.Linear: _linear,
    nn.ReLU: lambda graph, layer: graph.add("Relu"),
    nn.Tanh: lambda graph, layer: graph.add("Tanh"),
}
"""Function that adds each kind of layer to a graph."""
