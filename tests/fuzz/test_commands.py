"""Every command does what its arguments ask, or says on one line what is wrong, with the exit code 2."""

import contextlib
import io
import warnings
from dataclasses import fields, is_dataclass
from typing import get_type_hints

import pytest
from fuzzing import FOLDER, HEADERS, answered, fuzzed, table
from hypothesis import strategies as st

pytest.importorskip("stable_baselines3", reason="needs the extra [agents]")

from turtlebot_gym_agents.commands.cli import COMMANDS, commands, main

try:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # rclpy's parser warns of a module of Python's own
        import rclpy.node  # noqa: F401
        import rosidl_generator_py  # noqa: F401
    from turtlebot_gym_ros.__main__ import main as ros
except ImportError:
    ros = None

(FOLDER / "drive.csv").write_text(table(HEADERS["replay"]))
(FOLDER / "binary.csv").write_bytes(bytes(range(256)))
(FOLDER / "mine.yaml").write_text("process: {alpha1: 0.01}\n")
(FOLDER / "broken.yaml").write_text("{a: [")
(FOLDER / "list.yaml").write_text("[1, 2]\n")
(FOLDER / "empty.json").write_text("{}")
(FOLDER / "broken.onnx").write_bytes(b"\x08\x0a")
(FOLDER / "model.zip").write_bytes(b"PK\x05\x06" + bytes(18))
(FOLDER / "here").mkdir()
BASES: dict[str, list[str]] = {
    "evaluate": ["--episodes", "2", "--policy", "bearing"],
    "replay": ["drive.csv", "--seeds", "1"],
    "estimate": ["--runs", "4", "--seconds", "0.3", "--filter", "matched"],
    "calibrate": ["binary.csv"],
    "localize": ["binary.csv", "--map", "mine.yaml"],
    "map": ["binary.csv", "--out", "lab.yaml"],
    "watch": ["--drive", "binary.csv", "--html", "a.html"],
    "train": ["--config", "list.yaml", "--out", "run"],
    "tune": ["--config", "broken.yaml", "--out", "search"],
    "export": ["model.zip", "--allow-pickle"],
    "card": ["ppo-nav"],
    "study": ["list.yaml", "--out", "study"],
    "benchmark": ["--check", "empty.json"],
    "compile": ["--system", "nothing"],
}
"""What is quick: it takes a moment, or has an input that is refused. Of satellites those that are installed are tried."""
KNOWN = commands()
BASES = {name: words for name, words in BASES.items() if name in KNOWN}
LEFT_OUT = {"cluster", "workers", "peers", "storage", "all"}
"""Options that reach for other machines, install something, serve until Ctrl-C, or compile all there is."""
WORDS = st.one_of(
    st.sampled_from(
        [
            "",
            "-1",
            "0",
            "1",
            "2",
            "0.5",
            "1.5",
            "nan",
            "inf",
            "-inf",
            "1e-9",
            "1e17",
            "1e308",
            "True",
            "None",
            "x" * 300,
            "é",
            "a b",
            "\n",
            "here",
            "here/",
            "/",
            ".",
            "/proc/none/a.json",
            "nope.yaml",
            "broken.yaml",
            "list.yaml",
            "mine.yaml",
            "empty.json",
            "broken.onnx",
            "binary.csv",
            "drive.csv",
            "nope.onnx",
            "os:getcwd",
            "nope:drive",
            ":",
            "bearing+safety",
            "+safety",
            "a.png",
            "a.txt",
            "a.json",
            "here/a.json",
            "drive.csv/a.json",
            "burger",
            "wheel",
            "matched",
            "mujoco",
            "time",
            "belief",
            "turtlebot_gym/TurtleBotSquare-v0",
            "turtlebot_gym/TurtleBotRooms-v0",
            "CartPole-v1",
            "dense",
            "lds01",
        ]
    ),
    st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=6),
)


def options_of(command):
    """Return the options of a command, with those of its parts."""
    hints, names = get_type_hints(command), []
    for item in fields(command):
        if item.name in LEFT_OUT:
            continue
        inner = (
            [f"{item.name}.{part.name}" for part in fields(hints[item.name])] if is_dataclass(hints[item.name]) else [item.name]
        )
        names += ["--" + name.replace("_", "-") for name in inner]
    return names


OPTIONS = {name: options_of(command) for name, command in KNOWN.items()}
FLAGS = {
    "--details",
    "--randomize",
    "--allow-pickle",
    "--allow-mismatch",
    "--force",
    "--training",
    "--bias",
    "--slip",
}


def code_of(run, argv):
    """Return the exit code of a command; "usage" where its parser refuses, which has a form of its own."""
    try:
        return run(argv)
    except SystemExit as stop:
        return "usage" if stop.code == 2 else stop.code


def said(argv, run=main, begins="turtlebot-gym: "):
    """Run a command, and return that it succeeded; what it refuses by itself becomes a ValueError of that one line."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.chdir(FOLDER), contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = code_of(run, argv)
    if code == "usage":
        raise ValueError("usage")
    message = err.getvalue()
    if code == 2:
        assert message.startswith(begins), message
        assert message.count("\n") == 1, message
        raise ValueError(message.strip())
    assert code == 0, (argv, message)
    return True


def test_every_command_is_tried():
    assert set(COMMANDS) <= set(BASES) == set(KNOWN)
    assert said(["evaluate", *BASES["evaluate"]])


@pytest.mark.nightly
@fuzzed(60, 2000, name=st.sampled_from(sorted(BASES)), data=st.data())
def test_command_lines(name, data):
    argv = [name, *BASES[name]]
    for _ in range(data.draw(st.integers(1, 2))):
        option = data.draw(st.sampled_from(OPTIONS[name]))
        argv += [option] if option in FLAGS else [option, data.draw(WORDS)]
    for left in FOLDER.glob("tuned.json"):
        left.unlink()
    answered("command lines", lambda: said(argv))


POISON = {"bringup": ["--duration", "nan"], "waypoint_generator": ["--ros-args", "-p", "rat:=1"]}
ROS_OPTIONS = {
    "bringup": [
        "--speed",
        "--policy",
        "--robot",
        "--noise",
        "--waypoints",
        "--world",
        "--lidar",
        "--seed",
        "--figure",
        "--json",
    ],
    "waypoint_generator": ["-p", "-r", "--params-file", "--log-level", "-x"],
}


@fuzzed(15, 150, name=st.sampled_from(sorted(POISON)), data=st.data())
def test_ros_command_lines(name, data):
    if ros is None:
        pytest.skip("needs the extra [ros]")
    argv = [name, *POISON[name], data.draw(st.sampled_from(ROS_OPTIONS[name])), data.draw(WORDS)]
    assert answered("ROS command lines", lambda: said(argv, ros, "error: ")) is None, argv
