"""`train --wandb`: a run of Weights & Biases gets what TensorBoard gets, and without it nothing imports the library."""

import json
import os
import struct
import subprocess
import sys
from importlib.util import find_spec
from types import SimpleNamespace

import pytest
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

import turtlebot_gym
from turtlebot_gym.extras import installing
from turtlebot_gym_agents.commands.cli import main
from turtlebot_gym_agents.training.config import TrainingConfig
from turtlebot_gym_agents.training.tracking import RUN_FILE, WandbCallback
from turtlebot_gym_agents.training.train import train

CONFIG = TrainingConfig(steps=20_000, evaluations=2, episodes=10)
INSTALLED = find_spec("wandb") is not None
BLOCK = 32768
"""Size of a block in the library's files, bytes."""


class Run:
    """A run that keeps what it receives."""

    def __init__(self):
        self.options, self.metrics, self.logged, self.finished = {}, {}, [], False

    def define_metric(self, name, summary):
        self.metrics[name] = summary

    def log(self, values, step):
        assert not self.finished
        self.logged.append((step, values))

    def finish(self):
        self.finished = True


@pytest.fixture
def runs(monkeypatch):
    """Runs of a library that sends nothing."""
    begun = []

    def init(**options):
        begun.append(Run())
        begun[-1].options = options
        return begun[-1]

    monkeypatch.setitem(sys.modules, "wandb", SimpleNamespace(init=init))
    return begun


def curves(folder):
    """Return TensorBoard's curves as values by name and step."""
    (path,) = (folder / "tensorboard").rglob("events.*")
    events = EventAccumulator(str(path)).Reload()
    return {name: {event.step: event.value for event in events.Scalars(name)} for name in events.Tags()["scalars"]}


def test_a_run_has_the_configuration_and_tensorboards_curves(tmp_path, runs):
    folder = tmp_path / "run"
    folder.mkdir()
    train(CONFIG, folder, progress=False, callbacks=[WandbCallback(CONFIG, folder, project="mine")])
    (run,) = runs
    assert run.finished
    assert run.options["project"] == "mine"
    assert run.options["config"].items() >= {"env": CONFIG.env, "steps": 20_000, "version": turtlebot_gym.__version__}.items()
    assert json.loads(json.dumps(run.options["config"])) == run.options["config"]
    assert run.options["id"] == (folder / RUN_FILE).read_text().strip()
    steps = [step for step, _ in run.logged]
    assert steps == sorted(steps)  # wandb drops what comes under an earlier step
    sent = {}
    for step, values in run.logged:
        for name, value in values.items():
            sent.setdefault(name, {})[step] = value
    expected = curves(folder)
    assert {"eval/return", "eval/success", "train/loss", "time/fps"} <= set(expected)
    for name, values in expected.items():
        assert sent[name] == pytest.approx(values, rel=1e-6), name  # TensorBoard keeps single precision
    assert run.metrics["eval/return"] == "max"


def test_a_resumed_training_resumes_its_run(tmp_path, runs):
    first = WandbCallback(CONFIG, tmp_path)
    second = WandbCallback(CONFIG, tmp_path)
    for callback in (first, second):
        callback.model = SimpleNamespace(logger=SimpleNamespace(output_formats=[]))
        callback._on_training_start()
    assert runs[0].options["id"] == runs[1].options["id"]
    assert all(run.options["resume"] == "allow" for run in runs)


@pytest.mark.skipif(INSTALLED, reason="wandb is installed")
def test_a_missing_library_is_named_before_the_training(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["train", "--wandb"]) == 2
    assert f"wandb is not installed: {installing('wandb')}." in capsys.readouterr().err
    assert not [*tmp_path.iterdir()]


def test_the_command_names_the_project(tmp_path, runs, monkeypatch):
    monkeypatch.setattr("turtlebot_gym_agents.commands.learning.find_spec", lambda name: True)
    for number, (words, project) in enumerate([([], "turtlebot-gym"), (["mine"], "mine")]):
        short = ["--steps", "1", "--evaluations", "1", "--out", str(tmp_path / str(number))]
        assert main(["train", *short, "--wandb", *words]) == 0
        assert runs[-1].options["project"] == project


@pytest.mark.skipif(not INSTALLED, reason="needs the extra [wandb]")
def test_offline_the_library_itself_keeps_the_curves(tmp_path):
    folder = tmp_path / "run"
    command = ["train", "--steps", "20000", "--evaluations", "2", "--out", str(folder), "--wandb", "mine"]
    environment = {"WANDB_MODE": "offline", "WANDB_SILENT": "true", "HOME": str(tmp_path), "PATH": "/usr/bin:/bin"}
    environment |= {"PYTHONPATH": os.environ["PYTHONPATH"]} if "PYTHONPATH" in os.environ else {}
    done = subprocess.run(
        [sys.executable, "-m", "turtlebot_gym_agents", *command], env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    (kept,) = (folder / "wandb").glob("offline-run-*/run-*.wandb")
    history = _history(kept)
    for name, values in curves(folder).items():
        assert history[name] == pytest.approx(values, rel=1e-6), name


def _history(path):
    """Return the curves in a file of the library's, as values by name and step: a log in LevelDB's format of messages."""
    from wandb.proto.wandb_internal_pb2 import Record

    curves, message, data, at = {}, b"", path.read_bytes(), 7  # behind the file's header
    while at < len(data):
        if BLOCK - at % BLOCK < 7:  # too little for the header of a part
            at += BLOCK - at % BLOCK
            continue
        _, length, kind = struct.unpack("<IHB", data[at : at + 7])
        message += data[at + 7 : at + 7 + length]
        at += 7 + length
        if kind in (1, 4):  # a whole message, or its last part
            record, message = Record.FromString(message), b""
            for item in record.history.item:
                curve = curves.setdefault(item.key or "/".join(item.nested_key), {})
                curve[record.history.step.num] = json.loads(item.value_json)
    return curves
