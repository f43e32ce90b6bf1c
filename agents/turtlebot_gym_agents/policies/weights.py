"""Checks of an ONNX model in a policy bundle before it is loaded: its operators are known ones, its weights its own and finite.

The format's messages are read by field number with protobuf, a dependency of onnxruntime; a robot has no ``onnx``.

References:
    ONNX, *onnx.proto* (onnx.ai/onnx/repo-docs/IR.html), field numbers of ModelProto, GraphProto, NodeProto, TensorProto.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from turtlebot_gym.validation import short_repr

_PARTS: dict[str, dict[int, str]] = {
    "model": {7: "graph", 20: "training", 25: "function"},
    "training": {1: "graph", 2: "graph"},
    "graph": {1: "node", 5: "tensor", 15: "sparse"},
    "function": {7: "node"},
    "node": {5: "attribute"},
    "attribute": {5: "tensor", 6: "graph", 10: "tensor", 11: "graph", 22: "sparse", 23: "sparse"},
    "sparse": {1: "tensor", 2: "tensor"},
    "tensor": {},
}
"""Field numbers that hold messages in each kind of message, and the kinds of these."""
_DATA_TYPE, _FLOATS, _RAW, _DOUBLES, _EXTERNAL_DATA, _LOCATION = 2, 4, 9, 10, 13, 14
_FLOAT_TYPES = {1: "<f4", 11: "<f8"}
"""Numbers of the data types float and double, and numpy's names of them."""
_NODE, _TENSOR, _NAME, _INPUT, _OUTPUT = 1, 5, 8, 1, 2
_BYTES = 2
"""Wire type of fields with a length: messages, texts and packed numbers."""
_OPERATOR, _DOMAIN = 4, 7

_OPERATORS = {
    "Abs",
    "Add",
    "And",
    "AveragePool",
    "BatchNormalization",
    "Cast",
    "Ceil",
    "Celu",
    "Clip",
    "Concat",
    "Constant",
    "Conv",
    "Cos",
    "Div",
    "Dropout",
    "Elu",
    "Equal",
    "Erf",
    "Exp",
    "Flatten",
    "Floor",
    "GRU",
    "Gather",
    "Gelu",
    "Gemm",
    "GlobalAveragePool",
    "GlobalMaxPool",
    "Greater",
    "GreaterOrEqual",
    "HardSigmoid",
    "HardSwish",
    "Identity",
    "InstanceNormalization",
    "LSTM",
    "LayerNormalization",
    "LeakyRelu",
    "Less",
    "LessOrEqual",
    "Log",
    "LogSoftmax",
    "MatMul",
    "Max",
    "MaxPool",
    "Mean",
    "Min",
    "Mish",
    "Mod",
    "Mul",
    "Neg",
    "Not",
    "Or",
    "PRelu",
    "Pow",
    "RNN",
    "Reciprocal",
    "ReduceL2",
    "ReduceMax",
    "ReduceMean",
    "ReduceMin",
    "ReduceSum",
    "Relu",
    "Reshape",
    "Round",
    "Selu",
    "Shape",
    "Sigmoid",
    "Sign",
    "Sin",
    "Slice",
    "Softmax",
    "Softplus",
    "Softsign",
    "Split",
    "Sqrt",
    "Squeeze",
    "Sub",
    "Sum",
    "Tan",
    "Tanh",
    "Transpose",
    "Unsqueeze",
    "Where",
    "Xor",
}
"""Operators of ONNX in which layers of networks are written. None of them draws random numbers, or creates an
array of a size given in the file: with an `Expand`, 300 bytes could take all memory. None loops but `GRU`, `LSTM` and `RNN`,
along an axis of their input; a `Loop` could take all time."""
_SIZED = {"ReduceL2", "ReduceMax", "ReduceMean", "ReduceMin", "ReduceSum", "Reshape", "Slice", "Split", "Squeeze", "Unsqueeze"}
"""Operators whose further inputs say how large their output is."""


def require_safe_model(path: object, content: bytes) -> None:
    """Refuse an ONNX model with other operators than those of layers, or whose weights are in other files or not all finite.

    Args:
        path: The model's file, for the message.
        content: Content of the file.

    Raises:
        ValueError: If it is such a model, or the file cannot be parsed.
    """
    from google.protobuf.message import DecodeError

    try:
        parts = list(_parts(content, "model"))
    except (DecodeError, RecursionError) as error:
        raise ValueError(f"{path} is not a policy bundle: it is not an ONNX model.") from error
    for kind, fields in parts:
        if kind == "tensor":
            _require_own_finite(path, fields)
        elif kind == "node":
            names = {number: value.decode("utf-8", "replace") for number, _, value in fields if number in (_OPERATOR, _DOMAIN)}
            operator, domain = names.get(_OPERATOR, ""), names.get(_DOMAIN, "")
            if operator not in _OPERATORS or domain not in ("", "ai.onnx"):
                name = f"{domain}.{operator}" if domain else operator
                raise ValueError(f"{path} is not a policy bundle: a network has no operator {short_repr(name)}.")
        elif kind == "graph":
            _require_fixed_sizes(path, fields)
        elif kind == "function":
            raise ValueError(f"{path} is not a policy bundle: its model has functions of its own.")


def _require_own_finite(path: object, fields: list[tuple[int, int, Any]]) -> None:
    """Refuse a tensor in another file, or whose numbers are not all finite."""
    if any(number == _EXTERNAL_DATA or (number == _LOCATION and value) for number, _, value in fields):
        raise ValueError(f"{path}: its weights are in another file, which its hash does not cover; a bundle holds its own.")
    for kind in (np.dtype(name) for number, name in _FLOAT_TYPES.items() if (_DATA_TYPE, 0, number) in fields):
        blocks = [value for number, wire, value in fields if number in (_RAW, _FLOATS, _DOUBLES) and wire == _BYTES]
        if not all(len(block) % kind.itemsize == 0 and np.isfinite(np.frombuffer(block, kind)).all() for block in blocks):
            raise ValueError(f"{path}: its weights are not all finite numbers.")


def _require_fixed_sizes(path: object, fields: list[tuple[int, int, Any]]) -> None:
    """Refuse a graph in which sizes depend on what is observed: no try shows how much time and memory it takes."""
    fixed = {b"", *(name for tensor in _values(fields, _TENSOR) for name in _values(_fields(tensor), _NAME))}
    for node in map(_fields, _values(fields, _NODE)):
        inputs, operator = _values(node, _INPUT), b"".join(_values(node, _OPERATOR)).decode("utf-8", "replace")
        if operator in _SIZED and not fixed.issuperset(inputs[1:]):
            raise ValueError(
                f"{path} is not a policy bundle: the sizes of its {short_repr(operator)} depend on what is observed."
            )
        if operator == "Shape" or fixed.issuperset(inputs):
            fixed.update(_values(node, _OUTPUT))


def _values(fields: list[tuple[int, int, Any]], wanted: int) -> list[bytes]:
    """Return the messages or texts of a field."""
    return [value for number, wire, value in fields if number == wanted and wire == _BYTES]


def _fields(content: bytes) -> list[tuple[int, int, Any]]:
    """Return the fields of a message: number, wire type, value."""
    from google.protobuf import empty_pb2, unknown_fields

    message = empty_pb2.Empty()
    message.MergeFromString(content)
    return [(field.field_number, field.wire_type, field.data) for field in unknown_fields.UnknownFieldSet(message)]


def _parts(content: bytes, kind: str) -> Iterator[tuple[str, list[tuple[int, int, Any]]]]:
    """Yield the kind and the fields of each message in a message."""
    fields = _fields(content)
    yield kind, fields
    for number, wire, value in fields:
        if wire == _BYTES and number in _PARTS[kind]:
            yield from _parts(value, _PARTS[kind][number])
