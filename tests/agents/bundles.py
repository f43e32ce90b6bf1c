"""A small policy bundle, and ways to spoil it, for tests of what is refused."""

import hashlib
import json

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from turtlebot_gym.observations import OPEN_GROUND
from turtlebot_gym_agents.policies.bundle import Card, described, write_bundle
from turtlebot_gym_agents.policies.fit import describe_robot

CARD = Card(
    env="turtlebot_gym/TurtleBotNav-v0",
    robot=describe_robot("burger"),
    dt=0.1,
    noise="tutorial",
    filter="matched",
    observation="ekf",
    terms=described(OPEN_GROUND),
    training={"seed": 3, "sha256": "0" * 64},
)
WEIGHTS = np.random.default_rng(0).normal(size=(13, 2)).astype(np.float32)


def linear_model() -> onnx.ModelProto:
    """Return the policy ``action = tanh(observation W)``."""
    graph = helper.make_graph(
        [helper.make_node("MatMul", ["observation", "W"], ["product"]), helper.make_node("Tanh", ["product"], ["action"])],
        "linear",
        [helper.make_tensor_value_info("observation", TensorProto.FLOAT, ["n", 13])],
        [helper.make_tensor_value_info("action", TensorProto.FLOAT, ["n", 2])],
        [numpy_helper.from_array(WEIGHTS, "W")],
    )
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=10)


def small_bundle(folder):
    """Write that policy into a folder, and return the bundle's path."""
    path = folder / "policy.onnx"
    write_bundle(path, linear_model(), CARD)
    return path


def metadata(path):
    """Return a bundle's metadata, read by ONNX."""
    [entry] = onnx.load(path).metadata_props
    assert entry.key == "turtlebot_gym"
    return json.loads(entry.value)


def seal(path, blank):
    """Write a file with its own hash, whatever else it contains."""
    path.write_bytes(blank.replace(b"0" * 64, hashlib.sha256(blank).hexdigest().encode(), 1))


def rewritten(bundle, *, card=lambda card: card, change=lambda model: None):
    """Write a bundle with another card and another model, and its own hash."""
    model, content = onnx.load(bundle), {"sha256": "0" * 64, "card": card(metadata(bundle)["card"])}
    change(model)
    del model.metadata_props[:]
    model.metadata_props.add(key="turtlebot_gym", value=json.dumps(content))
    seal(bundle, model.SerializeToString())
    return bundle
