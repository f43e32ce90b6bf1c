"""Satellites stand beside the product: it imports none, and works in a copy of the repository from which they are deleted."""

import ast
import os
import re
import shutil
import subprocess
import sys
import zipfile
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

import pytest
import tomllib
from pages import ROOT

pytest.importorskip("stable_baselines3", reason="needs the extra [agents]")

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
SATELLITES = {
    "turtlebot_gym_lab": ("lab/turtlebot_gym_lab", "tests/lab"),
    "turtlebot_gym_view": ("lab/turtlebot_gym_view", "tests/view"),
    "cmd_vel_guard": ("bridges/cmd_vel_guard", "tests/guard"),
}
"""Packages with what is deleted with them."""
HERE = [name for name, (folder, _) in SATELLITES.items() if (ROOT / folder).is_dir()]
OWN = tuple(name for name in HERE if name.startswith("turtlebot_gym_"))
TESTS = ("agents", "bridges", "core", "fuzz", "golden", "localization", "plants", "rooms")
"""Folders of the product's tests; those of pages, benchmarks, browser and notebooks are about all there is."""
QUICK = (
    "core/test_drive.py",
    "core/test_file_access.py",
    "core/test_models.py",
    "core/test_tasks.py",
    "agents/test_outputs.py",
)
ELSEWHERE = "not slow and not nightly and not clients and not cluster and not browser"
IN_PARALLEL = ("-n", "3", "--dist", "loadfile", "--no-loadscope-reorder")
"""As in the Makefile."""


def imported(path):
    """Return the packages that a module imports."""
    nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    names = [alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names]
    names += [node.module or "" for node in nodes if isinstance(node, ast.ImportFrom)]
    return {name.partition(".")[0] for name in names}


@pytest.mark.parametrize("folder", TESTS)
def test_the_products_tests_import_no_satellite(folder):
    paths = sorted((ROOT / "tests" / folder).rglob("*.py"))
    assert paths
    assert [path.name for path in paths if imported(path) & set(OWN)] == []


def test_the_wheel_holds_the_satellites_with_their_pages_and_styles(tmp_path):
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(tmp_path)]
    subprocess.run(build, cwd=ROOT, check=True, capture_output=True)
    (wheel,) = tmp_path.glob("*.whl")
    names = set(zipfile.ZipFile(wheel).namelist())
    for package in OWN:
        top = ROOT / SATELLITES[package][0]
        files = {
            str(path.relative_to(top.parent)) for path in top.rglob("*") if path.is_file() and "__pycache__" not in path.parts
        }
        assert files == {name for name in names if name.startswith(f"{package}/")}


class Copy(NamedTuple):
    """A copy of the repository."""

    root: Path
    missing: tuple[str, ...]
    """The packages that are not there."""
    environment: dict[str, str]

    def run(self, *words, patience=120.0):
        """Run Python in it."""
        command = [sys.executable, *words]
        return subprocess.run(command, cwd=self.root, env=self.environment, capture_output=True, text=True, timeout=patience)

    def said(self, *words):
        """Run a command that is refused, and return its one line."""
        done = self.run("-m", *words)
        assert (done.returncode, done.stdout) == (2, "")
        (line,) = done.stderr.splitlines()
        return line


FORGET = """
import os, sys
sys.path[:] = [path for path in sys.path if not any(os.path.isdir(os.path.join(path, name)) for name in {packages!r})]
"""
"""Run by Python at its start: an editable installation would bring the deleted packages back, from the repository itself."""
EACH = [pytest.param((name,), marks=pytest.mark.nightly, id=name) for name in HERE]


@pytest.fixture(scope="module", params=[pytest.param(tuple(HERE), id="all"), *EACH])
def copy(request, tmp_path_factory):
    """The repository without satellites, which the metadata of the installed package still names."""
    folder, gone = tmp_path_factory.mktemp("without"), [path for name in request.param for path in SATELLITES[name]]
    root, metadata = folder / "copy", folder / "path" / "turtlebot_gym-0.dist-info"
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True)
    if listed.returncode:
        pytest.skip("needs the repository")
    for name in filter(None, listed.stdout.split("\0")):
        if (ROOT / name).is_file() and not any(name.startswith(f"{path}/") for path in gone):
            (root / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, root / name)
    metadata.mkdir(parents=True)
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: turtlebot-gym\nVersion: 0\n")
    lines = []
    for group, points in PROJECT["entry-points"].items():
        lines += [f"[{group}]", *(f"{name} = {target}" for name, target in points.items())]
    (metadata / "entry_points.txt").write_text("\n".join(lines) + "\n")
    (folder / "path" / "sitecustomize.py").write_text(FORGET.format(packages=request.param))
    parts = (".", "agents", "bridges/turtlebot_gym_ros", "bridges/cmd_vel_guard", "lab")
    paths = [str(folder / "path"), *(str(root / part) for part in parts)]
    return Copy(root, request.param, {**os.environ, "PYTHONPATH": os.pathsep.join(paths)})


IMPORT_ALL = """
import importlib, pkgutil, sys
for package in sys.argv[1:]:
    module = importlib.import_module(package)
    assert module.__file__.startswith(str(__import__("pathlib").Path.cwd())), module.__file__
    for found in pkgutil.walk_packages(module.__path__, f"{package}."):
        if not found.name.endswith("__main__"):
            importlib.import_module(found.name)
"""


@pytest.mark.nightly
def test_every_module_of_the_product_is_imported_without_it(copy):
    packages = ["turtlebot_gym", "turtlebot_gym_agents", *(["turtlebot_gym_ros"] if find_spec("rclpy") else [])]
    done = copy.run("-c", IMPORT_ALL, *packages)
    assert done.returncode == 0, done.stderr


def test_its_commands_are_left_out_of_the_help_and_say_what_to_install(copy):
    done = copy.run("-m", "turtlebot_gym", "--help")
    assert done.returncode == 0, done.stderr
    listed = re.findall(r"^  ([a-z]+) ", done.stdout, re.MULTILINE)
    assert "train" in listed
    for package in copy.missing:
        extra = package.removeprefix("turtlebot_gym_")
        for name, target in PROJECT["entry-points"]["turtlebot_gym.commands"].items():
            if target.startswith(package):
                assert name not in listed
                remedy = f"pip install 'turtlebot-gym[{extra}]' (No module named '{package}')."
                assert copy.said("turtlebot_gym", name) == f"turtlebot-gym: {name} needs the extra [{extra}]: {remedy}"
                break


@pytest.mark.nightly
def test_quick_tests_of_the_product_pass_without_all_satellites(copy):
    if len(copy.missing) == 1:
        pytest.skip("the nightly test runs all tests without each")
    paths = [f"tests/{name}" for name in QUICK]
    done = copy.run("-m", "pytest", "-q", "-p", "no:cacheprovider", "-x", "-m", ELSEWHERE, *paths)
    assert done.returncode == 0, done.stdout


@pytest.mark.nightly
def test_all_tests_of_the_product_pass_without_it(copy):
    if len(copy.missing) > 1:
        pytest.skip("without each alone")
    paths = [f"tests/{name}" for name in TESTS]
    done = copy.run("-m", "pytest", "-q", "-p", "no:cacheprovider", *IN_PARALLEL, "-m", ELSEWHERE, *paths, patience=3600.0)
    assert done.returncode == 0, done.stdout
