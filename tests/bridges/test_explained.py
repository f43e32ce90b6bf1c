"""The help of nodes and tools: what the nodes really have, in the words of their configuration, and quick to print."""

import re
import subprocess
import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import pytest

from turtlebot_gym_ros.__main__ import main
from turtlebot_gym_ros.base.explain import Setting, brief, explain, parameters_of
from turtlebot_gym_ros.base.frames import Common
from turtlebot_gym_ros.nodes import BLOCKS, NODES, SATELLITES, TOOLS, load, programs
from turtlebot_gym_ros.recording import logger

ROOT = Path(__file__).parents[2] / "bridges"
CONFIGS = sorted(ROOT.glob("*/config/*.yaml"))
LONGEST = 60
"""Most lines of a help."""
NOT_ON_PYPI = tuple(package for package in ("tf2_msgs", "nav2_msgs") if not find_spec(package))


def classes_of(name):
    """Return the classes of a node's parameters."""
    if name in BLOCKS:
        return Common, load(name).Params
    if name == "data_logger":
        return (logger.Parameters,)
    module = import_module("cmd_vel_guard." + {"cmd_vel_guard": "parameters", "cmd_vel_standby": "standby"}[name])
    return (module.Parameters,)


@pytest.mark.parametrize("name", [*NODES, *TOOLS, *programs()])
def test_every_help_says_first_what_it_does_and_is_short(capsys, monkeypatch, name):
    if name in SATELLITES:
        pytest.importorskip("turtlebot_gym_lab", reason="needs the extra [lab]")
    monkeypatch.delenv("COLUMNS", raising=False)
    try:
        code = main([name, "--help"])
    except SystemExit as end:  # argparse's
        code = end.code
    out, err = capsys.readouterr()
    assert (code, err) == (0, "")
    usage, said = out.split("\n\n")[:2]
    assert usage.startswith(f"usage: python -m turtlebot_gym_ros {name} [")
    assert len(said) > 15
    assert said.rstrip().endswith(".") or ":" in said
    assert "`" not in out
    assert len(out.splitlines()) <= LONGEST


@pytest.mark.parametrize("name", [name for name in NODES if name not in ("bringup", "status")])
def test_a_nodes_help_has_each_parameter_with_its_default_and_meaning(capsys, monkeypatch, name):
    monkeypatch.setenv("COLUMNS", "300")
    assert main([name, "--help"]) == 0
    lines = {
        tuple(line.split(None, 1)) for line in capsys.readouterr().out.splitlines() if ":=" in line and line.startswith("  ")
    }
    settings = parameters_of(*classes_of(name))
    assert {(f"{each.name}:={each.default}", f"{each.text}.") for each in settings} == lines


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
def test_the_comments_of_a_configuration_are_the_first_sentences_of_the_parameters_docstrings(path):
    node, said, declared = "", {}, {}
    for line in path.read_text().splitlines():
        if named := re.match(r"/\*\*/(\w+):", line):
            node = named[1] if named[1] in NODES else ""  # the guard may be absent
            declared |= {(node, each.name): each.text for each in parameters_of(*classes_of(node))} if node else {}
        elif node and (given := re.match("    (\\w+): ", line)):
            said[node, given[1]] = line.partition("  # ")[2]
    assert said == {key: declared[key] for key in said}
    assert said


def test_the_first_sentence_ends_at_a_full_stop_before_a_new_one():
    assert brief("At 2.5 m/s, see `moved`. With 0 it stands.") == "At 2.5 m/s, see moved"
    assert brief('A FILE.yaml, or ``x``. "y" is no more.') == "A FILE.yaml, or x"


def test_a_long_text_is_wrapped_beside_its_name(monkeypatch):
    monkeypatch.setenv("COLUMNS", "60")
    lines = explain("run", "Do. " * 30, [Setting("gain", "1.0", "word " * 20)]).splitlines()
    assert max(map(len, lines)) <= 60
    assert sum(line.startswith(" " * 13 + "word") for line in lines) >= 1


def test_a_help_loads_neither_a_compiler_nor_a_context():
    words = [sys.executable, "-X", "importtime", "-m", "turtlebot_gym_ros", "velocity_controller", "--help"]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    loaded = {line.rpartition("|")[2].strip() for line in done.stderr.splitlines()}
    assert not {"llvmlite", "scipy", "torch", "matplotlib"} & loaded
    assert "turtlebot_gym_ros.node.shell" not in loaded
