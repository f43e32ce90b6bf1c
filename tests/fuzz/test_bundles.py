"""Whatever a file is that is given for a policy bundle, it drives with finite actions, or is refused with one line."""

import hashlib
import json

import numpy as np
import pytest
from fuzzing import FOLDER, VALUES, answered, fuzzed, mutated, replaced
from hypothesis import strategies as st

pytest.importorskip("onnxruntime", reason="needs the extra [deploy]")
onnx = pytest.importorskip("onnx", reason="needs the extra [agents]")

from turtlebot_gym_agents.policies.bundle import BundlePolicy, _verified_hash, _with_hash
from turtlebot_gym_agents.policies.named import pretrained_folder

CONTENT = (pretrained_folder() / "ppo-nav.onnx").read_bytes()
CARD = json.loads({entry.key: entry.value for entry in onnx.load_from_string(CONTENT).metadata_props}["turtlebot_gym"])["card"]
SHAPES = [(13,), (1, 13), (4, 13)]


def hashed(content):
    """Return a bundle's content with the hash that it has to have."""
    try:
        blank = _with_hash(content, "0" * 64)
        return _with_hash(content, hashlib.sha256(blank).hexdigest())
    except ValueError:
        return content


def drives(content):
    path = FOLDER / "policy.onnx"
    path.write_bytes(content)
    policy = BundlePolicy(path, robot="burger", dt=0.1)
    for shape in SHAPES:
        observations = np.random.default_rng(1).normal(size=shape).astype(np.float32)
        actions = policy(observations)
        assert actions.shape == (*shape[:-1], 2)
        assert np.isfinite(actions).all()
    return policy


def with_card(card):
    model = onnx.load_from_string(CONTENT)
    del model.metadata_props[:]
    model.metadata_props.add(key="turtlebot_gym", value=json.dumps({"sha256": "0" * 64, "card": card}))
    return hashed(model.SerializeToString())


def test_the_bundle_itself_drives():
    assert drives(CONTENT)
    assert drives(with_card(CARD))
    assert _verified_hash("a", hashed(CONTENT))


@pytest.mark.nightly
@fuzzed(120, 1800, content=st.one_of(st.binary(max_size=300), mutated(CONTENT)), sealed=st.booleans())
def test_damaged_bundles_also_with_the_right_hash(content, sealed):
    answered("damaged bundles", lambda: drives(hashed(content) if sealed else content))


@pytest.mark.nightly
@fuzzed(30, 1200, data=st.data())
def test_other_cards(data):
    answered("cards", lambda: drives(with_card(replaced(data.draw, CARD, VALUES))))


NUMBERS = st.sampled_from([float("nan"), float("inf"), 1e38, -1e38, 0.0, 1e-45])


def with_other_model(draw):
    """Return a bundle whose model has another shape, type, weight, node or name."""
    model = onnx.load_from_string(CONTENT)
    graph = model.graph
    how = draw(st.sampled_from(["weight", "shape", "type", "node", "cut", "name", "batch", "opset", "output", "huge"]))
    tensor = graph.initializer[draw(st.integers(0, len(graph.initializer) - 1))]
    node = graph.node[draw(st.integers(0, len(graph.node) - 1))]
    value = draw(st.sampled_from([graph.input[0], graph.output[0]]))
    if how == "weight":
        array = onnx.numpy_helper.to_array(tensor).copy()
        array.flat[draw(st.integers(0, array.size - 1))] = draw(NUMBERS)
        tensor.CopyFrom(onnx.numpy_helper.from_array(array, tensor.name))
    elif how == "huge":
        array = onnx.numpy_helper.to_array(tensor) * np.float32(1e37)
        tensor.CopyFrom(onnx.numpy_helper.from_array(array.astype(np.float32), tensor.name))
    elif how == "shape":
        value.type.tensor_type.shape.dim[-1].dim_value = draw(st.integers(-2, 60))
    elif how == "batch":
        value.type.tensor_type.shape.dim[0].dim_value = draw(st.integers(-2, 9))
    elif how == "type":
        value.type.tensor_type.elem_type = draw(st.integers(0, 25))
    elif how == "node":
        node.op_type = draw(st.sampled_from(["Relu", "Sqrt", "Log", "Reciprocal", "Loop", "If", "", "Nonsense", "Concat"]))
    elif how == "cut":
        graph.node.remove(node)
    elif how == "name":
        node.input[0] = draw(st.sampled_from(["", "observation", "nothing", tensor.name]))
    elif how == "opset":
        model.opset_import[0].version = draw(st.integers(-1, 99))
    else:
        graph.output.add().CopyFrom(graph.output[0])
    return hashed(model.SerializeToString())


@pytest.mark.nightly
@fuzzed(25, 600, data=st.data())
def test_other_models(data):
    answered("models", lambda: drives(with_other_model(data.draw)))
