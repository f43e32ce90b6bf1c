"""The network in a bundle: an ONNX model that onnxruntime runs, with the memory that it carries from a step to the next.

A network without memory maps observations (n, k) to actions (n, 2). One with memory also takes m numbers per row and returns
those for the next step, both of shape (n, m). An episode begins with zeros: so do the state of an LSTM and an empty frame
stack.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


class OnnxNetwork:
    """An ONNX model that onnxruntime runs.

    Args:
        path: The model's file, for messages.
        content: Content of the file.

    Raises:
        ValueError: If it is not a model.
        ImportError: If onnxruntime is missing.
    """

    def __init__(self, path: object, content: bytes) -> None:
        try:
            import onnxruntime
        except ImportError as error:
            raise ImportError("A policy bundle needs onnxruntime: pip install 'turtlebot-gym[deploy]'.") from error
        self._path = path
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 4
        try:
            self._session = onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
        except Exception as error:  # onnxruntime has no common base class for its errors
            raise ValueError(f"{path} is not a policy bundle: {' '.join(str(error).split())}.") from error
        inputs: Any = self._session.get_inputs()
        self._inputs = [item.name for item in inputs]
        self.metadata: dict[str, str] = self._session.get_modelmeta().custom_metadata_map
        """Texts in the file by their keys."""
        self.memory: int = inputs[1].shape[-1] if len(inputs) == 2 and inputs[1].shape else 0
        """How many numbers it carries from a step to the next; 0 for a network without memory."""

    def require_shapes(self, size: int) -> None:
        """Refuse a model that does not return one action, and one memory, per observation of so many numbers."""
        inputs, outputs = self._session.get_inputs(), self._session.get_outputs()
        has_memory = isinstance(self.memory, int) and self.memory > 0
        wanted = ["tensor(float)", [size]], *([["tensor(float)", [self.memory]]] if has_memory else [])
        results = ["tensor(float)", [2]], *wanted[1:]
        ends = [[end.type, end.shape[1:]] for end in (*inputs, *outputs)]
        if ends != [*wanted, *results] or any(isinstance(end.shape[0], int) for end in inputs):
            memory = ", beside them from a memory (n, m) to the next one" if len(inputs) > 1 else ""
            raise ValueError(
                f"{self._path}: its model must be from float observations (n, {size}) to float actions (n, 2){memory}, it is "
                f"from {[(end.type, end.shape) for end in inputs]} to {[(end.type, end.shape) for end in outputs]}."
            )
        for rows in (1, 3):  # alone, and in a batch: a model may fix either size
            observations = np.full((rows, size), 0.5, np.float32)
            observations[-1], observations[0] = 1.0, 0.0
            memory = np.zeros((rows, self.memory), np.float32)
            for _ in range(2):  # the second time with its own memory
                try:
                    actions, memory = self.run(observations, memory)
                except Exception as error:  # onnxruntime has no common base class for its errors
                    raise ValueError(f"{self._path}: its model does not run: {' '.join(str(error).split())}") from error
                shapes = actions.shape, memory.shape
                if shapes != ((rows, 2), (rows, self.memory)) or not (np.isfinite(actions).all() and np.isfinite(memory).all()):
                    raise ValueError(f"{self._path}: its model must give {rows} finite actions for as many observations.")

    def run(
        self, observations: NDArray[np.float32], memory: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return actions (n, 2), and the next memory (n, m) or what is given, for observations (n, k) and a memory (n, m)."""
        values = (observations, memory) if self.memory else (observations,)
        answers: Any = self._session.run(None, dict(zip(self._inputs, values, strict=True)))
        return answers[0], answers[1] if self.memory else memory
