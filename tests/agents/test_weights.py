"""A bundle's model maps observations to finite actions; everything else is refused when it is loaded."""

import re

import numpy as np
import pytest
from bundles import WEIGHTS, rewritten, small_bundle
from onnx import TensorProto, helper, numpy_helper

from turtlebot_gym_agents.policies.bundle import BundlePolicy


@pytest.fixture
def bundle(tmp_path):
    return small_bundle(tmp_path)


def not_a_number(model):
    values = WEIGHTS.copy()
    values[12, 1] = np.nan
    model.graph.initializer[0].CopyFrom(numpy_helper.from_array(values, "W"))


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


SHAPE, FINITE = "its model must be from float observations (n, 13) to float actions (n, 2)", "must give 1 finite actions"
WRONG_MODELS = [
    *((change, SHAPE) for change in (widths(12, 2), widths(50, 2), widths(13, 3), fixed_batch, doubles, two_outputs)),
    *((change, FINITE) for change in (not_a_number, answers_nan)),
]


@pytest.mark.parametrize(("change", "message"), WRONG_MODELS)
def test_a_model_that_a_robot_should_not_run_is_refused_without_a_word_on_standard_error(bundle, change, message, capfd):
    with pytest.raises(ValueError, match=re.escape(message)):
        BundlePolicy(rewritten(bundle, change=change))
    assert capfd.readouterr() == ("", "")
