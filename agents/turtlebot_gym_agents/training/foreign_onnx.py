"""ONNX models of other programs, and TorchScript, as the network of a bundle."""

from __future__ import annotations

import io
import warnings
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from numpy.typing import NDArray

from turtlebot_gym_agents.policies.bundle import KEY
from turtlebot_gym_agents.training.stages import Normalization

if TYPE_CHECKING:
    from onnx import ModelProto

_ACTIONS = ("action", "actions", "mu", "mean", "loc")
"""Names of the output that is the action, where several have two numbers."""


class OnnxPolicy:
    """An ONNX model as a policy, run as it is, row by row if it was exported for one observation.

    Args:
        model: The model.
        normalization: Normalization of observations before it; None for none.

    Raises:
        ValueError: If it is a bundle already, cannot be run, or does not map one observation to one action.
    """

    def __init__(self, model: ModelProto, normalization: Normalization | None = None) -> None:
        import onnxruntime

        if any(entry.key == KEY for entry in model.metadata_props):
            raise ValueError("model is a policy bundle already: drive it as it is, --policy FILE.onnx.")
        options = onnxruntime.SessionOptions()
        options.log_severity_level = 4
        try:
            self._session = onnxruntime.InferenceSession(model.SerializeToString(), options, providers=["CPUExecutionProvider"])
        except Exception as error:  # onnxruntime has no common base class for its errors
            raise ValueError(f"model is not an ONNX model that onnxruntime can run: {' '.join(str(error).split())}") from error
        inputs, outputs = self._session.get_inputs(), self._session.get_outputs()
        if len(inputs) != 1 or len(inputs[0].shape) != 2 or inputs[0].type not in ("tensor(float)", "tensor(double)"):
            shapes = [(item.name, item.type, item.shape) for item in inputs]
            raise ValueError(
                f"model must have one input of observations (n, k), float or double, got {shapes}: export the actor alone; one "
                "with a state as a torch module, export(module, ..., memory=...)."
            )
        self.action = _action_of([(item.name, item.shape) for item in outputs])
        """Name of the output that is the action."""
        self.input, self.size = inputs[0].name, inputs[0].shape[1]
        self._kind, self.one = np.dtype("f4" if "float" in inputs[0].type else "f8"), inputs[0].shape[0] == 1
        self.normalization = normalization

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Do nothing: it has no memory."""

    def __call__(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        rows = observations
        if self.normalization is not None:
            rows = self.normalization(torch.from_numpy(rows)).numpy()
        rows = rows.astype(self._kind)
        parts = rows[:, None] if self.one else [rows]
        answers: list[Any] = [self._session.run([self.action], {self.input: part})[0] for part in parts]
        return np.clip(np.concatenate(answers), -1.0, 1.0).astype(np.float32)


def _action_of(outputs: list[tuple[str, Any]]) -> str:
    """Return the name of the output with two numbers."""
    pairs = [name for name, shape in outputs if len(shape) == 2 and shape[1] == 2]
    if len(pairs) == 1:
        return pairs[0]
    named = [name for name in pairs if name.lower() in _ACTIONS]
    if len(named) == 1:
        return named[0]
    raise ValueError(
        f"model must have one output of actions (n, 2), got {[(name, list(shape)) for name, shape in outputs]}: export the "
        "mean action alone."
    )


def network_model(model: ModelProto, policy: OnnxPolicy, size: int) -> ModelProto:
    """Return a copy of a model as the network of a bundle: one output of clipped actions, for any number of float observations.

    Args:
        model: The model.
        policy: The policy that it is.
        size: Numbers of an observation.
    """
    from onnx import ModelProto, TensorProto, helper
    from onnxscript.optimizer import optimize

    made = ModelProto()
    made.CopyFrom(model)
    graph = made.graph
    number = TensorProto.FLOAT
    kept = next(end for end in graph.output if end.name == policy.action)
    nodes = [
        helper.make_node("Cast", [kept.name], ["turtlebot_gym_float"], to=number),
        helper.make_node(
            "Clip", ["turtlebot_gym_float", "turtlebot_gym_least", "turtlebot_gym_most"], ["turtlebot_gym_action"]
        ),
    ]
    graph.initializer.extend(
        helper.make_tensor(f"turtlebot_gym_{name}", number, [], [value]) for name, value in (("least", -1.0), ("most", 1.0))
    )
    graph.node.extend(nodes)
    _require_used(graph, {"turtlebot_gym_action"})
    del graph.output[:], graph.value_info[:]
    if policy.one:  # what torch computes from the shape of the one observation are constants
        graph.output.append(helper.make_tensor_value_info("turtlebot_gym_action", number, [1, 2]))
        made = optimize(made)
        graph = made.graph
        del graph.output[:], graph.value_info[:]
    graph.output.append(helper.make_tensor_value_info("turtlebot_gym_action", number, ["n", 2]))
    [entry] = [end for end in graph.input if end.name == policy.input]
    kind = entry.type.tensor_type.elem_type
    del graph.input[:]
    graph.input.append(helper.make_tensor_value_info(policy.input, kind, ["n", size]))
    if (normalization := policy.normalization) is not None or kind != number:
        _precede(graph, policy.input, size, normalization, kind)
    return made


def _require_used(graph: Any, wanted: set[str]) -> None:
    """Drop the nodes of a graph on which none of some results depends, such as those of a value or a log probability."""
    kept = list[Any]()
    for node in reversed(graph.node):
        if wanted.intersection(node.output):
            kept.append(node)
            wanted.update(node.input)
    del graph.node[:]
    graph.node.extend(reversed(kept))


def _precede(graph: Any, name: str, size: int, normalization: Normalization | None, kind: int) -> None:
    """Put the normalization of observations, and the cast to their type, before a graph."""
    from onnx import TensorProto, helper, numpy_helper

    nodes, last = list[Any](), "observation_as_seen"

    def add(operation: str, *constants: Any, **attributes: Any) -> None:
        nonlocal last
        names = [f"turtlebot_gym_{len(nodes)}_{place}" for place in range(len(constants))]
        graph.initializer.extend(
            numpy_helper.from_array(np.asarray(value), key) for value, key in zip(constants, names, strict=True)
        )
        nodes.append(helper.make_node(operation, [last, *names], [f"turtlebot_gym_step_{len(nodes)}"], **attributes))
        last = nodes[-1].output[0]

    if normalization is not None:
        mean, scale = normalization.mean.numpy(), normalization.scale.numpy()
        add("Cast", to=helper.np_dtype_to_tensor_dtype(mean.dtype))
        add("Sub", mean)
        add("Div", scale)
        if np.isfinite(normalization.clip):
            add("Clip", *np.array([-normalization.clip, normalization.clip], mean.dtype))
        add("Cast", to=TensorProto.FLOAT)
    add("Cast", to=kind)
    nodes[-1].output[0] = name
    before = [*nodes, *graph.node]
    del graph.node[:], graph.input[:]
    graph.node.extend(before)
    graph.input.append(helper.make_tensor_value_info("observation_as_seen", TensorProto.FLOAT, ["n", size]))


def script_model(script: torch.jit.ScriptModule, size: int) -> ModelProto:
    """Return a TorchScript module as ONNX, by torch's exporter for it.

    Raises:
        ValueError: If torch cannot export it.
    """
    import onnx

    content = io.BytesIO()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # torch prefers its newer exporter, which does not take TorchScript
            torch.onnx.export(
                script.eval(),
                (torch.zeros(2, size),),
                content,  # pyright: ignore[reportArgumentType]
                input_names=["observation"],
                output_names=["action"],
                dynamic_axes={"observation": {0: "n"}, "action": {0: "n"}},
                dynamo=False,
            )
    except Exception as error:  # torch's exporter has errors of its own
        reason = " ".join(str(error).split())[:200]
        raise ValueError(f"model is TorchScript that torch cannot export: {type(error).__name__}: {reason}") from error
    return onnx.load_from_string(content.getvalue())
