"""Where a network learns, and what a file of hyper-parameters leaves to the options."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest
import torch
from stable_baselines3 import A2C, PPO, SAC, TD3

from turtlebot_gym_agents.policies.bundle import BundlePolicy
from turtlebot_gym_agents.training import hyperparameters
from turtlebot_gym_agents.training.config import TrainingConfig
from turtlebot_gym_agents.training.devices import choose_device
from turtlebot_gym_agents.training.train import train

SMALL = {"n_envs": 64, "n_timesteps": 1024, "policy": "MlpPolicy", "n_steps": 16, "batch_size": 1024, "n_epochs": 1}


@pytest.fixture
def without_gpu(monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)


def test_cpu_and_auto_are_the_cpu_without_a_gpu(without_gpu):
    assert {choose_device(device, kind) for device in ("cpu", "auto") for kind in (PPO, SAC)} == {"cpu"}


def test_auto_takes_a_gpu_for_off_policy_algorithms_only(monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    assert [choose_device("auto", kind) for kind in (PPO, A2C, SAC, TD3)] == ["cpu", "cpu", "cuda", "cuda"]
    assert choose_device("cuda", PPO) == "cuda"
    assert choose_device("cpu", SAC) == "cpu"


def test_a_gpu_that_is_not_there_is_refused_in_one_line(without_gpu, tmp_path):
    with pytest.raises(ValueError, match=r"^device 'cuda' is not available: torch .* finds no GPU; use --device cpu\.$"):
        train(TrainingConfig(device="cuda"), tmp_path / "run", progress=False)
    assert not (tmp_path / "run").exists()


def test_unknown_devices_are_refused():
    with pytest.raises(ValueError, match="device must be one of 'cpu', 'cuda', 'auto', got 'tpu'"):
        TrainingConfig(device="tpu")


@pytest.mark.parametrize(
    "device", ["cpu", "auto", pytest.param("cuda", marks=pytest.mark.skipif(not torch.cuda.is_available(), reason="no GPU"))]
)
def test_a_run_records_its_device(device, tmp_path):
    hyperparameters.save(tmp_path / "small.yaml", "default", SMALL)
    train(
        TrainingConfig(config=tmp_path / "small.yaml", device=device, episodes=4, evaluations=1),
        tmp_path / "run",
        progress=False,
    )
    record = json.loads((tmp_path / "run" / "config.json").read_text())
    card = BundlePolicy(tmp_path / "run" / "policy.onnx").card
    assert record["config"]["device"] == card.training["config"]["device"] == device
    assert record["device"] == card.training["device"] == ("cuda" if device == "cuda" else "cpu")


@pytest.mark.parametrize(
    ("key", "value", "option"), [("device", "cuda", "--device"), ("seed", 3, "--seed"), ("env", "x", "--env")]
)
def test_options_in_a_file_of_hyperparameters_are_refused(key, value, option, tmp_path):
    hyperparameters.save(tmp_path / "mine.yaml", "default", {**SMALL, key: value})
    with pytest.raises(ValueError, match=rf"mine\.yaml, .*: {key} is no hyper-parameter; use the option {option}\."):
        train(TrainingConfig(config=tmp_path / "mine.yaml"), tmp_path / "run", progress=False)


def test_the_command_says_so_in_one_line(tmp_path):
    hyperparameters.save(tmp_path / "mine.yaml", "default", {**SMALL, "device": "cpu"})
    command = [sys.executable, "-m", "turtlebot_gym_agents", "train", "--config", str(tmp_path / "mine.yaml")]
    done = subprocess.run([*command, "--out", str(tmp_path / "run")], capture_output=True, text=True, timeout=300)
    assert (done.returncode, done.stdout) == (2, "")
    (line,) = done.stderr.splitlines()
    assert line.startswith("turtlebot-gym: ")
    assert line.endswith("device is no hyper-parameter; use the option --device.")
