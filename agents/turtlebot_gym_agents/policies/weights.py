"""Checks that the weights of an ONNX model in a policy bundle are inside the file and finite.

The format's messages are read by field number with protobuf, a dependency of onnxruntime; a robot has no ``onnx``.

References:
    ONNX, *onnx.proto* (onnx.ai/onnx/repo-docs/IR.html), field numbers of ModelProto, GraphProto, NodeProto, TensorProto.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

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
_DATA_TYPE, _FLOATS, _RAW, _EXTERNAL_DATA, _LOCATION = 2, 4, 9, 13, 14
_FLOAT32 = 1
_BYTES = 2
"""Wire type of fields with a length: messages, texts and packed numbers."""


def require_own_finite_weights(path: object, content: bytes) -> None:
    """Refuse an ONNX model whose weights are in other files, or not all finite.

    Args:
        path: The model's file, for the message.
        content: Content of the file.

    Raises:
        ValueError: If a weight is in another file or not finite, or the file cannot be parsed.
    """
    from google.protobuf.message import DecodeError

    try:
        tensors = list(_tensors(content, "model"))
    except (DecodeError, RecursionError) as error:
        raise ValueError(f"{path} is not a policy bundle: it is no ONNX model.") from error
    for fields in tensors:
        if any(number == _EXTERNAL_DATA or (number == _LOCATION and value) for number, _, value in fields):
            raise ValueError(f"{path}: its weights are in another file, which its hash does not cover; a bundle holds its own.")
        if (_DATA_TYPE, 0, _FLOAT32) in fields:
            blocks = [value for number, wire, value in fields if number in (_RAW, _FLOATS) and wire == _BYTES]
            if not all(len(block) % 4 == 0 and np.isfinite(np.frombuffer(block, "<f4")).all() for block in blocks):
                raise ValueError(f"{path}: its weights are not all finite numbers.")


def _tensors(content: bytes, kind: str) -> Iterator[list[tuple[int, int, Any]]]:
    """Yield the fields of all tensors in a message, each as its number, its wire type and its value."""
    from google.protobuf import empty_pb2, unknown_fields

    message = empty_pb2.Empty()
    message.MergeFromString(content)
    fields = [(field.field_number, field.wire_type, field.data) for field in unknown_fields.UnknownFieldSet(message)]
    if kind == "tensor":
        yield fields
    for number, wire, value in fields:
        if wire == _BYTES and number in _PARTS[kind]:
            yield from _tensors(value, _PARTS[kind][number])
