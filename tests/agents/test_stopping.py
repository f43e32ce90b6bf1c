"""Trainings that stop early, when an evaluation reaches a target."""

from dataclasses import replace

from turtlebot_gym_agents.evaluation.driving import Judged
from turtlebot_gym_agents.training import callbacks
from turtlebot_gym_agents.training.config import TrainingConfig
from turtlebot_gym_agents.training.train import train

SMALL = {"n_envs": 64, "n_timesteps": 8192, "policy": "MlpPolicy", "policy_kwargs": {"net_arch": [8]}}
SMALL |= {"n_steps": 16, "batch_size": 1024, "n_epochs": 1, "learning_rate": "lin_0.001"}
small = TrainingConfig(config=SMALL, episodes=8, evaluations=4)


def test_it_stops_at_the_first_evaluation_that_reaches_the_target(tmp_path):
    folder = tmp_path / "run"
    config = replace(small, until="return=-1e6")
    first = train(config, folder, progress=False)
    assert (first.stopped, len(first.history)) == ("until", 1)
    assert first.history[0]["steps"] == 2048 <= first.steps < 8192
    assert (folder / "policy.onnx").is_file()


def test_it_stops_only_if_all_episodes_agree(tmp_path, monkeypatch):
    """The first 2 of 8 episodes reach every target, all of them none before the end."""
    config = replace(small, until="success=1.0", steps=4096, evaluations=2)
    monkeypatch.setattr(callbacks, "INTERIM", 2)
    counts = []

    def figures(judged):
        counts.append(len(judged.success))
        return {"success": float(len(judged.success) == 2), "return": 1.0, "steps_to_end": 1.0}

    monkeypatch.setattr(Judged, "figures", figures)
    result = train(config, tmp_path / "run", progress=False)
    assert (result.stopped, counts[:2]) == (None, [2, 8])
    assert result.steps == 4096
