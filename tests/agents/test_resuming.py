"""Resuming a training: it continues from whatever a kill has left, and no code in its files is run."""

import base64
import contextlib
import json
import multiprocessing
import random
import shutil
import time
import zipfile
from dataclasses import replace
from pathlib import Path

import cloudpickle
import numpy as np
import pytest
import torch
from stable_baselines3 import PPO, SAC

from turtlebot_gym_agents.commands.cli import main
from turtlebot_gym_agents.policies.bundle import BundlePolicy
from turtlebot_gym_agents.training.config import TrainingConfig
from turtlebot_gym_agents.training.model import _replay_path, make_model
from turtlebot_gym_agents.training.train import train

pytestmark = pytest.mark.touched("agents/turtlebot_gym_agents/training", "tests/agents")

NETWORK = {"n_envs": 64, "n_timesteps": 2048, "policy": "MlpPolicy", "policy_kwargs": {"net_arch": [8]}}
SMALL = NETWORK | {"n_steps": 16, "batch_size": 1024, "n_epochs": 1}
OFF_POLICY = NETWORK | {"learning_starts": 128, "buffer_size": 1000, "batch_size": 32}
small = TrainingConfig(config=SMALL, episodes=8, evaluations=2)


@pytest.fixture
def finished(tmp_path):
    """Return the folder of a finished run."""
    train(small, tmp_path / "finished", progress=False)
    return tmp_path / "finished"


def test_a_folder_with_a_run_is_not_overwritten(finished):
    config, folder = small, finished
    with pytest.raises(ValueError, match="--resume"):
        train(config, folder, progress=False)
    for change in ({"noise": "rough"}, {"seed": 2}, {"randomize": True}, {"arrival": "belief"}):
        with pytest.raises(ValueError, match=f"with {next(iter(change))}"):
            train(replace(config, **change), folder, resume=True, progress=False)
    with pytest.raises(ValueError, match=r"with gamma None: it cannot be resumed with 0\.5"):
        train(replace(config, config=SMALL | {"gamma": 0.5}), folder, resume=True, progress=False)


def test_a_record_of_an_earlier_version_is_resumed_but_not_an_invalid_checkpoint(finished):
    record = json.loads((finished / "config.json").read_text())
    for name in ("task", "dt", "plant", "integrator"):  # it did not have them
        del record["config"][name]
    record["config"]["arrival"] = "truth"  # which was the default of all tasks
    record["hyperparameters"]["n_steps"] = "16"  # as the file had it
    (finished / "config.json").write_text(json.dumps(record))
    small.continuing(finished)
    for content in (b"", b"no zip at all"):
        (finished / "checkpoint.zip").write_bytes(content)
        with pytest.raises(ValueError, match=r"checkpoint\.zip is not a model of Stable-Baselines3: [^\n]*$"):
            train(small, finished, resume=True, progress=False)


@pytest.mark.nightly
def test_40_960_steps_suffice_and_the_run_goes_on_with_more(tmp_path):
    few = TrainingConfig(steps=40_960, evaluations=2)
    assert train(few, tmp_path / "run", progress=False).best["success"] > 0.98
    more = train(replace(few, steps=200_000, evaluations=40), tmp_path / "run", resume=True, progress=False)
    assert more.steps >= 200_000


def test_a_finished_run_is_resumed_to_the_same(tmp_path):
    first = train(small, tmp_path / "run", progress=False)
    again = train(small, tmp_path / "run", resume=True, progress=False)
    assert (again.steps, again.best) == (first.steps, first.best)
    more = train(replace(small, steps=4096), tmp_path / "run", resume=True, progress=False)
    assert more.steps == 4096
    assert more.best["return"] >= first.best["return"]
    assert again.history == first.history
    assert more.history[:-1] == first.history
    assert more.history[-1]["steps"] == 4096


class Planted:
    """An object whose unpickling leaves a file."""

    def __init__(self, path: Path):
        self.path = path

    def __reduce__(self):
        return Path.touch, (self.path,)


def test_resuming_runs_nothing_that_is_pickled_in_the_folder(tmp_path):
    """Policies travel as bundles because these files could run any code; resuming must not run it unasked."""
    run, trace = tmp_path / "run", tmp_path / "trace"
    train(small, run, progress=False)
    planted = {":type:": "any", ":serialized:": base64.b64encode(cloudpickle.dumps(Planted(trace))).decode()}
    for name in ("checkpoint.zip", "best.zip"):
        with zipfile.ZipFile(run / name) as archive:
            parts = {part: archive.read(part) for part in archive.namelist()}
        parts["data"] = json.dumps(json.loads(parts["data"]) | {"learning_rate": planted}).encode()
        with zipfile.ZipFile(run / name, "w") as archive:
            for part, content in parts.items():
                archive.writestr(part, content)
    dangerous = shutil.copy(run / "checkpoint.zip", tmp_path / "dangerous.zip")
    assert train(replace(small, steps=4096), run, resume=True, progress=False).steps == 4096
    assert not trace.exists()
    with contextlib.suppress(Exception):
        PPO.load(dangerous, device="cpu")
    assert trace.exists()  # where it is unpickled, it runs


def test_off_policy_checkpoints_have_their_replay_buffer(tmp_path):
    config = TrainingConfig(algo="sac", config=OFF_POLICY, episodes=8, steps=512)
    checkpoint = tmp_path / "run" / "checkpoint.zip"
    train(config, tmp_path / "run", progress=False)
    saved = SAC.load(checkpoint)
    model = make_model(config, config.make(64), checkpoint=checkpoint)
    assert isinstance(model, SAC)
    assert model.replay_buffer.size() * 64 == model.num_timesteps == 512
    assert model._n_updates == saved._n_updates > 0
    assert model.log_ent_coef.item() == saved.log_ent_coef.item()
    restored, expected = (source.get_parameters() for source in (model, saved))
    assert all(torch.equal(restored["policy"][name], weight) for name, weight in expected["policy"].items())
    assert str(restored["critic.optimizer"]) == str(expected["critic.optimizer"])
    with np.load(_replay_path(checkpoint)) as content:
        np.testing.assert_array_equal(model.replay_buffer.observations[:8], content["observations"])
    assert train(replace(config, steps=640), tmp_path / "run", resume=True, progress=False).steps == 640
    _replay_path(checkpoint).unlink()
    with pytest.raises(ValueError, match="is missing, without which the run cannot be resumed"):
        train(replace(config, steps=700), tmp_path / "run", resume=True, progress=False)


@pytest.mark.nightly
@pytest.mark.parametrize("kills", [3, pytest.param(20, marks=pytest.mark.slow)])
def test_resumes_after_kills(kills, tmp_path):
    """It saves and evaluates as often as possible, so that many kills occur while it writes."""
    processes = multiprocessing.get_context("forkserver")
    processes.set_forkserver_preload([train.__module__])  # a child then begins in no time
    chance = random.Random(4)
    folder, reached = tmp_path / "run", 0
    checkpoint = folder / "checkpoint.zip"
    config = replace(small, steps=10**9, evaluations=10**9 // 1024, checkpoint_seconds=0.0)
    for kill in range(kills):
        child = processes.Process(target=train, args=(config, folder), kwargs={"resume": True, "progress": False})
        child.start()
        advance = kill % 2 == 0  # wait for a new checkpoint; otherwise the kill comes at any moment after the start
        before = checkpoint.stat().st_mtime_ns if checkpoint.exists() else 0
        while advance and child.is_alive() and (checkpoint.stat().st_mtime_ns if checkpoint.exists() else 0) == before:
            time.sleep(0.001)
        time.sleep(chance.uniform(0.0, 0.3 if advance else 1.5))
        assert child.is_alive()
        child.kill()
        child.join()
        steps = PPO.load(checkpoint, device="cpu").num_timesteps
        assert steps > reached if advance else steps >= reached
        reached = steps
        assert json.loads((folder / "config.json").read_text())["hyperparameters"] == SMALL
        if (folder / "best.zip").exists():
            PPO.load(folder / "best.zip", device="cpu")
    result = train(replace(config, steps=reached + 1, evaluations=2), folder, resume=True, progress=False)
    assert reached < result.steps <= reached + 1024
    BundlePolicy(folder / "policy.onnx", robot="burger", dt=0.1)


def test_a_resuming_command_warns_that_the_policy_will_differ(tmp_path, capsys):
    line = ["train", "--out", str(tmp_path / "run"), "--steps", "2048", "--evaluations", "1", "--resume", "episodes=8"]
    assert main(line) == 0
    assert "uninterrupted" not in capsys.readouterr().err
    (tmp_path / "run" / "policy.onnx").unlink()  # as an interruption leaves it
    assert main(line) == 0
    assert "run continues in new episodes: its policy will not be that of an uninterrupted" in capsys.readouterr().err
