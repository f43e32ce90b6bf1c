"""The page on Python: each task takes at most eight lines, imports included, and each block is complete."""

import ast
import builtins
import re

import pytest
import yaml
from pages import ROOT, blocks_of, rows_after

import turtlebot_gym_agents

PAGE = ROOT / "docs" / "python.md"
MOST = 8
"""Lines of a task."""
TASKS = (
    "Train, and compare with a baseline",
    "A reward of your own",
    "An observation of your own",
    "A filter of your own, and its NEES",
    "Plot a drive in a room",
    "Learning curves of three seeds",
    "Save, load, deploy",
    "Stable-Baselines3 as you know it",
    "A video",
)
BLOCKS = [block for block in blocks_of(PAGE) if block.kind == "python"]


def lines_of(text):
    return [line for line in text.splitlines() if line.strip()]


def unbound(text):
    """Return the names that code reads and neither binds nor imports."""
    nodes = list(ast.walk(ast.parse(text)))
    names = [node for node in nodes if isinstance(node, ast.Name)]
    bound = {node.id for node in names if isinstance(node.ctx, ast.Store)}
    bound |= {(alias.asname or alias.name).partition(".")[0] for node in nodes for alias in getattr(node, "names", ())}
    bound |= {node.name for node in nodes if isinstance(node, ast.FunctionDef)}
    bound |= {argument.arg for node in nodes if isinstance(node, ast.arguments) for argument in node.args}
    return {node.id for node in names if isinstance(node.ctx, ast.Load)} - bound - {*dir(builtins)}


@pytest.mark.parametrize("block", BLOCKS, ids=[str(block.line) for block in BLOCKS])
def test_a_task_takes_eight_lines_and_nothing_from_other_blocks(block):
    assert len(lines_of(block.text)) <= MOST
    assert max(map(len, block.text.splitlines())) <= 118
    assert ";" not in block.text
    assert unbound(block.text) == set()


def test_every_task_has_its_block_in_turn():
    text = PAGE.read_text(encoding="utf-8")
    parts = re.split(r"^## ", text, flags=re.MULTILINE)[1:]
    assert [part.partition("\n")[0] for part in parts][: len(TASKS)] == list(TASKS)
    assert [part.count("```python") for part in parts] == [1] * len(parts)


def test_the_table_names_what_a_person_imports():
    named = [row[0].strip("`") for row in rows_after("docs/python.md", "# Python")]
    functions = [name for name in turtlebot_gym_agents.__all__ if name.islower()]
    assert sorted(named) == sorted(functions)


def test_the_page_stands_after_the_start():
    navigation = yaml.compose((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))
    (nav,) = [value for key, value in navigation.value if key.value == "nav"]
    names = [entry.value[0][0].value for entry in nav.value]
    assert names[names.index("Start here") + 1] == "Python"


def test_names_that_are_nowhere_bound_are_noticed():
    assert unbound("import numpy as np\nprint(np.mean(values))") == {"values"}
