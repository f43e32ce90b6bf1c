"""Bundles with memory: it is carried from step to step, begins with zeros, and is no way around the checks of a bundle."""

import numpy as np
import pytest
from bundles import CARD, WEIGHTS
from onnx import TensorProto, helper, numpy_helper

from turtlebot_gym import State
from turtlebot_gym.values import Covariance, Pose
from turtlebot_gym_agents import Deployment, make_policy
from turtlebot_gym_agents.evaluation.evaluate import evaluate
from turtlebot_gym_agents.policies.bundle import BundlePolicy, write_bundle
from turtlebot_gym_agents.policies.policy import PolicyWithMemory, shown

KEPT = np.float32(0.75)
"""Share of the memory that a step keeps."""


class Leaky:
    """The policy of the bundle in NumPy: the action is the hyperbolic tangent of a leaky sum."""

    def reset(self, mask):
        self.sum = np.where(mask[..., None], np.float32(0.0), getattr(self, "sum", np.zeros((*mask.shape, 2), np.float32)))

    def __call__(self, observations):
        self.sum = KEPT * self.sum + observations @ WEIGHTS
        return np.tanh(self.sum)


def recurrent_model(kept=KEPT):
    nodes = [
        helper.make_node("MatMul", ["observation", "W"], ["seen"]),
        helper.make_node("Mul", ["memory", "kept"], ["rest"]),
        helper.make_node("Add", ["rest", "seen"], ["next_memory"]),
        helper.make_node("Tanh", ["next_memory"], ["action"]),
    ]
    ends = {"observation": 13, "memory": 2, "action": 2, "next_memory": 2}
    values = [helper.make_tensor_value_info(name, TensorProto.FLOAT, ["n", size]) for name, size in ends.items()]
    constants = [numpy_helper.from_array(WEIGHTS, "W"), numpy_helper.from_array(np.float32(kept), "kept")]
    graph = helper.make_graph(nodes, "leaky", values[:2], values[2:], constants)
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=10)


@pytest.fixture
def bundle(tmp_path):
    write_bundle(tmp_path / "leaky.onnx", recurrent_model(), CARD)
    return tmp_path / "leaky.onnx"


@pytest.mark.parametrize("shape", [(), (1,), (5,), (2, 3)])
def test_memory_is_carried_and_cleared_where_an_episode_begins(bundle, shape):
    policy, expected, random = BundlePolicy(bundle), Leaky(), np.random.default_rng(0)
    assert isinstance(policy, PolicyWithMemory)
    begins = np.ones(shape, np.bool_)
    for _ in range(30):
        policy.reset(begins)
        expected.reset(begins)
        observations = random.normal(size=(*shape, 13)).astype(np.float32)
        np.testing.assert_allclose(policy(observations), expected(observations), rtol=0, atol=1e-6)
        begins = random.random(shape) < 0.2


def test_evaluations_and_wrappers_clear_it(bundle):
    common = {"env": CARD.env, "episodes": 40}
    there, here = evaluate(str(bundle), **common), evaluate(Leaky(), **common)
    np.testing.assert_allclose(there.episodes.path, here.episodes.path, rtol=0, atol=1e-3)
    terms = BundlePolicy(bundle).terms[::-1]  # then a wrapper selects
    assert isinstance(shown(BundlePolicy(bundle), "leaky", terms), PolicyWithMemory)
    assert not isinstance(shown(make_policy("ppo-nav"), "ppo-nav", terms), PolicyWithMemory)


def test_a_deployment_clears_it_by_reset_and_after_a_pause(bundle):
    deployment, goal = Deployment(bundle), Pose(1.0, 0.5, 0.0)
    exact = Covariance(*[0.0] * len(Covariance._fields))

    def act(now):
        deployment.command(State(0.1, 0.2, 0.3, 0.1, 0.0), exact, 0.0, goal, goal, now=now)
        return deployment.action.tolist()

    first = act(0.0)
    assert act(0.1) != first
    deployment.reset()
    assert act(0.2) == first
    assert act(0.3) != first
    assert act(0.8) == first  # what was seen before half a second's pause is no step ago
    deployment.reset()
    actions = []
    for _ in range(2):
        deployment.act((0.1, 0.2, 0.3), (0.0, 0.0, 0.0), (0.1, 0.0), None, goal)
        actions.append(deployment.action.tolist())
    assert actions[0] == first
    assert actions[1] != first


def test_a_memory_that_grows_without_end_ends_in_an_error_and_not_in_a_motion(tmp_path):
    write_bundle(tmp_path / "policy.onnx", recurrent_model(kept=1e10), CARD)
    policy = BundlePolicy(tmp_path / "policy.onnx")
    with pytest.raises(ValueError, match="must give finite actions"):
        [policy(np.ones(13)) for _ in range(9)]
