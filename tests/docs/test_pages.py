"""Each code block of the documentation and of the README is run or checked; CONTRIBUTING's recipes to the letter."""

import os
import re
import subprocess
import sys
import warnings
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import NamedTuple
from unittest.mock import patch

import gymnasium as gym
import numpy as np
import pytest
import tomllib
import yaml
from markdown_it import MarkdownIt

import turtlebot_gym
from turtlebot_gym.estimation.plain import Plain

pytest.importorskip("rclpy", reason="needs the extra [ros]")
with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # its parser, which the first node imports, warns of a module of Python's own
    pytest.importorskip("rosidl_generator_py", reason="needs the extra [ros]")
pytest.importorskip("stable_baselines3", reason="needs the extra [agents]")

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


class Block(NamedTuple):
    kind: str
    title: str
    text: str
    line: int


def blocks_of(path):
    """Return the code blocks of a page; a title is the name of the file that a block is."""
    blocks = []
    for token in MarkdownIt("commonmark").parse(path.read_text(encoding="utf-8")):
        if token.type == "fence":
            kind, _, rest = token.info.partition(" ")
            title = rest.removeprefix('title="').removesuffix('"')
            assert rest in ("", f'title="{title}"'), f"{path}: {token.info}"
            assert token.map is not None
            blocks.append(Block(kind, title, token.content, token.map[0] + 1))
    return blocks


LONG = {"README", "belief", "rooms", "calibrate", "study", "filter", "fix", "libraries", "policy", "python", "robot", "train"}
LONG |= {"watch", "gallery", "start", "task", "tutorial"}
"""Pages whose blocks train, or compile systems that the other tests do not need; they run in `make test-all`."""
QUICK = {
    "evaluate": {"episodes": "5"},
    "replay": {"seeds": "2"},
    "train": {"steps": "2048", "evaluations": "1"},
    "bringup": {"duration": "3"},
}
"""Options that make the commands of the pages short; all others are left as they stand."""
SHORT = {r"steps=[\d_]+": "steps=1024, evaluations=1", r"learn\([\d_]+\)": "learn(256)", r"episodes=\d+": "episodes=5"}
"""What makes the Python blocks of the page on Python short."""
CLIENTS = tomllib.loads((ROOT / "tests" / "clients" / "clients.toml").read_text(encoding="utf-8"))
"""Scripts that tests of clients run, in environments that have their libraries."""


def shortened(line):
    """Return a command with the options of `QUICK`."""
    command = re.match(r"(?:turtlebot-gym|python -m turtlebot_gym_ros) ([\w-]+)", line)
    code = line.partition("  #")[0]
    for name, value in QUICK.get(command[1] if command else "", {}).items():
        code = re.sub(rf" --{name} \S+", "", code) + f" --{name} {value}"
    return code


def run(text):
    """Run a bash block, shortened."""
    script = "\n".join(map(shortened, text.splitlines()))
    search = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    done = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", script], env=os.environ | {"PATH": search}, capture_output=True, text=True
    )
    assert done.returncode == 0, f"{script}\n{done.stdout}\n{done.stderr}"


def write_drive(path):
    """Write a recorded drive, as `replay` reads them: 10 s straight ahead."""
    rows = [f"{0.1 * k:.1f},0.2,0.0,{0.02 * k:.2f},0.0,0.0" for k in range(101)]
    path.write_text("\n".join(["t,vx,gyro,px,py,theta", *rows]))


@pytest.mark.parametrize(
    "path",
    [pytest.param(path, marks=[pytest.mark.slow] * (path.stem in LONG), id=path.stem) for path in PAGES if blocks_of(path)],
)
def test_code_blocks_work(path, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.syspath_prepend(path.with_suffix(""))  # files that the page links to
    if any('device="torch-cpu"' in block.text for block in blocks_of(path)):
        pytest.importorskip("torch", reason="needs torch")
    write_drive(tmp_path / "drive.csv")
    page = ModuleType("page")
    monkeypatch.setitem(sys.modules, "page", page)  # in which a term of an observation has a name
    with patch.dict(turtlebot_gym.NOISES), patch.dict(gym.registry):  # pages may add to them
        for block in blocks_of(path):
            if not CLIENTS.get(Path(block.title).stem, {}).get("in_make_test", True):
                continue
            if block.title:
                Path(block.title).write_text(block.text)
            if block.kind == "python":
                text = block.text
                for pattern, short in SHORT.items() if path.stem == "python" else ():
                    text = re.sub(pattern, short, text)
                code = tmp_path / f"line_{block.line}.py"  # kernels are compiled from their file
                code.write_text("\n" * block.line + text)
                exec(compile(code.read_text(), code, "exec"), vars(page))
            elif block.kind == "bash":
                run(block.text)
            elif block.kind == "yaml":
                yaml.safe_load(block.text)


def test_the_filter_of_the_page_takes_a_fix_with_correlated_errors():
    """AMCL's errors of x and y are. The information of what was known and of the fix add up."""
    page = {"__name__": "page"}
    exec(next(block.text for block in blocks_of(ROOT / "docs/howto/filter.md") if block.title == "unscented.py"), page)
    tuning, filter_ = turtlebot_gym.FilterTuning(Q=(1e-4,) * 5, R=(0.05, 0.05, 0.1)), Plain(make=page["Unscented"]).filter
    before = filter_.start(SimpleNamespace(odometry=SimpleNamespace(pose=(0.0, 0.0, 0.0))), tuning)
    for xy in (0.0, 0.003):
        R = [[0.01, xy, 0.0], [xy, 0.01, 0.0], [0.0, 0.0, 0.02]]
        after = filter_.fix(before, turtlebot_gym.Pose(0.0, 0.0, 0.0), (0.01, 0.01, 0.02, xy, 0.0, 0.0), tuning)
        known = np.linalg.inv(np.reshape(after.P, (5, 5))[:3, :3])
        assert np.allclose(known, np.diag([20.0, 20.0, 10.0]) + np.linalg.inv(R))


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.stem)
def test_python_blocks_of_every_page_are_valid(path):
    for block in blocks_of(path):
        if block.kind == "python":
            compile("\n" * block.line + block.text, path, "exec")


# The recipes: their files stand beside the package's own.

CONTRIBUTING = ROOT / "CONTRIBUTING.md"
PRELUDE = """
import importlib
for package in {packages!r}:
    name = package.replace("/", ".")
    module = importlib.import_module(name)
    module.__path__.append({root!r} + "/" + package)
for line, text in {blocks!r}:
    exec(compile("\\n" * line + text, {page!r}, "exec"))
"""


def recipe(heading):
    """Return the code blocks below a heading, of which one must assert what the recipe promises."""
    lines = CONTRIBUTING.read_text(encoding="utf-8").splitlines()
    first = lines.index(f"### {heading}") + 1
    after = next((number for number, line in enumerate(lines[first:], first) if line.startswith("### ")), len(lines))
    blocks = [block for block in blocks_of(CONTRIBUTING) if first < block.line <= after]
    assert any("assert " in block.text for block in blocks if not block.title), heading
    return blocks


def test_files_of_recipes_import_what_is_below_them():
    """Otherwise `make check` refuses what the page says."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    layers = next(each["layers"] for each in contracts if each.get("containers") == ["turtlebot_gym"])
    depth = {name: at for at, names in enumerate(layers) for name in names.split(" | ")}
    for title, text in ((block.title, block.text) for block in blocks_of(CONTRIBUTING) if block.title):
        for name in re.findall(r"^from turtlebot_gym\.(\w+)", text, re.MULTILINE):
            assert depth[name] >= depth[title.split("/")[1]], f"{title} imports {name}"


@pytest.mark.parametrize(
    ("headings", "plain"),
    [
        (["A sensor", "A filter"], 1),
        (["A plant"], 1),
        pytest.param(["A sensor", "A filter"], 0, marks=pytest.mark.slow),
    ],
    ids=str,
)
def test_a_recipe_works_to_the_letter(headings, plain, tmp_path):
    """Its files are written, and its other blocks run in one process, in plain Python or compiled."""
    blocks = [block for heading in headings for block in recipe(heading)]
    files = {block.title: block.text for block in blocks if block.title}
    for title, text in files.items():
        (tmp_path / title).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / title).write_text(text, encoding="utf-8")
    packages = sorted({title.rpartition("/")[0] for title in files})
    run = [(block.line, block.text) for block in blocks if not block.title]
    script = PRELUDE.format(packages=packages, root=str(tmp_path), blocks=run, page=str(CONTRIBUTING))
    command, given = [sys.executable, "-W", "error", "-c", script], os.environ | {"TURTLEBOT_GYM_PLAIN": str(plain)}
    done = subprocess.run(command, cwd=ROOT, env=given, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
