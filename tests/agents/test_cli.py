"""The command line: results on standard output and in files, errors in one line, and little imported for its help."""

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from turtlebot_gym_agents.commands.cli import main
from turtlebot_gym_agents.evaluation.evaluate import evaluate

NAV, ROOMS = (f"turtlebot_gym/TurtleBot{task}-v0" for task in ("Nav", "Rooms"))


def test_evaluate_prints_tables_and_writes_all_combinations(tmp_path, capsys):
    paths = tmp_path / "out" / "result.json", tmp_path / "out" / "paths.png"
    arguments = ["--policy", "proportional", "bearing", "--noise", "clean", "documented", "--observation", "ekf", "truth"]
    assert (
        main(["evaluate", *arguments, "--episodes", "20", "--seed", "5", "--json", str(paths[0]), "--plot", str(paths[1])]) == 0
    )
    printed = capsys.readouterr()
    assert "proportional, clean, ekf" in printed.out
    assert "time*, s" in printed.out
    assert "false arrivals" not in printed.out  # a detail
    *_, first, second = printed.out.splitlines()
    assert re.fullmatch(r"bearing, documented, ekf (is|reaches) .*proportional, documented, ekf.*\.", first)
    assert re.fullmatch(r"bearing, documented, truth (is|reaches) .*proportional, documented, truth.*\.", second)
    assert not printed.err.strip()
    content = json.loads(paths[0].read_text())
    assert [run["label"] for run in content["runs"]] == [
        f"{policy}, {noise}, {seen}"
        for policy in ("proportional", "bearing")
        for noise in ("clean", "documented")
        for seen in ("ekf", "truth")
    ]
    assert content["config"]["seed"] == 5
    run = content["runs"][6]
    options = {"noise": "documented", "observation": "ekf"}
    expected = evaluate("bearing", episodes=20, seed=5, **options)
    assert run["config"].items() >= {"policy": "bearing", "episodes": 20, **options}.items()
    assert run["summary"]["success"]["value"] == expected.summary()["success"].value
    np.testing.assert_allclose(run["episodes"]["time"], expected.episodes.time)
    assert paths[1].read_bytes().startswith(b"\x89PNG")


@pytest.mark.filterwarnings("default")
def test_a_warning_is_a_line(capsys):
    assert main(["evaluate", "--world", "people", "--policy", "vfh+yield", "--episodes", "1"]) == 0
    [warning] = capsys.readouterr().err.splitlines()
    assert warning == "turtlebot-gym: vfh+yield reads tracks, which need wheel odometry: it drives with noise='wheel'."


MISSPELT = [
    (["evaluate", "--env", "turtlebot_gym/TurtleBotNaw-v0"], NAV),
    (["evaluate", "--policy", "Bearing"], "bearing"),
    (["evaluate", "--noise", "documentd"], "documented"),
    (["evaluate", "--env", ROOMS, "--world", "ofice"], "office"),
    (["train", "--algo", "PPO"], "ppo"),
]

REFUSED = [
    (["evaluate", "--robot", "roomba"], "robot must be one of 'burger', "),
    *((arguments, f"Did you mean {meant!r}?") for arguments, meant in MISSPELT),
    (["evaluate", "--policy", "vfh"], f"vfh: it steers by a LiDAR, which {NAV} does not have: choose --env {ROOMS}."),
    (["evaluate", "--policy", "ppo-nav", "--robot", "waffle"], "max_wheel 0.2097 there, 0.26 here). --allow-mismatch ("),
    (["evaluate", "--policy", "clever"], "FILE.onnx, FILE.yaml or 'module:callable', got 'clever'"),
    (["evaluate", "--env", "CartPole-v1"], "env must be one of "),
    (["evaluate", "--episodes", "0"], "episodes must be a whole number of at least 1, got 0"),
    (["evaluate", "--env", "nav", "--world", "dense"], f"world and lidar are for {ROOMS}"),
    (["evaluate", "--workers", "2"], "workers is the number of processes on this machine: choose --cluster local."),
    (["evaluate", "--cluster", "local", "--workers", "0"], "workers must be a whole number of at least 1, got 0."),
]


@pytest.mark.parametrize(
    ("arguments", "message"), REFUSED, ids=lambda value: " ".join(value) if isinstance(value, list) else ""
)
def test_invalid_arguments_are_refused_in_one_line_and_leave_nothing(arguments, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    printed = capsys.readouterr()
    assert not printed.out
    assert printed.err.startswith("turtlebot-gym: ")
    assert message in printed.err
    assert printed.err.count("\n") == 1
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def test_a_users_policy_is_found_in_the_working_folder(tmp_path):
    (tmp_path / "mine.py").write_text("import numpy as np\ndef drive(o):\n    return np.ones((*o.shape[:-1], 2), np.float32)\n")
    script = Path(sys.executable).with_name("turtlebot-gym")
    arguments = ["evaluate", "--policy", "mine:drive", "--episodes", "2"]
    done = subprocess.run([script, *arguments], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "mine:drive" in done.stdout


def test_a_value_is_yaml_and_several_are_compared(tmp_path):
    path = tmp_path / "result.json"
    varied = ["--noise", "{base: rough, odometry: {spike: 0.1}}", "--filter", "matched", "gated", "--dt", "0.05"]
    assert main(["evaluate", "--policy", "bearing", "--episodes", "3", *varied, "--json", str(path)]) == 0
    runs = json.loads(path.read_text())["runs"]
    assert [run["label"] for run in runs] == ["matched", "gated"]
    assert runs[0]["config"].items() >= {"noise": {"base": "rough", "odometry": {"spike": 0.1}}, "dt": 0.05}.items()
    expected = evaluate("bearing", episodes=3, dt=0.05, noise={"base": "rough", "odometry": {"spike": 0.1}})
    np.testing.assert_allclose(runs[0]["episodes"]["time"], expected.episodes.time)


@pytest.mark.parametrize("words", ["evaluate --policy mine.json --json mine.json", "export mine.onnx --out mine.onnx"])
def test_no_input_is_overwritten_even_with_force(words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for name in ("mine.json", "mine.onnx"):
        (tmp_path / name).write_text("{}")
    assert main([*words.split(), "--force"]) == 2
    assert "it is an input of the same command" in capsys.readouterr().err


@pytest.mark.parametrize("arguments", [["--help"], ["train", "--help"], ["evaluate", "--help"]], ids=str)
def test_help_imports_nothing_heavy(arguments, run):
    heavy = ("torch", "stable_baselines3", "llvmlite", "scipy", "matplotlib", "rich", "yaml", "onnx", "onnxruntime")
    program = f"""
import contextlib, json, sys
from turtlebot_gym_agents.__main__ import main
with contextlib.suppress(SystemExit):
    main({arguments})
print(json.dumps([name for name in {heavy} if name in sys.modules]))
"""
    assert run(program) == []
