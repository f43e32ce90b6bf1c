"""What a bundle's model may hold: layers and finite weights of its own; everything else is refused before it is loaded."""

import re

import numpy as np
import pytest
from bundles import WEIGHTS, rewritten, small_bundle
from onnx import TensorProto, helper, numpy_helper

from turtlebot_gym_agents.policies.bundle import BundlePolicy


@pytest.fixture
def bundle(tmp_path):
    return small_bundle(tmp_path)


def outside(model):
    (weights,) = model.graph.initializer
    weights.ClearField("raw_data")
    weights.data_location = TensorProto.EXTERNAL
    for key, value in (("location", "secret.bin"), ("offset", "0"), ("length", str(WEIGHTS.nbytes))):
        weights.external_data.add(key=key, value=value)


def outside_in_a_subgraph(model):
    inner = helper.make_graph([], "inner", [], [], [numpy_helper.from_array(WEIGHTS, "V")])
    inner.initializer[0].data_location = TensorProto.EXTERNAL
    node = model.graph.node.add(op_type="Relu", input=["observation"], output=["unused"])
    node.attribute.append(helper.make_attribute("then_branch", inner))


def operator(name, domain=""):
    def change(model):
        model.graph.node[0].op_type, model.graph.node[0].domain = name, domain

    return change


def with_a_function(model):
    relu = helper.make_node("Relu", ["x"], ["y"])
    model.functions.append(helper.make_function("own", "Twice", ["x"], ["y"], [relu], []))


def not_finite(bad, packed):
    def change(model):
        values = WEIGHTS.copy()
        values[12, 1] = bad
        spoiled = numpy_helper.from_array(values, "W")
        if not packed:
            spoiled = helper.make_tensor("W", TensorProto.FLOAT, values.shape, values.ravel().tolist())
        model.graph.initializer[0].CopyFrom(spoiled)

    return change


def widths(inputs, outputs):
    def change(model):
        model.graph.initializer[0].CopyFrom(numpy_helper.from_array(np.zeros((inputs, outputs), np.float32), "W"))
        for info, size in ((model.graph.input[0], inputs), (model.graph.output[0], outputs)):
            info.type.tensor_type.shape.dim[1].dim_value = size

    return change


def fixed_batch(model):
    model.graph.input[0].type.tensor_type.shape.dim[0].dim_value = 1


def doubles(model):
    model.graph.initializer[0].CopyFrom(numpy_helper.from_array(WEIGHTS.astype(np.float64), "W"))
    for info in (model.graph.input[0], model.graph.output[0]):
        info.type.tensor_type.elem_type = TensorProto.DOUBLE


def two_outputs(model):
    model.graph.output.append(helper.make_tensor_value_info("product", TensorProto.FLOAT, ["n", 2]))


def answers_nan(model):
    model.graph.node[1].op_type = "Log"  # of the zeros that it is tried with


ELSEWHERE, OPERATOR = "its weights are in another file", "is not a policy bundle: a network has no operator"
SHAPE = "its model must be from float observations (n, 13) to float actions (n, 2)"
WRONG_MODELS = [
    (outside, ELSEWHERE),
    (outside_in_a_subgraph, ELSEWHERE),
    *((operator(name), f"{OPERATOR} '{name}'") for name in ("Loop", "Expand", "NoSuchOperator")),  # which may take for ever
    (operator("MatMul", "com.microsoft"), f"{OPERATOR} 'com.microsoft.MatMul'"),
    (with_a_function, "its model has functions of its own"),
    *(
        (not_finite(bad, packed), "its weights are not all finite numbers")
        for bad in (np.nan, np.inf, -np.inf)
        for packed in (True, False)
    ),
    *((change, SHAPE) for change in (widths(12, 2), widths(50, 2), widths(13, 3), fixed_batch, doubles, two_outputs)),
    (answers_nan, "must give 1 finite actions"),
]


@pytest.mark.parametrize(("change", "message"), WRONG_MODELS)
def test_a_model_that_a_robot_should_not_run_is_refused_without_a_word_on_standard_error(bundle, change, message, capfd):
    (bundle.parent / "secret.bin").write_bytes(WEIGHTS.tobytes())
    with pytest.raises(ValueError, match=re.escape(message)):
        BundlePolicy(rewritten(bundle, change=change))
    assert capfd.readouterr() == ("", "")
