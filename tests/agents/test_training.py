"""Training: a short one learns, leaves all its files, exports what the model does, and keeps the best of its models."""

import json
from dataclasses import replace
from functools import partial

import gymnasium as gym
import numpy as np
import pytest
import torch
from gymnasium.vector import AutoresetMode
from stable_baselines3 import PPO
from stable_baselines3.common.logger import configure
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from turtlebot_gym_agents.evaluation.driving import Judged, judge
from turtlebot_gym_agents.policies import make_policy
from turtlebot_gym_agents.policies.bundle import BundlePolicy
from turtlebot_gym_agents.training import callbacks, network
from turtlebot_gym_agents.training.callbacks import EVALUATION_SEED, INTERIM, EvaluationCallback
from turtlebot_gym_agents.training.config import TrainingConfig
from turtlebot_gym_agents.training.export import export
from turtlebot_gym_agents.training.model import make_model
from turtlebot_gym_agents.training.sb3_vec_env import Sb3VecEnv
from turtlebot_gym_agents.training.train import train

SHORT = {
    "n_envs": 128,
    "n_timesteps": 50_000,
    "policy": "MlpPolicy",
    "n_steps": 32,
    "batch_size": 1024,
    "n_epochs": 8,
    "learning_rate": 0.002,
    "gamma": 0.98,
    "policy_kwargs": {"net_arch": [64, 64], "activation_fn": "ReLU", "log_std_init": -0.5},
}
"""Learns in a few seconds: 100 % with the two seeds that were tried."""
SMALL = {"n_envs": 64, "n_timesteps": 2048, "policy": "MlpPolicy", "policy_kwargs": {"net_arch": [8]}}
SMALL |= {"n_steps": 16, "batch_size": 1024, "n_epochs": 1}
small = TrainingConfig(config=SMALL, episodes=8, evaluations=2)


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    """Return a short training's configuration, result and folder."""
    place = tmp_path_factory.mktemp("runs")
    config = TrainingConfig(config=SHORT, evaluations=3, episodes=400, seed=1)
    return config, train(config, place / "nav", progress=False), place / "nav"


def test_learns_and_the_best_is_what_its_figures_and_its_log_say(short):
    config, result, folder = short
    # 400 episodes each. If both succeeded equally often, 0.2 apart would be over 5 standard deviations: 1 in 10^6.
    judges, policy = config.make(400), BundlePolicy(folder / "policy.onnx")
    others = {"seed": EVALUATION_SEED + 400, "episodes": 400}
    model = make_model(config, config.make_training())
    before = judge(judges, lambda observations: model.predict(observations, deterministic=True)[0], **others)
    after = judge(judges, policy, **others)
    assert after.success.mean() > before.success.mean() + 0.2
    assert after.returns.mean() > before.returns.mean()
    assert result.steps >= 50_000
    best = judge(judges, policy, seed=EVALUATION_SEED, episodes=400).figures()
    assert best["success"] == result.best["success"]
    assert best["return"] == pytest.approx(result.best["return"], rel=1e-3)  # rounding may end an episode a step later
    (run,) = (folder / "tensorboard").iterdir()
    log = EventAccumulator(str(run)).Reload()
    logged = [event.value for event in log.Scalars("eval/success")]
    assert logged == pytest.approx([figures["success"] for figures in result.history])
    assert log.Tags()["scalars"].count("rollout/ep_rew_mean") == 1
    shares = {name: log.Scalars(f"reward/{name}")[-1].value for name in ("progress", "time", "effort", "success")}
    assert shares["time"] == pytest.approx(-0.1)
    assert shares["effort"] < 0.0 < shares["progress"]


def test_leaves_its_files(short):
    config, result, folder = short
    names = {"config.json", "best.zip", "policy.onnx", "result.json", "tensorboard"}
    assert {path.name for path in folder.iterdir()} == names
    record = json.loads((folder / "config.json").read_text())
    assert record["config"] == config.settings()
    assert record["hyperparameters"] == config.hyper == SHORT
    assert {"version", "commit", "libraries"} <= set(record)
    assert {"python", "numpy", "torch", "stable-baselines3"} <= set(record["libraries"])
    written = json.loads((folder / "result.json").read_text())
    assert written["history"] == result.history
    assert written["best"]["steps"] in [figures["steps"] for figures in result.history]
    assert written["best"]["return"] >= result.history[-1]["return"]  # the last one drives all episodes, as the best does
    card = BundlePolicy(folder / "policy.onnx", robot="burger", dt=0.1).card
    assert (card.env, card.noise, card.observation) == (config.env, "tutorial", "ekf")
    assert card.training["evaluation"] == written["best"]
    assert card.training["steps"] == result.steps
    assert card.training["config"] == record["config"]
    assert (folder / "policy.onnx").stat().st_size < 200_000


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no GPU")
def test_a_run_records_its_device(tmp_path):
    train(replace(small, device="cuda", steps=1024), tmp_path / "run", progress=False)
    card = BundlePolicy(tmp_path / "run" / "policy.onnx").card
    assert card.training["config"]["device"] == card.training["device"] == "cuda"


def test_callbacks_serve_a_users_script(tmp_path):
    def make(n):
        return gym.make_vec("turtlebot_gym/TurtleBotNav-v0", num_envs=n, autoreset_mode=AutoresetMode.SAME_STEP)

    model = PPO("MlpPolicy", Sb3VecEnv(make(64)), n_steps=32, batch_size=2048, n_epochs=1, seed=0, device="cpu")
    judge = EvaluationCallback(make(8), every=2048, path=tmp_path / "best.zip")
    model.learn(6144, callback=[judge])
    assert [figures["steps"] for figures in judge.history] == [2048, 4096, 6144]
    assert PPO.load(tmp_path / "best.zip").num_timesteps == judge.best["steps"]


def test_a_bundle_that_acts_differently_is_not_written(tmp_path, monkeypatch):
    config = TrainingConfig(config={"n_envs": 8, "n_timesteps": 256, "n_steps": 32, "batch_size": 256})
    right, model = network.program_of, make_model(config, config.make_training())
    half = torch.nn.Linear(2, 2, bias=False)
    half.weight.data = 0.5 * torch.eye(2)
    monkeypatch.setattr(network, "program_of", lambda layers, *sizes: right(torch.nn.Sequential(layers, half), *sizes))
    (tmp_path / "policy.onnx").write_text("the old one")
    with pytest.raises(RuntimeError, match="differ from the network's"):
        export(model, tmp_path / "policy.onnx", steps=20)
    assert [file.read_text() for file in tmp_path.iterdir()] == ["the old one"]


@pytest.mark.parametrize(("env", "policy", "rows"), [("nav", "bearing", 7), ("rooms", "bearing", 5), ("nav", "bearing", 40)])
def test_few_rows_drive_the_episodes_that_a_row_for_each_drives(env, policy, rows):
    config, drive = TrainingConfig(env=env), partial(judge, policy=make_policy(policy), seed=11, episodes=23)
    alone, in_turn = drive(config.make(23)), drive(config.make(rows))
    for column, other in zip(alone, in_turn, strict=True):
        np.testing.assert_array_equal(column, other)
    assert len(set(alone.steps)) > 1


@pytest.mark.parametrize(("last", "kept"), [([1.0, 0.0], 1), ([3.0, 0.0], 2), ([1.0, 9.0], 2)])
def test_the_best_model_so_far_drives_all_episodes_at_the_end_if_the_last_one_is_not_better(tmp_path, monkeypatch, last, kept):
    """Mean returns of the first episodes and of all others: the first model has 2 and 0."""
    returns = {1: [2.0, 0.0], 2: last}
    config = TrainingConfig(config={"n_envs": 8, "n_steps": 8, "batch_size": 64, "n_timesteps": 64})
    model = make_model(config, config.make_training())
    model.set_logger(configure(format_strings=[]))

    def drive(envs, policy, *, seed, episodes):
        first, rest = returns[model.num_timesteps]
        values = np.where(np.arange(episodes) < INTERIM, first, rest)
        return Judged(values > 0.0, values, np.ones(episodes, np.int64))

    monkeypatch.setattr(callbacks, "judge", drive)
    evaluation = EvaluationCallback(config.make(8), every=1, episodes=2 * INTERIM, path=tmp_path / "best.zip")
    evaluation.init_callback(model)
    for steps, episodes in ((1, INTERIM), (2, 2 * INTERIM)):
        model.num_timesteps = steps
        evaluation._run(episodes)
    assert evaluation.best["steps"] == kept
    assert evaluation.best["return"] == pytest.approx(np.mean(returns[kept]))
