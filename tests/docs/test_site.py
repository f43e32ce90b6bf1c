"""The documentation builds without a warning, its links hold, and the names in it exist."""

import io
import json
import re
import runpy
import shlex
import sys
import warnings
from argparse import ArgumentParser
from html.parser import HTMLParser
from importlib import import_module
from itertools import pairwise
from pkgutil import walk_packages
from types import SimpleNamespace
from unittest.mock import patch
from urllib.parse import unquote, urlsplit
from xml.etree import ElementTree

import gymnasium as gym
import pytest
from pages import PAGES, ROOT, blocks_of, parsed

import turtlebot_gym

pytest.importorskip("rclpy", reason="needs the extra [ros]")
pytest.importorskip("stable_baselines3", reason="needs the extra [agents]")

from turtlebot_gym_agents.ids import SHORT
from turtlebot_gym_ros.base.process import Runner
from turtlebot_gym_ros.graph.bringup import parser as bringup_parser
from turtlebot_gym_ros.nodes import NODES, TOOLS, load

LAUNCHES = ROOT / "bridges" / "turtlebot_gym_ros" / "launch"
STORED = json.loads((ROOT / "tests" / "golden" / "api.json").read_text(encoding="utf-8"))
FLAGS = STORED["commands"] | STORED["satellites"]
API = ("turtlebot_gym", "turtlebot_gym_agents", "turtlebot_gym_ros", "turtlebot_gym_lab", "turtlebot_gym_view")


@pytest.fixture(scope="module")
def ros():
    """The ROS reference, as it is made for the site."""
    made = io.StringIO()
    made.close = lambda: None
    with pytest.MonkeyPatch.context() as patched, warnings.catch_warnings(action="ignore"):  # rclpy's parser warns
        patched.setitem(sys.modules, "mkdocs_gen_files", SimpleNamespace(open=lambda path, mode: made))
        patched.chdir(ROOT)
        runpy.run_path("docs/generate/ros.py")
    return made.getvalue()


def check(line, ros):
    """Check the names in a command that cannot be run here, against the code and the reference that is made from it."""

    def known(*names):
        for name in names:
            assert f"`{name}`" in ros, f"{name} is not in the ROS reference"

    words = shlex.split(line, comments=True)
    while words and re.match(r"[A-Z_]+=", words[0]):  # variables of the environment
        words.pop(0)
    match words:
        case []:
            pass
        case ["ros2", "launch", "turtlebot_gym_ros", file, *given]:
            arguments = {argument.get("name") for argument in ElementTree.parse(LAUNCHES / file).iter("arg")}
            assert {argument.partition(":=")[0] for argument in given} <= arguments
        case ["ros2", "service", "call", service, kind, _]:
            known(service, kind)
        case ["ros2", "topic", "pub", "--rate", _, topic, kind, _]:
            known(topic, kind)
        case ["ros2", "run", "teleop_twist_keyboard", "teleop_twist_keyboard", "--ros-args", "-r", remapping, *_]:
            known("/" + remapping.partition(":=")[2])
        case ["python", "-m", "turtlebot_gym_ros", "bringup", *given]:
            assert not bringup_parser().parse_known_args(given)[1]
        case ["python", "-m", "turtlebot_gym_ros", tool, *given] if tool in TOOLS:
            with (
                patch.object(ArgumentParser, "error", side_effect=AssertionError(given)),
                patch.object(Runner, "__init__", side_effect=InterruptedError),
                pytest.raises(InterruptedError),
            ):
                load(tool)(given)
        case ["python", "-m", "turtlebot_gym_ros", node, *given] | ["ros2", "run", "turtlebot_gym_ros", node, *given]:
            further = given[: given.index("--ros-args")] if "--ros-args" in given else given
            assert {node, *further} <= {*NODES}
            options = given[len(further) + 1 :]
            for flag, value in zip(options[::2], options[1::2], strict=True):
                name = value.partition(":=")[0].rpartition(":")[2]
                known(f"/{name}" if flag == "-r" else name)
        case ["ros2", "action", "send_goal", "--feedback", name, kind, _]:
            known(name.lstrip("/"))
            assert kind.partition("/action/")[2]
        case ["ros2", "run", "topic_tools", "delay", topic, _, _]:
            known(f"/{topic}")
        case ["python", example, "--ros-args", "-p", parameter, *_]:
            text = (ROOT / "bridges/turtlebot_gym_ros/examples" / example).read_text()
            assert f"{parameter.partition(':=')[0]}: " in text
        case ["ros2", "bag", "record", *topics]:
            known(*(topic for topic in topics if topic not in ("/tf", "/tf_static")))
        case ["git", "clone", _, folder, "&&", "cd", again, "&&", *then] if folder == again:
            check(shlex.join(then), ros)
        case ["make", target]:
            assert re.search(rf"^{target}:.*##", (ROOT / "Makefile").read_text(), re.MULTILINE)
        case ["turtlebot-gym", command, *given]:
            flags = {word.partition(".")[0] for word in given if word.startswith("--")}
            assert flags <= {flag.removesuffix(".") for flag in FLAGS[command]}
        case ["pixi", "run", task]:
            assert f"{task} = " in (ROOT / "pixi.toml").read_text().partition("[tasks]")[2]
        case ["pixi", "shell"]:
            pass
        case ["tensorboard", "--logdir", "runs"]:
            pass
        case ["wandb", "sync", run]:
            assert run.startswith("runs/offline/wandb/")
        case ["docker", "build", "--tag", "turtlebot-gym", "."]:
            pass
        case ["docker", "run", *rest]:
            check(shlex.join(rest[rest.index("turtlebot-gym") + 1 :]), ros)
        case ["ray", "start", *given]:
            assert {word for word in given if word.startswith("--")} <= {"--head", "--port", "--address"}
        case ["sbatch", "--array=0-31", script, *_]:
            assert (ROOT / script).is_file()
        case ["python", script] if script.startswith("docs/"):
            assert (ROOT / script).is_file()
        case ["pip", "install", where] | ["pip", "install", "-e", where]:
            assert re.fullmatch(r"\.\[\w+\]", where)
            assert re.search(rf"^{where[2:-1]} = \[", (ROOT / "pyproject.toml").read_text(), re.MULTILINE)
        case ["colcon", "build", "--base-paths", path]:
            assert (ROOT / path / "package.xml").is_file()
        case ["source", "install/setup.bash"] | [".", ".venv/bin/activate"]:
            pass
        case _:
            pytest.fail(f"this command is neither run nor checked: {line}")


@pytest.mark.sample(14)
def test_commands_of_the_pages_name_what_exists(page, ros):
    for block in blocks_of(page):
        for line in block.text.replace("\\\n", " ").splitlines():
            if block.kind == "console" or (block.kind == "bash" and line.startswith("turtlebot-gym ")):
                check(line, ros)


@pytest.mark.parametrize(
    "line",
    [
        "ros2 launch turtlebot_gym_ros robot.launch.xml polcy:=bearing",
        "ros2 service call /velocity_controller/enabel std_srvs/srv/SetBool '{data: true}'",
        "ros2 topic pub --rate 10 /emergency std_msgs/msg/Bool '{data: false}'",
        "python -m turtlebot_gym_ros kalman",
        "python -m turtlebot_gym_ros kalman_filter --ros-args -p filtre:=matched",
        "ros2 bag record /odo",
        "python face_east.py --ros-args -p gian:=2.0",
        "make everything",
        "turtlebot-gym train --sedes 3",
        "sbatch --array=0-31 agents/configs/slrum.sh",
        "rosrun turtlebot_gym_ros kalman_filter",
    ],
)
def test_wrong_names_are_noticed(line, ros):
    with pytest.raises((AssertionError, pytest.fail.Exception)):
        check(line, ros)


class Html(HTMLParser):
    """What a page refers to, and what in it can be referred to."""

    def __init__(self, path):
        super().__init__()
        self.links, self.loads, self.ids = [], [], set()
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        self.ids |= {given[name] for name in ("id", "name") if given.get(name)}
        if tag == "a" and given.get("href"):
            self.links.append(given["href"])
        elif given.get("src") or (tag == "link" and given.get("href")):
            self.loads.append(given.get("src") or given["href"])


@pytest.mark.nightly
def test_links_and_figures_of_the_site_exist(site):
    pages = {path: Html(path) for path in site.rglob("*.html")}
    for path, html in pages.items():
        for target in {*html.links, *html.loads}:
            parts = urlsplit(target)
            if parts.scheme or path.name == "404.html":
                continue
            there = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            assert there.exists(), f"{path.relative_to(site)}: {target}"
            assert not parts.fragment or there.suffix != ".html" or parts.fragment in pages[there].ids, f"{path.name}: {target}"


@pytest.mark.nightly
def test_the_site_needs_no_network(site):
    for path in site.rglob("*.html"):
        assert not [target for target in Html(path).loads if urlsplit(target).scheme not in ("", "data")], path


@pytest.mark.nightly
def test_formulas_are_mathml(site):
    page = (site / "concepts" / "belief.html").read_text(encoding="utf-8")
    assert page.count("<math ") > 5
    assert not [path for path in site.rglob("*.html") if 'class="arithmatex"' in path.read_text(encoding="utf-8")]


@pytest.mark.nightly
def test_the_reference_is_complete(site):
    html = {path.stem: Html(path).ids for path in (site / "reference").glob("*.html")}
    assert {name for name in NODES if name not in ("bringup", "status")} <= html["ros"]
    assert {f"turtlebot-gym-{name}" for name in FLAGS} <= html["commands"]
    presets = (site / "reference" / "presets.html").read_text()
    assert all(f"<code>{name}</code>" in presets for name in turtlebot_gym.NOISES)
    environments = (site / "reference" / "environments.html").read_text()
    assert all(f"<code>turtlebot_gym/TurtleBot{name}-v0</code>" in environments for name in ("Nav", "Pose", "Square"))
    assert "turtlebot_gym.estimation.update.update" in html["turtlebot_gym.estimation.update"]
    assert "turtlebot_gym.tasks.Task" in html["turtlebot_gym.tasks"]
    modules = {module.name for package in API for module in walk_packages(import_module(package).__path__, f"{package}.")}
    undescribed = {name for name in modules if not any(name in ids for ids in html.values())}
    assert all(name.endswith("__main__") for name in undescribed), undescribed


SECTIONS = "Description Action-Space Observation-Space Rewards Starting-State Episode-End Arguments Version-History".lower()


@pytest.mark.nightly
@pytest.mark.parametrize("name", SHORT.values())
def test_each_environment_has_a_page_in_gymnasiums_form(name, site):
    env, spec = gym.make(name).unwrapped, gym.spec(name)
    path = site / "reference" / f"{spec.name}.html"
    html, text = Html(path), path.read_text(encoding="utf-8")
    assert {*SECTIONS.split()} <= html.ids
    assert re.search(rf"{spec.name}\.(png|gif)", " ".join(html.loads))
    assert f"Box(({env.observation_space.shape[0]},), float32)" in text
    assert all(f"<code>{term}</code>" in text for term in (*env.reward_terms, *(term.name for term in env.observation_terms)))
    assert f"after {spec.max_episode_steps} steps" in text
    env.close()


@pytest.mark.nightly
def test_the_release_notes_are_the_changelog(site):
    html = (site / "releases.html").read_text(encoding="utf-8")
    entries = [token for token in parsed(ROOT / "CHANGELOG.md") if token.type == "list_item_open"]
    assert len(entries) > 10
    assert html.count("<li>") >= len(entries)
    assert "Release notes" in html
    assert 'href="howto/fix.html"' in html


def anchors_of(path):
    """Return the names of a file's headings, as Markdown makes them of their words."""
    tokens = parsed(path)
    headings = [after.content for token, after in pairwise(tokens) if token.type == "heading_open"]
    return {re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", heading.partition(" {")[0]).strip().lower()) for heading in headings}


def is_made(target):
    """Return whether a target is made for the site: by the scripts of ``docs/generate``, or of a notebook."""
    return "reference/" in target or target == "releases.md" or target.endswith((".svg", ".ipynb"))


FILES = [*PAGES, *(ROOT / name for name in ("CONTRIBUTING.md", "CHANGELOG.md", "agents/pretrained/README.md"))]


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_links_between_files_exist(path):
    inline = [child for token in parsed(path) for child in token.children or ()]
    for target in [str(value) for child in inline for name, value in child.attrs.items() if name in ("href", "src")]:
        name, _, anchor = target.partition("#")
        if urlsplit(target).scheme or is_made(name):
            continue
        there = path.parent / name if name else path
        assert there.exists(), target
        assert not anchor or there.suffix != ".md" or anchor in anchors_of(there), target
