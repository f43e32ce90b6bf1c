"""Export: the bundle does what the model does, or it is not written."""

import numpy as np
import pytest
import torch

from turtlebot_gym.observations import OPEN_GROUND
from turtlebot_gym.observations.columns import bounds_of
from turtlebot_gym_agents.policies.bundle import BundlePolicy
from turtlebot_gym_agents.training import network as module
from turtlebot_gym_agents.training.config import TrainingConfig
from turtlebot_gym_agents.training.export import export
from turtlebot_gym_agents.training.model import make_model
from turtlebot_gym_agents.training.network import TOLERANCE

SHORT = {
    "ppo": {"n_steps": 32, "batch_size": 256, "n_epochs": 2, "learning_rate": 0.003},
    "sac": {"learning_starts": 300, "buffer_size": 2000, "batch_size": 64},
    "td3": {"learning_starts": 300, "buffer_size": 2000, "batch_size": 64, "noise_type": "normal", "noise_std": 0.1},
}
LAYERS = {"net_arch": [64, 64], "activation_fn": "Tanh"}
NETWORK = {"policy": "MlpPolicy", "n_envs": 8, "n_timesteps": 1024, "policy_kwargs": LAYERS}


@pytest.fixture(params=SHORT)
def model(request):
    """Return a model after a short training, with its class."""
    config = TrainingConfig(algo=request.param, config=NETWORK | SHORT[request.param])
    model = make_model(config, config.make_training())
    return model.learn(1024)


def test_bundle_equals_model_on_10000_observations(model, tmp_path):
    path = tmp_path / "new" / "policy.onnx"
    assert export(model, path, steps=100).difference <= TOLERANCE
    # Another sample than the exporter's own, half of it where the robot really is.
    random = np.random.default_rng(5)
    anywhere = random.uniform(*bounds_of(OPEN_GROUND), (5000, 13))
    seen = model.policy_kwargs["features_extractor_kwargs"]
    near = np.array(seen["mean"]) + random.normal(size=(5000, 13)) * np.array(seen["std"])
    observations = np.concatenate([anywhere, near]).astype(np.float32)
    expected, _ = model.predict(observations, deterministic=True)
    actions = BundlePolicy(path)(observations)
    np.testing.assert_allclose(actions, expected, rtol=0, atol=TOLERANCE)
    assert actions.std() > 0.01  # a constant would be easy to equal
    assert path.stat().st_size < 200_000
    assert [file.name for file in path.parent.iterdir()] == ["policy.onnx"]


def test_a_bundle_that_acts_differently_is_not_written(tmp_path, monkeypatch):
    config = TrainingConfig(config=NETWORK | SHORT["ppo"])
    right, model = module.program_of, make_model(config, config.make_training())
    half = torch.nn.Linear(2, 2, bias=False)
    half.weight.data = 0.5 * torch.eye(2)
    monkeypatch.setattr(module, "program_of", lambda network, *sizes: right(torch.nn.Sequential(network, half), *sizes))
    (tmp_path / "policy.onnx").write_text("the old one")
    with pytest.raises(RuntimeError, match="differ from the network's"):
        export(model, tmp_path / "policy.onnx", steps=20)
    assert [file.read_text() for file in tmp_path.iterdir()] == ["the old one"]
