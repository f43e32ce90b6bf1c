"""Other libraries' policies: their bundles act as they do, with all that they were trained with, or are refused."""

import gymnasium as gym
import numpy as np
import pytest
import torch

pytest.importorskip("sb3_contrib", reason="needs the extra [dev]")

from foreign import KINDS, NAV, ROOMS, SMALL, Agent, deployed, exported, library_actions, mlp, torch_actions, trained
from torch import nn

from turtlebot_gym_agents.policies.bundle import BundlePolicy
from turtlebot_gym_agents.training.config import TrainingConfig
from turtlebot_gym_agents.training.export import export
from turtlebot_gym_agents.training.network import TOLERANCE
from turtlebot_gym_agents.training.train import train


def bundle_actions(bundle, observations, begins):
    policy, actions = BundlePolicy(bundle), []
    for observation, begin in zip(observations, begins, strict=True):
        if begin and policy.memory:
            policy.reset(np.ones((), np.bool_))
        actions.append(policy(observation))
    return np.array(actions)


def close(actions, expected):
    np.testing.assert_allclose(actions, expected, rtol=0, atol=TOLERANCE)
    assert np.std(expected, axis=0).min() > 1e-3  # a constant would be easy to equal


@pytest.mark.parametrize("kind", KINDS)
def test_a_model_acts_in_its_bundle_and_deployment_as_in_its_library(tmp_path, kind):
    model = trained(kind)
    export(model, tmp_path / "policy.onnx", env=NAV, steps=100)
    observations, begins, actions = deployed(tmp_path / "policy.onnx")
    expected = library_actions(model, observations, begins)
    close(actions, expected)
    close(bundle_actions(tmp_path / "policy.onnx", observations, begins), expected)


# Folders and command lines.


def test_the_best_model_of_a_training_in_rooms_is_exported_by_its_folder(tmp_path, capsys):
    hyper = {"n_envs": 8, "n_timesteps": 256, "n_steps": 16, "batch_size": 64, "policy_kwargs": SMALL}
    config = TrainingConfig(env=ROOMS, world="office", config=hyper, evaluations=1, episodes=4, steps=256, randomize=True)
    train(config, tmp_path / "run", progress=False)
    status, said = exported(capsys, tmp_path / "run", "--out", tmp_path / "rooms.onnx", "--allow-pickle")
    assert (status, "differ from the library's by at most" in said) == (0, True), said
    (again, theirs) = (BundlePolicy(path) for path in (tmp_path / "rooms.onnx", tmp_path / "run" / "policy.onnx"))
    assert (again.terms, again.card.env, again.card.noise) == (theirs.terms, ROOMS, "randomized")
    rows = np.random.default_rng(0).uniform(0.0, 1.0, (50, 50))
    np.testing.assert_array_equal(again(rows), theirs(rows))


# Networks without a library's model around them.


def as_onnx(network, path):
    axes = {"input_names": ["obs"], "output_names": ["action"], "dynamic_axes": {"obs": {0: "n"}}}
    torch.onnx.export(network, (torch.zeros(1, 13),), path, dynamo=False, **axes)


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_an_onnx_model_that_fits_gets_a_card(tmp_path, capsys):
    network = mlp()
    as_onnx(network, tmp_path / "rows.onnx")
    words = ["--env", NAV, "--robot", "waffle", "--noise", "rough", "--dt", "0.05", "--observation", "odometry"]
    status, said = exported(capsys, tmp_path / "rows.onnx", "--out", tmp_path / "out.onnx", *words)
    assert status == 0, said
    card = BundlePolicy(tmp_path / "out.onnx", robot="waffle", dt=0.05).card
    assert (card.env, card.noise, card.observation) == (NAV, "rough", "odometry")
    observations, _, actions = deployed(tmp_path / "out.onnx")
    close(actions, torch_actions(network, observations))


def test_an_agent_of_cleanrl_with_its_normalization_of_gymnasium(tmp_path):
    agent, envs = Agent(), gym.wrappers.NormalizeObservation(gym.make(NAV))
    envs.reset(seed=0)
    for _ in range(300):
        envs.step(envs.action_space.sample())
    export(
        nn.Sequential(nn.Hardtanh(-10.0, 10.0), agent.actor_mean),
        tmp_path / "policy.onnx",
        env=NAV,
        vec_normalize=envs,
        steps=100,
    )
    observations, _, actions = deployed(tmp_path / "policy.onnx")
    envs.update_running_mean = False
    seen = np.clip([envs.observation(row) for row in observations], -10.0, 10.0)
    close(actions, torch_actions(agent.actor_mean, seen.astype(np.float32)))


class Recurrent(nn.Module):
    def __init__(self):
        super().__init__()
        torch.manual_seed(0)
        self.cell, self.head = nn.GRUCell(13, 8), nn.Linear(8, 2)

    def forward(self, observation, memory):
        memory = self.cell(observation, memory)
        return self.head(memory), memory


def test_a_network_with_a_state(tmp_path):
    network = Recurrent().eval()
    export(network, tmp_path / "policy.onnx", env=NAV, memory=8, steps=100)
    observations, begins, actions = deployed(tmp_path / "policy.onnx")
    memory, expected = torch.zeros(1, 8), []
    for observation, begin in zip(observations, begins, strict=True):
        with torch.no_grad():
            action, memory = network(torch.from_numpy(observation)[None], memory * (not begin))
        expected.append(np.clip(action[0].numpy(), -1.0, 1.0))
    close(actions, np.array(expected))
