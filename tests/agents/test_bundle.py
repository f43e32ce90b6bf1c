"""The policy bundle: its card, what it refuses, and that it needs neither torch nor Stable-Baselines3."""

import os
import pickle
import re
from dataclasses import fields, replace
from functools import partial

import numpy as np
import onnx
import pytest
from bundles import CARD, WEIGHTS, linear_model, metadata, rewritten, seal, small_bundle
from onnx import TensorProto, helper, numpy_helper
from stable_baselines3 import PPO

from turtlebot_gym import ROBOTS, make_filter, make_noise, make_parameters
from turtlebot_gym.observations import OPEN_GROUND
from turtlebot_gym.tasks import NAV
from turtlebot_gym_agents.policies import make_policy
from turtlebot_gym_agents.policies.bundle import BundlePolicy, Card, described, write_bundle
from turtlebot_gym_agents.policies.fit import describe_robot
from turtlebot_gym_agents.training.export import load_model


@pytest.fixture
def bundle(tmp_path):
    return small_bundle(tmp_path)


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


def test_a_card_names_presets_and_calls_everything_else_custom():
    options = {"filter": make_filter("matched", make_noise("rough")), "observation": "odometry", "robot": "waffle"}
    card = Card.of(CARD.env, options, make_parameters(NAV, robot="waffle"), {"steps": 5})
    assert (card.noise, card.filter, card.observation) == ("tutorial", "custom", "odometry")  # by default, and as given
    assert (card.robot["name"], card.terms, card.dt, card.training) == ("waffle", described(OPEN_GROUND), 0.1, {"steps": 5})


WAFFLE = "(max_linear 0.2108 there, 0.26 here; max_angular 2.635 there, 1.82 here; wheel_separation 0.16 there, 0.287 here; "
WAFFLE += "max_wheel 0.2097 there, 0.26 here)"


@pytest.mark.parametrize(
    ("made_for", "options", "difference"),
    [
        ("burger", {"dt": 0.05}, "10 Hz burger, asked for 20 Hz burger"),
        ("burger", {"dt": 0.1 + 2e-9}, "10 Hz burger, asked for 10 Hz burger"),
        ("burger", {"robot": "waffle", "dt": 0.25}, f"10 Hz burger, asked for 4 Hz waffle {WAFFLE}"),
        ("burger", {"reverse": False, "radius": 1.0}, "10 Hz burger, asked for 10 Hz custom (reverse True there, False here)"),
        ("tutorial", {"max_wheel": 1.0}, "10 Hz tutorial, asked for 10 Hz custom (max_wheel None there, 1.0 here)"),
        ("tutorial", {"robot": "tutorial"}, None),  # its limits are infinite, which JSON does not have
        ("burger", {"radius": 0.2}, None),  # for drawing
        ("burger", {"dt": 0.1 + 9e-10}, None),
    ],
)
def test_the_refusal_of_another_robot_or_period_names_every_difference(tmp_path, made_for, options, difference):
    path = tmp_path / "policy.onnx"
    write_bundle(path, linear_model(), replace(CARD, robot=describe_robot(made_for)))
    limits = {name: value for name, value in options.items() if name not in ("robot", "dt")}
    arguments = {name: value for name, value in options.items() if name in ("robot", "dt")}
    arguments |= {"robot": replace(ROBOTS[made_for], **limits)} if limits else {}
    if difference is None:
        BundlePolicy(path, **arguments)
    else:
        with pytest.raises(ValueError, match="^" + re.escape(f"{path}: made for {difference}.") + "$"):
            BundlePolicy(path, **arguments)


def test_refuses_every_damaged_byte(bundle):
    content = bundle.read_bytes()
    for at in range(0, len(content), 7):
        damaged = bytearray(content)
        damaged[at] ^= 0x10
        bundle.write_bytes(damaged)
        with pytest.raises(ValueError, match=r"damaged|not a policy bundle"):
            BundlePolicy(bundle)


@pytest.mark.skipif(not os.path.isdir("/proc/self/task"), reason="counts threads as Linux does")
def test_a_policy_needs_neither_torch_nor_threads(bundle, run):
    program = f"""
import json, os, sys
for name in ("torch", "stable_baselines3", "onnx", "gymnasium", "llvmlite"):
    sys.modules[name] = None  # importing it raises
import numpy as np, onnxruntime
from turtlebot_gym_agents.policies.bundle import BundlePolicy
before = len(os.listdir("/proc/self/task"))
policy = BundlePolicy({str(bundle)!r}, robot="burger", dt=0.1)  # with which its threads would end
actions = policy(np.zeros((2, 13)))
print(json.dumps([len(os.listdir("/proc/self/task")) - before, actions.tolist()]))
"""
    assert run(program) == [0, [[0.0, 0.0], [0.0, 0.0]]]


class _Trap:
    """Creates a file when it is unpickled."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return (open, (str(self.path), "w"))


@pytest.mark.filterwarnings("ignore::ResourceWarning")
def test_code_in_a_pickled_file_is_run_only_where_it_is_allowed(tmp_path):
    sprung, zipped, pickled = (tmp_path / name for name in ("sprung", "evil.zip", "evil.pkl"))
    model = PPO("MlpPolicy", "CartPole-v1", device="cpu")
    model.trap = _Trap(sprung)
    model.save(zipped)
    pickled.write_bytes(pickle.dumps(model.trap))
    for path in (zipped, pickled):
        for refuse in (make_policy, partial(load_model, algo="ppo"), BundlePolicy):
            with pytest.raises(ValueError, match=path.name):
                refuse(str(path) if refuse is make_policy else path)
        renamed = path.with_suffix(".onnx")
        renamed.write_bytes(path.read_bytes())
        with pytest.raises(ValueError, match="not a policy bundle"):
            BundlePolicy(renamed)
    assert not sprung.exists()
    load_model(zipped, "ppo", allow_pickle=True)
    assert sprung.exists()  # it would have run


def test_a_bundle_does_not_reveal_the_machine_it_was_made_on(tmp_path):
    model = linear_model()
    graph = model.graph
    graph.value_info.append(helper.make_tensor_value_info("product", TensorProto.FLOAT, ["n", 2]))
    for part in (model, graph, *graph.node, *graph.value_info, *graph.input, *graph.output):
        part.metadata_props.add(key="source", value="/home/somebody/export.py")
        part.doc_string = "/home/somebody/export.py"
    write_bundle(tmp_path / "policy.onnx", model, CARD)
    assert b"somebody" not in (tmp_path / "policy.onnx").read_bytes()
    BundlePolicy(tmp_path / "policy.onnx")


@pytest.mark.parametrize("name", [field.name for field in fields(Card)])
def test_a_malformed_card_is_refused_in_one_line(bundle, name):
    original = bundle.read_bytes()
    for wrong in (None, -1.0, "x", [1], True, float("nan")):
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


def test_models_without_a_card_and_random_bytes_with_a_hash_are_not_bundles(tmp_path):
    path = tmp_path / "policy.onnx"
    onnx.save(linear_model(), path)
    with pytest.raises(ValueError, match="not a policy bundle"):
        BundlePolicy(path)
    for seed in range(0, 200, 20):
        seal(path, np.random.default_rng(seed).bytes(seed) + b'{"sha256": "' + b"0" * 64 + b'"}')
        with pytest.raises(ValueError, match="not a policy bundle"):
            BundlePolicy(path)


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
