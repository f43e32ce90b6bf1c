"""A bundle of a few kilobytes that asks for any amount of time or memory is refused in time; results are replaced whole."""

import os
import resource
import time

import matplotlib.pyplot as plt
import numpy as np
import pytest
from bundles import CARD, linear_model, rewritten, small_bundle
from onnx import TensorProto, helper, numpy_helper

from turtlebot_gym_agents.commands.console import save_figure
from turtlebot_gym_agents.policies.bundle import BundlePolicy, write_bundle
from turtlebot_gym_agents.provenance import replace_json, write_json


def concats(model):
    """Double a tensor 24 times; of the last one, the mean counts."""
    nodes, before = [], "product"
    for k in range(24):
        nodes.append(helper.make_node("Concat", [before, before], [before := f"twice{k}"], axis=1))
    nodes += [
        helper.make_node("Slice", [before, "first", "end", "axis"], ["cut"]),
        helper.make_node("Tanh", ["cut"], ["action"]),
    ]
    del model.graph.node[1:]
    model.graph.node.extend(nodes)
    for name, number in (("first", 0), ("end", 2), ("axis", 1)):
        model.graph.initializer.append(numpy_helper.from_array(np.array([number]), name))


def of_constants(model):
    """Double a constant 30 times, which onnxruntime works out when it loads the model."""
    concats(model)
    model.graph.node[1].input[:] = ["W", "W"]
    model.graph.node.append(helper.make_node("Identity", ["product"], ["unused"]))


def wide_conv(model):
    """Convolve what is padded by 500 million zeros on either side."""
    del model.graph.node[1:]
    model.graph.node.extend(
        [
            helper.make_node("Unsqueeze", ["product", "axis"], ["row"]),
            helper.make_node("Conv", ["row", "kernel"], ["wide"], pads=[500_000_000, 500_000_000], kernel_shape=[3]),
            helper.make_node("GlobalMaxPool", ["wide"], ["one"]),
            helper.make_node("Concat", ["one", "one"], ["two"], axis=2),
            helper.make_node("Squeeze", ["two", "axis"], ["action"]),
        ]
    )
    model.graph.initializer.append(numpy_helper.from_array(np.array([1]), "axis"))
    model.graph.initializer.append(numpy_helper.from_array(np.ones((1, 1, 3), np.float32), "kernel"))


def grows_with_the_batch(model):
    """Multiply the observations with each other, eight at a time: 1,000 of them need 10^12 numbers."""
    del model.graph.node[1:]
    model.graph.node.extend(
        [
            helper.make_node("Transpose", ["product"], ["turned"]),
            helper.make_node("MatMul", ["product", "turned"], ["pairs"]),
            helper.make_node("Unsqueeze", ["pairs", "axis"], ["row"]),
            helper.make_node("Unsqueeze", ["pairs", "last"], ["column"]),
            helper.make_node("Add", ["row", "column"], ["all"]),
            helper.make_node("ReduceMax", ["all"], ["most"], keepdims=0),
            helper.make_node("Add", ["product", "most"], ["sum"]),
            helper.make_node("Tanh", ["sum"], ["action"]),
        ]
    )
    for name, number in (("axis", 1), ("last", 2)):
        model.graph.initializer.append(numpy_helper.from_array(np.array([number]), name))


@pytest.fixture
def bundle(tmp_path):
    return small_bundle(tmp_path)


@pytest.mark.parametrize("change", [concats, of_constants, wide_conv, grows_with_the_batch])
def test_a_model_that_takes_too_much_is_refused(bundle, change, monkeypatch, capfd):
    monkeypatch.setattr("turtlebot_gym.bounded.SECONDS", 4)
    rewritten(bundle, change=change)
    assert bundle.stat().st_size < 6000
    since = time.monotonic()
    with pytest.raises(ValueError, match="takes more than 2 s of computing or 400 MB of memory"):
        BundlePolicy(bundle)
    assert time.monotonic() - since < 30.0
    assert max(resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_CHILDREN, resource.RUSAGE_SELF)) < 1e6  # kB
    assert capfd.readouterr() == ("", "")


def sized_by_observation(model):
    """Let the first number of an observation say how much of a tensor counts."""
    concats(model)
    cut = next(node for node in model.graph.node if node.op_type == "Slice")
    cut.input[2] = "length"
    at = list(model.graph.node).index(cut)
    nodes = [*model.graph.node[:at], helper.make_node("Cast", ["product"], ["length"], to=TensorProto.INT64)]
    nodes += model.graph.node[at:]
    del model.graph.node[:]
    model.graph.node.extend(nodes)


def test_a_model_whose_sizes_depend_on_what_is_observed_is_refused(bundle):
    rewritten(bundle, change=sized_by_observation)
    with pytest.raises(ValueError, match="the sizes of its 'Slice' depend on what is observed"):
        BundlePolicy(bundle)


def in_its_own_shape(model):
    """Reshape to the tensor's own shape, worked out as exporters write it."""
    model.graph.node[1].input[0] = "same"
    shape = [
        helper.make_node("Shape", ["observation"], ["shape"]),
        helper.make_node("Slice", ["shape", "first", "end"], ["rows"]),
        helper.make_node("Concat", ["rows", "width"], ["target"], axis=0),
        helper.make_node("Reshape", ["product", "target"], ["same"]),
    ]
    nodes = [model.graph.node[0], *shape, model.graph.node[1]]
    del model.graph.node[:]
    model.graph.node.extend(nodes)
    for name, number in (("first", 0), ("end", 1), ("width", 2)):
        model.graph.initializer.append(numpy_helper.from_array(np.array([number]), name))


def test_sizes_from_the_number_of_observations_are_taken(bundle):
    expected = BundlePolicy(bundle)(np.eye(13))
    np.testing.assert_array_equal(BundlePolicy(rewritten(bundle, change=in_its_own_shape))(np.eye(13)), expected)


def test_a_pipe_for_a_bundle_is_refused(tmp_path):
    os.mkfifo(tmp_path / "policy.onnx")
    with pytest.raises(ValueError, match="it is a pipe"):
        BundlePolicy(tmp_path / "policy.onnx")


WRITE = {
    "a.json": lambda path: write_json(path, {"numbers": list(range(100))}, config={}),
    "b.json": lambda path: replace_json(path, list(range(100))),
    "c.onnx": lambda path: write_bundle(path, linear_model(), CARD),
    "d.png": lambda path: save_figure(plt.figure(), path),
    "e.svg": lambda path: save_figure(plt.figure(), path),
}


@pytest.mark.parametrize("name", WRITE)
def test_a_full_disk_leaves_the_old_result(tmp_path, name):
    path = tmp_path / name
    WRITE[name](path)
    before, limit = path.read_bytes(), resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (64, limit[1]))
    try:
        with pytest.raises(OSError, match="File too large"):
            WRITE[name](path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limit)
    plt.close("all")
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]
