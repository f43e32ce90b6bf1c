"""The policy bundle: what it says, what it refuses, and that it needs neither torch nor Stable-Baselines3."""

import hashlib
import json
import os
import pickle
import re
import subprocess
import sys
from dataclasses import fields, replace

import numpy as np
import onnx
import pytest
import torch
from onnx import TensorProto, helper, numpy_helper
from stable_baselines3 import PPO

from turtlebot_gym import ROBOTS
from turtlebot_gym_agents.policies import make_policy
from turtlebot_gym_agents.policies.bundle import BundlePolicy, Card, write_bundle
from turtlebot_gym_agents.policies.fit import describe_robot
from turtlebot_gym_agents.training.export import load_model

CARD = Card(
    env="turtlebot_gym/TurtleBotNav-v0",
    robot=describe_robot("burger"),
    dt=0.1,
    noise="tutorial",
    filter="matched",
    observation="ekf",
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


@pytest.fixture
def bundle(tmp_path):
    path = tmp_path / "policy.onnx"
    write_bundle(path, linear_model(), CARD)
    return path


def test_round_trip(bundle):
    policy = BundlePolicy(bundle, robot="burger", dt=0.1)
    assert policy.card == CARD
    assert bundle.stat().st_size < 200_000
    onnx.checker.check_model(onnx.load(bundle))
    for shape in [(13,), (1, 13), (5, 13), (2, 3, 13)]:
        observations = np.random.default_rng(1).normal(size=shape).astype(np.float32)
        actions = policy(observations)
        assert (actions.shape, actions.dtype) == ((*shape[:-1], 2), np.float32)
        np.testing.assert_allclose(actions, np.tanh(observations @ WEIGHTS), atol=1e-6)


def test_robots_with_infinite_limits_pass_through_json(tmp_path):
    write_bundle(tmp_path / "policy.onnx", linear_model(), replace(CARD, robot=describe_robot("tutorial")))
    BundlePolicy(tmp_path / "policy.onnx", robot="tutorial")
    with pytest.raises(ValueError, match=r"max_wheel None there, 0\.2097 here"):
        BundlePolicy(tmp_path / "policy.onnx", robot="burger")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"dt": 0.05}, "made for 10 Hz burger, asked for 20 Hz burger"),
        ({"robot": "waffle"}, "made for 10 Hz burger, asked for 10 Hz waffle"),
        ({"robot": "waffle", "dt": 0.05}, "made for 10 Hz burger, asked for 20 Hz waffle"),
        ({"dt": 0.1 + 2e-9}, "made for 10 Hz burger, asked for 10 Hz burger"),
        ({"dt": 0.1 - 2e-9}, "made for 10 Hz burger, asked for 10 Hz burger"),
        ({"robot": replace(ROBOTS["burger"], reverse=False)}, "reverse True there, False here"),
        ({"robot": replace(ROBOTS["burger"], max_linear_acceleration=1.0)}, "max_linear_acceleration None there, 1.0 here"),
    ],
)
def test_refuses_another_robot_or_period_by_name(bundle, options, message):
    with pytest.raises(ValueError, match=message):
        BundlePolicy(bundle, **options)


@pytest.mark.parametrize("same", [{"robot": replace(ROBOTS["burger"], radius=0.2)}, {"dt": 0.1 + 9e-10}, {"dt": 0.1 - 9e-10}])
def test_the_name_and_the_drawing_of_a_robot_and_rounding_do_not_matter(bundle, same):
    BundlePolicy(bundle, **same)


@pytest.mark.parametrize("change", [{"layout": 3}, {"format": "turtlebot-gym-policy/9"}, {"action": "wheel speeds"}])
def test_refuses_another_layout_format_or_action(tmp_path, change):
    write_bundle(tmp_path / "policy.onnx", linear_model(), replace(CARD, **change))
    with pytest.raises(ValueError, match=str(next(iter(change.values())))):
        BundlePolicy(tmp_path / "policy.onnx")


def test_refuses_every_damaged_byte(bundle):
    content = bundle.read_bytes()
    for at in range(0, len(content), 7):
        damaged = bytearray(content)
        damaged[at] ^= 0x10
        bundle.write_bytes(damaged)
        with pytest.raises(ValueError, match=r"damaged|not a policy bundle"):
            BundlePolicy(bundle)


def test_refuses_onnx_models_that_are_not_bundles(tmp_path):
    onnx.save(linear_model(), tmp_path / "foreign.onnx")
    with pytest.raises(ValueError, match="not a policy bundle"):
        BundlePolicy(tmp_path / "foreign.onnx")


def test_runs_without_torch_and_stable_baselines3(bundle):
    program = f"""
import sys
for name in ("torch", "stable_baselines3", "onnx", "gymnasium", "numba"):
    sys.modules[name] = None  # importing it raises
import numpy as np
from turtlebot_gym_agents.policies.bundle import BundlePolicy
print(BundlePolicy({str(bundle)!r}, robot="burger", dt=0.1)(np.zeros(13)).tolist())
"""
    done = subprocess.run([sys.executable, "-W", "error", "-c", program], capture_output=True, text=True, check=False)
    assert json.loads(done.stdout or "null") == [0.0, 0.0], done.stderr


class _Trap:
    """Makes a file when it is unpickled."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return (open, (str(self.path), "w"))


@pytest.mark.filterwarnings("ignore::ResourceWarning")
def test_code_in_a_pickled_file_is_run_only_where_it_is_allowed(tmp_path):
    torch.set_num_threads(1)
    sprung, zipped, pickled = (tmp_path / name for name in ("sprung", "evil.zip", "evil.pkl"))
    model = PPO("MlpPolicy", "CartPole-v1", device="cpu")
    model.trap = _Trap(sprung)
    model.save(zipped)
    pickled.write_bytes(pickle.dumps(model.trap))
    for path in (zipped, pickled):
        for refuse in (make_policy, load_model, BundlePolicy):
            with pytest.raises(ValueError, match=path.name):
                refuse(str(path) if refuse is make_policy else path)
        renamed = path.with_suffix(".onnx")
        renamed.write_bytes(path.read_bytes())
        with pytest.raises(ValueError, match="not a policy bundle"):
            BundlePolicy(renamed)
    assert not sprung.exists()
    load_model(zipped, allow_pickle=True)
    assert sprung.exists()  # it would have run


# What stands in the file, word for word: a robot of today must refuse the bundles of tomorrow, and the other way round.


def metadata(path):
    """Return what a bundle's metadata say, read by ONNX."""
    [entry] = onnx.load(path).metadata_props
    assert entry.key == "turtlebot_gym"
    return json.loads(entry.value)


def test_the_card_in_the_file_word_for_word(bundle):
    burger = {
        "name": "burger",
        "max_linear": 0.2108,
        "max_angular": 2.635,
        "wheel_separation": 0.16,
        "max_wheel": 0.2097,
        "max_linear_acceleration": None,
        "max_angular_acceleration": None,
        "reverse": True,
        "radius": 0.105,
    }
    assert metadata(bundle)["card"] == {
        "env": "turtlebot_gym/TurtleBotNav-v0",
        "robot": burger,
        "dt": 0.1,
        "noise": "tutorial",
        "filter": "matched",
        "observation": "ekf",
        "training": {"seed": 3, "sha256": "0" * 64},
        "format": "turtlebot-gym-policy/1",
        "layout": 1,
        "action": "forward speed and turning rate as shares of the robot's limits, in [-1, 1]",
    }
    assert describe_robot("burger") == burger
    assert describe_robot(ROBOTS["burger"]) == burger | {"name": "custom"}


def test_the_hash_is_that_of_the_file_with_zeros_in_its_place(bundle):
    told = metadata(bundle)["sha256"]
    content = bundle.read_bytes()
    assert content.count(told.encode()) == 1
    assert hashlib.sha256(content.replace(told.encode(), b"0" * 64)).hexdigest() == told
    assert BundlePolicy(bundle).sha256 == told


def test_a_bundle_tells_nothing_of_the_machine_that_it_was_made_on(tmp_path):
    model = linear_model()
    graph = model.graph
    graph.value_info.append(helper.make_tensor_value_info("product", TensorProto.FLOAT, ["n", 2]))
    for part in (model, graph, *graph.node, *graph.value_info, *graph.input, *graph.output):
        part.metadata_props.add(key="source", value="/home/somebody/export.py")
        part.doc_string = "/home/somebody/export.py"
    write_bundle(tmp_path / "policy.onnx", model, CARD)
    assert b"somebody" not in (tmp_path / "policy.onnx").read_bytes()
    BundlePolicy(tmp_path / "policy.onnx")


def test_a_missing_onnxruntime_is_named_with_the_remedy(bundle, monkeypatch):
    monkeypatch.setitem(sys.modules, "onnxruntime", None)  # importing it raises
    with pytest.raises(ImportError, match=r"needs onnxruntime: pip install 'turtlebot-gym\[deploy\]'"):
        BundlePolicy(bundle)


def test_the_refusal_names_every_difference_and_nothing_else(bundle):
    with pytest.raises(ValueError, match="made for") as caught:
        BundlePolicy(bundle, robot=replace(ROBOTS["burger"], max_linear=0.1, radius=1.0), dt=0.25)
    assert str(caught.value) == (f"{bundle}: made for 10 Hz burger, asked for 4 Hz custom (max_linear 0.2108 there, 0.1 here).")
    with pytest.raises(ValueError, match="made for") as caught:
        BundlePolicy(bundle, robot="waffle")
    details = re.search(r"\((.*)\)", str(caught.value))
    assert details is not None
    assert details[1].split("; ") == [
        "max_linear 0.2108 there, 0.26 here",
        "max_angular 2.635 there, 1.82 here",
        "wheel_separation 0.16 there, 0.287 here",
        "max_wheel 0.2097 there, 0.26 here",
    ]


def seal(path, blank):
    """Write a file with the hash that fits it, whatever else stands in it."""
    path.write_bytes(blank.replace(b"0" * 64, hashlib.sha256(blank).hexdigest().encode(), 1))


@pytest.mark.skipif(not os.path.isdir("/proc/self/task"), reason="counts threads as Linux does")
def test_a_policy_takes_no_threads_of_its_own(bundle):
    program = f"""
import os, onnxruntime, numpy as np
from turtlebot_gym_agents.policies.bundle import BundlePolicy
before = len(os.listdir("/proc/self/task"))
policy = BundlePolicy({str(bundle)!r})
policy(np.zeros((8, 13)))
print(len(os.listdir("/proc/self/task")) - before)
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert int(done.stdout) == 0


# Bundles with a correct hash that somebody, or a newer version, has made otherwise.


def rewritten(bundle, *, card=lambda card: card, change=lambda model: None):
    """Write a bundle with another card and another model, and its own hash."""
    model, content = onnx.load(bundle), {"sha256": "0" * 64, "card": card(metadata(bundle)["card"])}
    change(model)
    del model.metadata_props[:]
    model.metadata_props.add(key="turtlebot_gym", value=json.dumps(content))
    seal(bundle, model.SerializeToString())
    return bundle


@pytest.mark.parametrize("added", [{}, {"license": "MIT"}])
def test_a_rewritten_bundle_is_one_and_what_a_newer_version_adds_to_its_card_is_left_out(bundle, added):
    assert BundlePolicy(rewritten(bundle, card=lambda card: card | added)).card == CARD


def test_a_sealed_file_that_is_no_model_is_refused_without_a_word_on_standard_error(bundle, capfd):
    def unknown(model):
        model.graph.node[0].op_type = "NoSuchOperator"

    with pytest.raises(ValueError, match=r"policy\.onnx is not a policy bundle"):
        BundlePolicy(rewritten(bundle, change=unknown))
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("name", [field.name for field in fields(Card)])
def test_a_malformed_card_is_refused_in_one_line(bundle, name):
    original = bundle.read_bytes()
    for wrong in (None, 3, -1.0, 0, "x", "", [], [1], True, float("nan"), float("inf"), 1e300):
        bundle.write_bytes(original)
        kept = metadata(bundle)["card"][name]
        if wrong == kept or (isinstance(kept, str) and name in ("env", "noise", "filter") and isinstance(wrong, str)):
            continue  # any text names a task, a noise or a filter
        with pytest.raises(ValueError, match=re.escape(str(bundle))) as caught:
            BundlePolicy(rewritten(bundle, card=lambda card, wrong=wrong: card | {name: wrong}), robot="burger", dt=0.1)
        assert "\n" not in str(caught.value)
    bundle.write_bytes(original)
    if name != "training":
        with pytest.raises(ValueError, match=re.escape(str(bundle))):
            BundlePolicy(rewritten(bundle, card=lambda card: {key: card[key] for key in card if key != name}))


@pytest.mark.parametrize("card", [None, [], "x", 3, {}])
def test_an_invalid_card_is_refused(bundle, card):
    with pytest.raises(ValueError, match=re.escape(str(bundle))):
        BundlePolicy(rewritten(bundle, card=lambda _: card))


@pytest.mark.parametrize("robot", [{}, {"name": "burger"}, {"max_linear": "fast"}])
def test_a_robot_that_is_not_whole_is_another_one(bundle, robot):
    with pytest.raises(ValueError, match="made for 10 Hz"):
        BundlePolicy(rewritten(bundle, card=lambda card: card | {"robot": robot}), robot="burger", dt=0.1)


# What is wrong with a model: each of these changes one.


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


def endless(model):
    """Repeat, for a number of times that no computer reaches, before the policy acts."""
    ends = (("k", TensorProto.INT64), ("go", TensorProto.BOOL), ("x", TensorProto.FLOAT))
    goes, y = (helper.make_tensor_value_info(name, kind, None) for name, kind in (("goes", ends[1][1]), ("y", ends[2][1])))
    body = helper.make_graph(
        [helper.make_node("Identity", ["go"], ["goes"]), helper.make_node("Identity", ["x"], ["y"])],
        "body",
        [helper.make_tensor_value_info(name, kind, None) for name, kind in ends],
        [goes, y],
    )
    model.graph.initializer.append(numpy_helper.from_array(np.array(2**62), "times"))
    model.graph.node.insert(0, helper.make_node("Loop", ["times", "", "observation"], ["seen"], body=body))
    model.graph.node[1].input[0] = "seen"


def huge(model):
    """Make 4 TB of an observation."""
    model.graph.initializer.append(numpy_helper.from_array(np.array([10**12, 1, 1]), "shape"))
    model.graph.node.append(helper.make_node("Expand", ["observation", "shape"], ["unused"]))


def from_elsewhere(model):
    model.graph.node[0].domain = "com.microsoft"


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


ELSEWHERE, SHAPE = (
    "its weights are in another file",
    "its model must be from float observations (n, 13) to float actions (n, 2)",
)
WRONG_MODELS = [
    (outside, ELSEWHERE),
    (outside_in_a_subgraph, ELSEWHERE),
    (endless, "is not a policy bundle: a network has no operator 'Loop'"),  # before it is loaded
    (huge, "is not a policy bundle: a network has no operator 'Expand'"),
    (from_elsewhere, "a network has no operator 'com.microsoft.MatMul'"),
    (with_a_function, "its model has functions of its own"),
    *((not_finite(bad, packed), "its weights are not all finite numbers")
      for bad in (np.nan, np.inf, -np.inf) for packed in (True, False)),
    *((change, SHAPE) for change in (widths(12, 2), widths(50, 2), widths(13, 3), fixed_batch, doubles, two_outputs)),
    (answers_nan, "must give 1 finite actions"),
]  # fmt: skip


@pytest.mark.parametrize(("change", "message"), WRONG_MODELS)
def test_a_model_that_a_robot_should_not_run_is_refused(bundle, change, message):
    (bundle.parent / "secret.bin").write_bytes(WEIGHTS.tobytes())
    with pytest.raises(ValueError, match=re.escape(message)):
        BundlePolicy(rewritten(bundle, change=change))


def test_random_bytes_with_a_hash_are_refused(tmp_path):
    path = tmp_path / "policy.onnx"
    for seed in range(200):
        noise = np.random.default_rng(seed).bytes(seed)
        blank = noise + b'{"sha256": "' + b"0" * 64 + b'"}'
        seal(path, blank)
        with pytest.raises(ValueError, match="not a policy bundle"):
            BundlePolicy(path)
