"""Other people's libraries, run for real: each script of docs/howto/libraries, in an environment of its own.

`environments.py` makes the environments of the tests that are marked ``slow``; the others are quick.
"""

import json
import os
import re
import secrets
import subprocess
import sys
from pathlib import Path

import pytest
from markdown_it import MarkdownIt

tomllib = pytest.importorskip("tomllib", reason="needs Python 3.11")
HERE = Path(__file__).parent
ROOT = HERE.parents[1]
PAGE = ROOT / "docs" / "howto" / "libraries.md"
ENVIRONMENTS = ROOT / ".venv-clients"
CLIENTS = tomllib.loads((HERE / "clients.toml").read_text(encoding="utf-8"))
SUCCESS = 0.9
"""Share of episodes that those with ``must_succeed`` have to reach."""
EPISODES, SEED = 1000, 3_000_000
"""Of the evaluation; the scripts train on other seeds."""


def scripts():
    """Return the scripts by the name of their file: those of the folder, and those on the page."""
    fences = [token for token in MarkdownIt("commonmark").parse(PAGE.read_text(encoding="utf-8")) if token.type == "fence"]
    titled = [(re.search(r'title="(.*)"', token.info), token.content) for token in fences]
    files = {path.name: path.read_text(encoding="utf-8") for path in PAGE.with_suffix("").iterdir() if path.is_file()}
    return files | {title[1]: content for title, content in titled if title}


def python_of(environment):
    path = ENVIRONMENTS / environment / "bin" / "python"
    if not path.exists():
        pytest.skip(f"there is no environment {environment}: python tests/clients/environments.py .venv-clients")
    return path


def train(file, python):
    """Run a script in its folder."""
    path = f"{python.parent}:{os.environ['PATH']}"
    env = {"PATH": path, "OMP_NUM_THREADS": "1", "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER": "0", "RAY_USAGE_STATS_ENABLED": "0"}
    # Ray: on localhost only, and for this run only.
    env |= {"RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN": secrets.token_hex(32)}
    done = subprocess.run([python, file.name], cwd=file.parent, env=os.environ | env, capture_output=True, text=True)
    assert done.returncode == 0, f"{done.stdout[-2000:]}\n{done.stderr[-4000:]}"


def drive(bundle):
    """Return the success of a bundle, driven by the command line from this package's own environment."""
    report = bundle.with_name("evaluation.json")
    command = [sys.executable, "-m", "turtlebot_gym_agents", "evaluate", "--policy", str(bundle), "--json", str(report)]
    options = ["--episodes", str(EPISODES), "--seed", str(SEED)]
    done = subprocess.run([*command, *options], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return json.loads(report.read_text())["runs"][0]["summary"]["success"]


@pytest.mark.slow
@pytest.mark.parametrize("name", CLIENTS)
def test_a_library_trains_and_its_policy_drives(name, tmp_path):
    client = CLIENTS[name]
    title = next(title for title in scripts() if Path(title).stem == name)
    (tmp_path / title).write_text(scripts()[title])
    train(tmp_path / title, python_of(client["environment"]))
    success = drive(tmp_path / "nav.onnx")
    assert not client.get("must_succeed") or success["value"] >= SUCCESS


def test_each_script_of_the_page_is_run_and_each_client_has_one():
    assert {Path(title).stem for title in scripts()} == set(CLIENTS)
    page = PAGE.read_text(encoding="utf-8")
    assert all(f"]({path.parent.name}/{path.name})" in page for path in PAGE.with_suffix("").iterdir() if path.is_file())
    required = {file.stem for file in (HERE / "requirements").glob("*.txt")}
    assert {client["environment"] for client in CLIENTS.values()} == required
