"""The layers of this package's policies as ONNX, written directly: in milliseconds, where torch's exporter takes seconds."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from stable_baselines3.common.torch_layers import FlattenExtractor
from torch import nn

from turtlebot_gym_agents.training.normalization import CLIP, NEAR, NormalizedObservation, split_at

if TYPE_CHECKING:
    from onnx import ModelProto

OPSET, IR_VERSION = 20, 10
"""The same versions as torch's exporter; onnxruntime reads them from 1.18."""


def flat(layers: Iterable[nn.Module]) -> Iterator[nn.Module]:
    """Yield layers, those within `nn.Sequential` one by one."""
    for layer in layers:
        if type(layer) is nn.Sequential:
            yield from flat(layer)
        else:
            yield layer


def graph_of(layers: Sequence[nn.Module], size: int) -> ModelProto | None:
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
