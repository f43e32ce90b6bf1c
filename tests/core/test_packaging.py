"""What is around the code: metadata, templates, container file and make targets agree with the code and with each other."""

import json
import os
import re
import signal
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace

import pytest
import yaml

import turtlebot_gym
from turtlebot_gym import extras

tomllib = pytest.importorskip("tomllib", reason="needs Python 3.11")
ROOT = Path(__file__).parents[2]


def text_of(name):
    return (ROOT / name).read_text(encoding="utf-8")


PROJECT = tomllib.loads(text_of("pyproject.toml"))["project"]
CI = yaml.safe_load(text_of(".github/workflows/ci.yml"))
PACKAGES = ("turtlebot_gym", "agents/turtlebot_gym_agents", "bridges/turtlebot_gym_ros/turtlebot_gym_ros")
SATELLITES = [top for top in ("lab/turtlebot_gym_lab", "lab/turtlebot_gym_view") if (ROOT / top).is_dir()]


def test_the_version_is_the_same_everywhere_and_type_checkers_may_read_the_packages():
    citation = yaml.safe_load(text_of("CITATION.cff"))
    newest = re.search(r"^## (\S+), (\S+)$", text_of("CHANGELOG.md"), re.MULTILINE)
    assert newest
    assert turtlebot_gym.__version__ == citation["version"] == newest[1]
    assert newest[2] in ("unreleased", str(citation["date-released"]))
    assert f"version = {{{newest[1]}}}" in text_of("docs/faq.md")
    assert citation["cff-version"] == "1.2.0"
    assert {"message", "title", "authors", "type", "license"} <= set(citation)
    assert citation["license"] == PROJECT["license"]
    assert [author["name"] for author in citation["authors"]] == [author["name"] for author in PROJECT["authors"]]
    assert all((ROOT / package / "py.typed").is_file() for package in (*PACKAGES, *SATELLITES))


@pytest.mark.skipif(find_spec("tyro") is None, reason="needs the extra [gym]")
@pytest.mark.parametrize("module", ["turtlebot_gym_agents", "turtlebot_gym_ros"])
def test_the_commands_tell_their_version(module):
    if module == "turtlebot_gym_ros" and find_spec("rclpy") is None:
        pytest.skip("needs the extra [ros]")
    done = subprocess.run([sys.executable, "-m", module, "--version"], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout) == (0, f"turtlebot-gym {turtlebot_gym.__version__}\n")


@pytest.mark.parametrize(
    ("noted", "command"),
    [
        (None, "pip install 'turtlebot-gym[gym]'"),
        ({"url": "file:///a%20b", "dir_info": {"editable": True}}, "pip install -e '/a b[gym]'"),
        ({"url": "file:///a", "dir_info": {}}, "pip install 'turtlebot-gym[gym] @ file:///a'"),
        ({"url": "file:///a.whl", "archive_info": {}}, "pip install 'turtlebot-gym[gym] @ file:///a.whl'"),
        ({"url": "https://a/b", "vcs_info": {"vcs": "git"}}, "pip install 'turtlebot-gym[gym] @ git+https://a/b'"),
    ],
)
def test_an_extra_is_installed_from_where_the_package_came(noted, command, monkeypatch):
    text = None if noted is None else json.dumps(noted)
    monkeypatch.setattr(extras, "distribution", lambda name: SimpleNamespace(read_text=lambda file: text))
    assert extras.installing("gym") == command


@pytest.mark.sample(1)
@pytest.mark.skipif(find_spec("tyro") is None, reason="needs the extra [gym]")
@pytest.mark.parametrize("asked", ["turtlebot_gym evaluate --episodes 2", "turtlebot_gym --help", "turtlebot_gym_ros --help"])
def test_a_command_ends_quietly_if_nobody_reads_on(asked):
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run([sys.executable, "-m", *asked.split()], stdout=write, stderr=subprocess.PIPE, text=True, timeout=120)
    os.close(write)
    assert done.stderr == ""
    assert done.returncode in (1, 128 + signal.SIGPIPE)  # 1 if rich, which prints tables, noticed it


def test_pixi_brings_the_ros_packages_that_the_bridge_names_and_extras_that_exist():
    pixi = tomllib.loads(text_of("pixi.toml"))
    needed = re.findall(r"<exec_depend>(.*)</exec_depend>", text_of("bridges/turtlebot_gym_ros/package.xml"))
    needed = [name for name in needed if name != "cmd_vel_guard" and not name.startswith("python3-")]  # pip installs the guard
    ros = {f"ros-jazzy-{name.replace('_', '-')}" for name in needed}
    assert ros | {"ros-jazzy-rmw-fastrtps-cpp", "python", "pip"} == set(pixi["dependencies"])
    assert set(pixi["pypi-dependencies"]["turtlebot-gym"]["extras"]) <= set(PROJECT["optional-dependencies"])


def test_classifiers_are_known_and_name_the_versions_that_are_tested():
    if find_spec("trove_classifiers"):  # as hatchling brings it
        from trove_classifiers import classifiers

        assert set(PROJECT["classifiers"]) <= set(classifiers)
    versions = {match[1] for line in PROJECT["classifiers"] if (match := re.fullmatch(r".*Python :: (3\.\d+)", line))}
    assert versions == set(CI["jobs"]["test"]["strategy"]["matrix"]["python"])


TARGETS = {*re.findall(r"^([a-z-]+):", text_of("Makefile"), re.MULTILINE)}


@pytest.mark.parametrize("words", [[], ["help"]], ids=str)
def test_make_explains_each_target_in_80_columns(words):
    explained = dict(re.findall(r"^([a-z-]+):.*?## (.*)$", text_of("Makefile"), re.MULTILINE))
    assert set(explained) == TARGETS
    command = ["make", "--no-print-directory", *words]  # which make prints below another make
    shown = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=60, check=True).stdout
    *listed, last = shown.splitlines()
    assert max(map(len, listed)) <= 80
    for target, text in explained.items():
        assert re.search(rf"^  {target} .*{re.escape(text.split()[0])}", shown, re.MULTILINE), target
    assert last.startswith("Variables: ")


def test_what_runs_elsewhere_calls_targets_that_exist():
    steps = [step["run"] for job in CI["jobs"].values() for step in job["steps"] if "run" in step]
    made = [
        line.partition("#")[0].partition("=")[0].partition("&&")[0].split()[1:] for line in steps if line.startswith("make ")
    ]
    called = [word for words in made for word in words if re.fullmatch(r"[a-z-]+", word)]
    assert {"demo", "test-browser"} <= set(called) <= TARGETS
    assert "make check test" in text_of(".ci/run")
    assert any(".ci/run" in step for step in steps)


def test_hooks_before_a_commit_are_a_part_of_make_check():
    text = text_of(".pre-commit-config.yaml")
    assert "entry: make check" in text
    recipe = text_of("Makefile").partition("\ncheck:")[2].partition("\n\n")[0]
    for hook in yaml.safe_load(text)["repos"][0]["hooks"]:
        assert "stages" in hook or hook["entry"].replace(".venv/bin/", "$(RUN)") in recipe


def test_the_container_file_copies_and_installs_what_there_is():
    (extras,) = re.findall(r"pip install .*'\.\[(.*)\]'", text_of("Dockerfile"))
    assert set(extras.split(",")) <= set(PROJECT["optional-dependencies"])
    sent = [line[1:] for line in text_of(".dockerignore").splitlines() if line.startswith("!")]
    assert all((ROOT / name).exists() for name in sent)
    assert {
        "pyproject.toml",
        "constraints.txt",
        "README.md",
        "LICENSE",
        "turtlebot_gym",
        "agents",
        "bridges",
    } <= set(sent)


@pytest.mark.parametrize("path", sorted((ROOT / ".github" / "ISSUE_TEMPLATE").glob("*.yml")), ids=lambda path: path.stem)
def test_templates_are_forms(path):
    form = yaml.safe_load(path.read_text(encoding="utf-8"))
    if path.stem == "config":
        assert form["blank_issues_enabled"] is True
        return
    assert {"name", "description", "body"} <= set(form)
    for part in form["body"]:
        assert part["type"] == "textarea"
        assert {"id", "attributes"} <= set(part)
        assert part["attributes"]["label"]
