"""Export: the bundle does what the model does, or it is not written."""

import pytest
import torch

from turtlebot_gym_agents.training import network as module
from turtlebot_gym_agents.training.config import TrainingConfig
from turtlebot_gym_agents.training.export import export
from turtlebot_gym_agents.training.model import make_model


def test_a_bundle_that_acts_differently_is_not_written(tmp_path, monkeypatch):
    config = TrainingConfig(config={"n_envs": 8, "n_timesteps": 256, "n_steps": 32, "batch_size": 256})
    right, model = module.program_of, make_model(config, config.make_training())
    half = torch.nn.Linear(2, 2, bias=False)
    half.weight.data = 0.5 * torch.eye(2)
    monkeypatch.setattr(module, "program_of", lambda network, *sizes: right(torch.nn.Sequential(network, half), *sizes))
    (tmp_path / "policy.onnx").write_text("the old one")
    with pytest.raises(RuntimeError, match="differ from the network's"):
        export(model, tmp_path / "policy.onnx", steps=20)
    assert [file.read_text() for file in tmp_path.iterdir()] == ["the old one"]
