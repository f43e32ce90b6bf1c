"""What importing the package brings: all its names, and little else until they are used."""

from __future__ import annotations

import ast
import json
import subprocess
import sys
from pathlib import Path

import pytest

import turtlebot_gym

HEAVY = ("numba", "scipy", "matplotlib", "filterpy", "pygame", "torch", "rich", "yaml", "turtlebot_gym.systems")


def run(script):
    """Run a script in a Python of its own, and return what it prints last as JSON."""
    done = subprocess.run([sys.executable, "-W", "error", "-c", script], capture_output=True, text=True, timeout=100)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def test_the_import_registers_the_environments_and_brings_little_else():
    loaded, ids = run(
        "import json, sys, turtlebot_gym, gymnasium\n"
        f"loaded = [name for name in {HEAVY} if name in sys.modules]\n"
        "print(json.dumps([loaded, sorted(id for id in gymnasium.registry if id.startswith('turtlebot_gym/'))]))"
    )
    assert loaded == []
    assert ids == [f"turtlebot_gym/TurtleBot{name}-v0" for name in ("Nav", "Pose", "Rooms", "Square")]


def test_what_type_checkers_read_is_what_is_found():
    tree = ast.parse(Path(turtlebot_gym.__file__).read_text())
    imports = [
        node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("turtlebot_gym.")
    ]
    read = {
        alias.name: node.module.partition(".")[2]
        for node in imports
        for alias in node.names
        if node.module != "turtlebot_gym.lazy"
    }
    homes = {name: module for module, names in turtlebot_gym._HOMES.items() for name in names}
    assert read == homes
    assert set(turtlebot_gym.__all__) == set(homes)


def test_every_public_name_is_there():
    assert set(turtlebot_gym.__all__) <= set(dir(turtlebot_gym))
    for name in turtlebot_gym.__all__:
        value = getattr(turtlebot_gym, name)
        assert value is not None
        assert vars(turtlebot_gym)[name] is value  # looked up once


@pytest.mark.parametrize(
    "statement",
    [
        "from turtlebot_gym import *; robot = Robot",
        "from turtlebot_gym import Robot as robot",
        "import turtlebot_gym; robot = turtlebot_gym.Robot",
        "import turtlebot_gym; robot = turtlebot_gym.robots.Robot",
        "import pickle, turtlebot_gym; robot = type(pickle.loads(pickle.dumps(turtlebot_gym.ROBOTS['burger'])))",
    ],
)
def test_names_are_found_however_they_are_asked_for(statement):
    assert run(f"import json\n{statement}\nprint(json.dumps(robot.__name__))") == "Robot"


def test_other_names_are_refused_as_by_any_module():
    with pytest.raises(AttributeError, match="module 'turtlebot_gym' has no attribute 'Robots'"):
        turtlebot_gym.Robots  # noqa: B018
    with pytest.raises(ImportError, match="cannot import name 'Robots'"):
        from turtlebot_gym import Robots  # noqa: F401
    assert not hasattr(turtlebot_gym, "__wrapped__")
