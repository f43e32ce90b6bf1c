"""What is around the code: metadata, templates, container file and make targets agree with the code and with each other."""

import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest
import yaml

import turtlebot_gym

tomllib = pytest.importorskip("tomllib", reason="needs Python 3.11")

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
CI = yaml.safe_load((ROOT / ".github" / "workflows" / "ci.yml").read_text(encoding="utf-8"))
PACKAGES = ("turtlebot_gym", "agents/turtlebot_gym_agents", "bridges/turtlebot_gym_ros/turtlebot_gym_ros")


@pytest.mark.parametrize("package", PACKAGES)
def test_type_checkers_may_read_the_packages(package):
    assert (ROOT / package / "py.typed").is_file()


def test_the_version_is_the_same_everywhere():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert turtlebot_gym.__version__ == PROJECT["version"] == citation["version"]
    assert citation["cff-version"] == "1.2.0"
    assert {"message", "title", "authors", "type", "license"} <= set(citation)
    assert citation["license"] == PROJECT["license"]
    assert [author["name"] for author in citation["authors"]] == [author["name"] for author in PROJECT["authors"]]


@pytest.mark.skipif(find_spec("tyro") is None, reason="needs the extra [gym]")
@pytest.mark.parametrize("module", ["turtlebot_gym_agents", "turtlebot_gym_ros"])
def test_the_commands_tell_their_version(module):
    if module == "turtlebot_gym_ros" and find_spec("rclpy") is None:
        pytest.skip("needs the extra [ros]")
    done = subprocess.run([sys.executable, "-m", module, "--version"], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout) == (0, f"turtlebot-gym {PROJECT['version']}\n")


def test_classifiers_are_known_and_name_the_versions_that_are_tested():
    if find_spec("trove_classifiers"):  # as hatchling brings it
        from trove_classifiers import classifiers

        assert set(PROJECT["classifiers"]) <= set(classifiers)
    versions = {match[1] for line in PROJECT["classifiers"] if (match := re.fullmatch(r".*Python :: (3\.\d+)", line))}
    assert versions == set(CI["jobs"]["test"]["strategy"]["matrix"]["python"])


def test_the_checker_depends_on_gymnasium_and_numpy_only():
    folder = ROOT / "checker"
    project = tomllib.loads((folder / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert {re.split("[<>=]", dependency)[0] for dependency in project["dependencies"]} == {"gymnasium", "numpy"}
    assert project["license"] == PROJECT["license"]
    package = folder / "gymnasium_vector_checker"
    assert (package / "py.typed").is_file()
    imported = {
        match[1]
        for path in package.glob("*.py")
        for match in re.finditer(r"^(?:from|import) (\w+)", path.read_text(encoding="utf-8"), re.MULTILINE)
    }
    assert imported - set(sys.stdlib_module_names) == {"gymnasium", "numpy", package.name}


def targets():
    """Return the explanation of each target of the Makefile."""
    text = (ROOT / "Makefile").read_text(encoding="utf-8")
    return dict(re.findall(r"^([a-z-]+):.*?## (.*)$", text, re.MULTILINE)), {*re.findall(r"^([a-z-]+):", text, re.MULTILINE)}


def test_make_explains_each_target_in_80_columns():
    explained, every = targets()
    assert set(explained) == every
    for words in ([], ["help"]):
        command = ["make", "--no-print-directory", *words]  # which make prints below another make
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=60)
        assert done.returncode == 0
        listed = done.stdout.splitlines()
        assert max(map(len, listed[:-1])) <= 80
        for target, text in explained.items():
            assert re.search(rf"^  {target} .*{re.escape(text.split()[0])}", done.stdout, re.MULTILINE), target
        assert listed[-1].startswith("Variables: ")


def test_what_runs_elsewhere_calls_targets_that_exist():
    _, every = targets()
    hooks = (ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8")
    steps = [step["run"] for job in CI["jobs"].values() for step in job["steps"] if "run" in step]
    made = [line.partition("#")[0].partition("=")[0].split()[1:] for line in steps if line.startswith("make ")]
    called = [word for words in made for word in words if re.fullmatch(r"[a-z-]+", word)]
    assert {"docs", "build", "demo", "image"} <= set(called) <= every
    assert "make check test" in (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    assert any(".ci/run" in step for step in steps)
    assert "entry: make check" in hooks


def test_hooks_before_a_commit_are_a_part_of_make_check():
    hooks = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8"))["repos"][0]["hooks"]
    recipe = (ROOT / "Makefile").read_text(encoding="utf-8").partition("\ncheck:")[2].partition("\n\n")[0]
    for hook in hooks:
        if "stages" not in hook:
            assert hook["entry"].replace(".venv/bin/", "$(RUN)") in recipe


def test_the_container_file_copies_and_installs_what_there_is():
    text = (ROOT / "Dockerfile").read_text(encoding="utf-8")
    (extras,) = re.findall(r"pip install .*'\.\[(.*)\]'", text)
    assert set(extras.split(",")) <= set(PROJECT["optional-dependencies"])
    sent = [line[1:] for line in (ROOT / ".dockerignore").read_text(encoding="utf-8").splitlines() if line.startswith("!")]
    assert all((ROOT / name).exists() for name in sent)
    assert {"pyproject.toml", "constraints.txt", "README.md", "LICENSE", "turtlebot_gym", "agents", "bridges"} <= set(sent)


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
