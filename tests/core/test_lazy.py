"""What importing the package brings: all its names, and little else until they are used."""

import ast
from pathlib import Path

import pytest

import turtlebot_gym

HEAVY = ("llvmlite", "scipy", "matplotlib", "filterpy", "pygame", "torch", "rich", "yaml", "turtlebot_gym.systems")
IMPORT = f"""
import sys, turtlebot_gym, gymnasium
loaded = [name for name in {HEAVY} if name in sys.modules]
found = [loaded, sorted(id for id in gymnasium.registry if id.startswith('turtlebot_gym/'))]
"""
BY_PICKLE = "import pickle, turtlebot_gym as tb; found = type(pickle.loads(pickle.dumps(tb.ROBOTS['burger']))).__name__"


@pytest.mark.parametrize(
    ("script", "expected"),
    [
        (IMPORT, [[], [f"turtlebot_gym/TurtleBot{name}-v0" for name in ("Missions", "Nav", "Pose", "Rooms", "Square")]]),
        ("from turtlebot_gym import *; found = Robot.__name__", "Robot"),
        ("import turtlebot_gym; found = turtlebot_gym.Robot.__name__", "Robot"),
        ("import turtlebot_gym; found = turtlebot_gym.robots.Robot.__name__", "Robot"),
        (BY_PICKLE, "Robot"),
    ],
)
def test_the_import_registers_the_environments_brings_little_else_and_finds_names_in_any_way(script, expected, run):
    assert run(script + "\nimport json\nprint(json.dumps(found))") == expected


def test_what_type_checkers_read_is_what_is_found():
    tree = ast.parse(Path(turtlebot_gym.__file__).read_text())
    imports = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.module != "turtlebot_gym.lazy"]
    read = {
        alias.name: node.module.partition(".")[2]
        for node in imports
        for alias in node.names
        if node.module.startswith("turtlebot_gym.")
    }
    homes = {name: module for module, names in turtlebot_gym._HOMES.items() for name in names}
    assert read == homes
    assert set(turtlebot_gym.__all__) == set(homes) <= set(dir(turtlebot_gym))
    for name in homes:
        assert getattr(turtlebot_gym, name) is vars(turtlebot_gym)[name]  # looked up once


def test_other_names_are_refused_as_by_any_module():
    with pytest.raises(AttributeError, match="module 'turtlebot_gym' has no attribute 'Robots'"):
        turtlebot_gym.Robots  # noqa: B018
    with pytest.raises(ImportError, match="cannot import name 'Robots'"):
        from turtlebot_gym import Robots  # noqa: F401
    assert not hasattr(turtlebot_gym, "__wrapped__")
