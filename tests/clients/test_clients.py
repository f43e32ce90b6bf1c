"""Other people's libraries, run for real: each script of docs/howto/libraries, in an environment of its own.

`environments.py` makes the environments of the tests that are marked ``slow``; the others are quick.
"""

import json
import math
import os
import re
import resource
import secrets
import subprocess
import sys
import time
from importlib import util
from pathlib import Path

import pytest
from markdown_it import MarkdownIt

from turtlebot_gym_agents.provenance import write_json

tomllib = pytest.importorskip("tomllib", reason="needs Python 3.11")
HERE = Path(__file__).parent
ROOT = HERE.parents[1]
PAGE = ROOT / "docs" / "howto" / "libraries.md"
ENVIRONMENTS = ROOT / ".venv-clients"
CLIENTS = tomllib.loads((HERE / "clients.toml").read_text(encoding="utf-8"))
STEPS = 20_000
"""Each library trains at least so many steps."""
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


def progress(output):
    """Return steps and losses that a script prints, in lines of its own or in Stable-Baselines3's table."""
    lines = [(int(steps), float(loss)) for steps, loss in re.findall(r"^(\d+) steps, loss (\S+)$", output, re.MULTILINE)]
    steps, losses = (re.findall(rf"\| +{name} +\| +(\S+) +\|", output) for name in ("total_timesteps", "loss"))
    return lines or list(zip(map(int, steps[len(steps) - len(losses) :]), map(float, losses), strict=True))


def python_of(environment):
    path = ENVIRONMENTS / environment / "bin" / "python"
    if not path.exists():
        pytest.skip(f"there is no environment {environment}: python tests/clients/environments.py .venv-clients")
    return path


def versions(python, packages):
    code = f"import importlib.metadata as m, json; print(json.dumps({{p: m.version(p) for p in {packages!r}}}))"
    return json.loads(subprocess.run([python, "-c", code], capture_output=True, text=True, check=True).stdout)


def train(file, python):
    """Run a script in its folder; return steps and losses, seconds and CPU seconds, its own and its children's."""
    path = f"{python.parent}:{os.environ['PATH']}"
    env = {"PATH": path, "OMP_NUM_THREADS": "1", "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER": "0", "RAY_USAGE_STATS_ENABLED": "0"}
    # Ray: on localhost only, and for this run only.
    env |= {"RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN": secrets.token_hex(32)}
    command = [python, file.name]
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run(command, cwd=file.parent, env=os.environ | env, capture_output=True, text=True)
    after, seconds = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter() - start
    assert done.returncode == 0, f"{done.stdout[-2000:]}\n{done.stderr[-4000:]}"
    return progress(done.stdout), seconds, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def drive(bundle):
    """Return the success of a bundle, driven by the command line from this package's own environment."""
    report = bundle.with_name("evaluation.json")
    command = [sys.executable, "-m", "turtlebot_gym_agents", "evaluate", "--policy", str(bundle), "--json", str(report)]
    options = ["--episodes", str(EPISODES), "--seed", str(SEED)]
    done = subprocess.run([*command, *options], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return json.loads(report.read_text())["runs"][0]["summary"]["success"]


@pytest.fixture(scope="module")
def results(pytestconfig):
    """Results by client; those that were measured are written where ``--clients-json`` says, beside those that are there."""
    measured = {}
    yield measured
    path = pytestconfig.getoption("clients_json")
    if path is not None and measured:
        earlier = json.loads(path.read_text(encoding="utf-8"))["clients"] if path.is_file() else {}
        every = {name: measured.get(name, earlier.get(name)) for name in CLIENTS}
        available = {name: result for name, result in every.items() if result is not None}
        write_json(path, {"clients": available}, config={"episodes": EPISODES, "seed": SEED})


@pytest.mark.slow
@pytest.mark.parametrize("name", CLIENTS)
def test_a_library_trains_and_its_policy_drives(name, results, tmp_path):
    client = CLIENTS[name]
    python = python_of(client["environment"])
    title = next(title for title in scripts() if Path(title).stem == name)
    (tmp_path / title).write_text(scripts()[title])
    logged, seconds, cpu = train(tmp_path / title, python)
    steps, losses = zip(*logged, strict=True)
    assert all(map(math.isfinite, losses))
    assert steps[-1] >= STEPS
    results[name] = {
        "library": client["library"],
        "versions": versions(python, client["packages"]),
        "steps": steps[-1],
        "loss": losses[-1],
        "seconds": round(seconds, 1),
        "cpu_seconds": round(cpu, 1),
        "success": None,
    }
    if client.get("bundle", True):
        results[name]["success"] = success = drive(tmp_path / "nav.onnx")
        assert not client.get("must_succeed") or success["value"] >= SUCCESS


def test_each_script_of_the_page_is_run_and_each_client_has_one():
    assert {Path(title).stem for title in scripts()} == set(CLIENTS)
    page = PAGE.read_text(encoding="utf-8")
    assert all(f"]({path.parent.name}/{path.name})" in page for path in PAGE.with_suffix("").iterdir() if path.is_file())
    required = {file.stem for file in (HERE / "requirements").glob("*.txt")}
    assert {client["environment"] for client in CLIENTS.values()} == required


def test_losses_are_read_in_both_forms_and_none_is_overlooked():
    assert progress("made\n2048 steps, loss 0.5\n4096 steps, loss nan\n")[-1][0] == 4096
    assert math.isnan(progress("2048 steps, loss 0.5\n4096 steps, loss nan\n")[-1][1])
    table = "|    total_timesteps      | 2048  |\n|    total_timesteps      | 4096  |\n|    loss                 | 0.25  |\n"
    assert progress(table) == [(4096, 0.25)]  # the first table of a training has no loss yet
    assert progress("nothing") == []


@pytest.fixture
def environments():
    spec = util.spec_from_file_location("clients_environments", HERE / "environments.py")
    module = util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_an_environments_own_pins_go_before_the_shared_ones(environments):
    pinned = "# versions\ntorch==2\nPy_Yaml==6; python_version < '4'\ngymnasium==1.4.0\n"
    own = "# a note\nray[rllib]==2\ngymnasium==1.2.2  # why\npy-yaml==5\n"
    assert environments.constraints(own, pinned) == "# versions\ntorch==2\n"


def test_requirements_are_pinned(environments):
    assert environments.names() == ["rllib", "torch"]
    for file in (HERE / "requirements").glob("*.txt"):
        lines = [line.partition("  #")[0] for line in file.read_text().splitlines() if not line.startswith("#")]
        assert lines
        assert all(re.fullmatch(r"[\w.-]+(\[\w+\])?==[\w.]+", line) for line in lines)
