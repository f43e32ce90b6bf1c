"""Other libraries' policies whose bundle would lack something, or be none, are refused in one line with the cause."""

from copy import deepcopy
from pathlib import Path
from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest
import torch

pytest.importorskip("sb3_contrib", reason="needs the extra [dev]")

from foreign import NAV, ON, Agent, envs_of, mlp, normalized
from gymnasium.vector import AutoresetMode
from stable_baselines3 import DQN, PPO
from stable_baselines3.common.running_mean_std import RunningMeanStd
from stable_baselines3.common.vec_env import DummyVecEnv, VecFrameStack
from torch import nn

from turtlebot_gym_agents.policies.bundle import BundlePolicy
from turtlebot_gym_agents.training.export import export
from turtlebot_gym_agents.training.sb3_vec_env import Sb3VecEnv

pytestmark = pytest.mark.slow


class Discrete(gym.ActionWrapper):
    def __init__(self, env):
        super().__init__(env)
        self.action_space = gym.spaces.Discrete(3)

    def action(self, action):
        return np.array([0.5, action - 1.0], np.float32)


def small(env):
    return PPO("MlpPolicy", env, device="cpu", seed=0, **deepcopy(ON)).learn(64)


def loaded(model, folder):
    """Return a model as it is after saving and loading: without its environment."""
    model.save(folder / "model.zip")
    return PPO.load(folder / "model.zip", device="cpu")


def bundle_itself(folder):
    export(mlp(), folder / "bundle.onnx", env=NAV, steps=1)
    return folder / "bundle.onnx"


def of_one_row(folder):
    path = folder / "one.onnx"
    torch.onnx.export(mlp(), (torch.zeros(1, 13),), path, dynamo=False)
    return path


def wrapped(wrapper):
    return small(DummyVecEnv([lambda: wrapper(gym.make(NAV))] * 2))


def halved(env):
    return gym.wrappers.RescaleAction(env, np.float32(-0.5), np.float32(0.5))


def scaled(env):
    return gym.wrappers.TransformObservation(env, lambda row: np.float32(100.0) * row, env.observation_space)


class Module(nn.Module):
    def __init__(self, function):
        super().__init__()
        self.function = function

    def forward(self, observation):
        return self.function(observation)


REFUSED = {
    "dqn": (lambda folder: DQN("MlpPolicy", Discrete(gym.make(NAV))), {}, "model of DQN must have actions"),
    "actions": (lambda folder: wrapped(halved), {}, r"must have actions \(2,\) in \[-1, 1\]"),
    "no environment": (lambda folder: loaded(small(normalized(envs_of())), folder), {}, "has no environment, which would say"),
    "other statistics": (
        lambda folder: small(normalized(envs_of())),
        {"vec_normalize": SimpleNamespace(obs_rms=RunningMeanStd(shape=(50,)), epsilon=1e-8)},
        "must hold statistics of 13 observations, .* got 50",
    ),
    "no statistics": (
        lambda folder: small(envs_of()),
        {"vec_normalize": {"mean": 0.0}},
        "must hold statistics of one-dimensional observations.*got dict",
    ),
    "stack": (lambda folder: small(VecFrameStack(envs_of(), 3)), {}, "within VecFrameStack, which a bundle does not have"),
    "observation wrapper": (lambda folder: wrapped(scaled), {}, "within TransformObservation, which a bundle does not have"),
    "gymnasium's normalization": (
        lambda folder: loaded(wrapped(gym.wrappers.NormalizeObservation), folder),
        {"vec_normalize": "none"},
        "within their bounds",
    ),
    "bundle": (bundle_itself, {}, "is a policy bundle already"),
    "one row": (of_one_row, {}, "must be from float observations"),
    "agent": (lambda folder: Agent(), {}, r"export\(agent\.actor_mean"),
    "chance": (lambda folder: Module(lambda o: o[:, :2] + torch.rand_like(o[:, :2])), {}, "depend on the others of a batch"),
    "fails": (lambda folder: Module(lambda o: o @ torch.zeros(7, 2)), {}, "but fails: RuntimeError"),
    "nothing": (lambda folder: folder, {}, "must be the folder of a training"),
}


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.parametrize("case", REFUSED)
def test_what_a_bundle_would_lack_is_refused_with_the_cause(tmp_path, case):
    make, options, message = REFUSED[case]
    model = make(tmp_path)
    with pytest.raises(ValueError, match=message) as caught:
        export(model, tmp_path / "policy.onnx", allow_pickle=True, steps=10, **options)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "policy.onnx").exists()


def test_what_is_no_model_is_refused(tmp_path):
    with pytest.raises(ValueError, match="model must be a model of Stable-Baselines3, a torch module or an ONNX model"):
        export(lambda o: o, tmp_path / "policy.onnx", env=NAV)


def test_a_model_of_the_native_environment_knows_where_it_was_trained(tmp_path):
    pose = "turtlebot_gym/TurtleBotPose-v0"
    envs = gym.make_vec(pose, num_envs=4, autoreset_mode=AutoresetMode.SAME_STEP, robot="waffle", noise="rough")
    export(small(normalized(Sb3VecEnv(envs))), tmp_path / "policy.onnx", steps=100)
    card = BundlePolicy(tmp_path / "policy.onnx").card
    assert (card.env, card.robot["name"], card.noise) == (pose, "waffle", "rough")
    assert card.training["normalized"]
    assert Path(tmp_path / "policy.onnx").is_file()
