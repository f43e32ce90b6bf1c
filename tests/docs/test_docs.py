"""The documentation: each code block in it and in the README is run or checked, it builds without a warning, links hold."""

import json
import os
import re
import shlex
import subprocess
import sys
from dataclasses import fields
from html.parser import HTMLParser
from importlib import import_module
from pathlib import Path
from pkgutil import walk_packages
from typing import NamedTuple
from unittest.mock import patch
from urllib.parse import unquote, urlsplit
from xml.etree import ElementTree

import gymnasium as gym
import pytest
import tomllib
import yaml
from markdown_it import MarkdownIt

import turtlebot_gym

pytest.importorskip("rclpy", reason="needs the extra [ros]")
pytest.importorskip("stable_baselines3", reason="needs the extra [agents]")

from turtlebot_gym_agents.commands.cli import COMMANDS
from turtlebot_gym_ros.nodes import NODES

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
LAUNCHES = ROOT / "bridges" / "turtlebot_gym_ros" / "launch"
API = ("turtlebot_gym", "turtlebot_gym_agents", "turtlebot_gym_ros")
KINDS = ("python", "bash", "yaml", "console", "text")
"""Languages of code blocks. Python and bash are run, YAML is read, of a console the names are checked, text is only shown."""
QUICK = {
    "evaluate": {"episodes": "5"},
    "estimate": {"runs": "20"},
    "replay": {"seeds": "2"},
    "train": {"steps": "2048", "evaluations": "1"},
    "tune": {"steps": "2048", "trials": "1"},
    "tune-baseline": {"tries": "2", "episodes": "20"},
    "bringup": {"duration": "3"},
}
"""Options that make the commands of the pages short; all others are left as they stand."""


CLIENTS = tomllib.loads((ROOT / "tests" / "clients" / "clients.toml").read_text(encoding="utf-8"))
"""Scripts that `make test-clients` runs, in environments that have their libraries."""


class Block(NamedTuple):
    kind: str
    title: str
    text: str
    line: int


def parsed(path):
    return MarkdownIt("commonmark").enable("table").parse(path.read_text(encoding="utf-8"))


def blocks_of(path):
    """Return the code blocks of a page; a title is the name of the file that a block is."""
    found = []
    for token in parsed(path):
        if token.type == "fence":
            kind, _, rest = token.info.partition(" ")
            title = rest.removeprefix('title="').removesuffix('"')
            assert rest in ("", f'title="{title}"'), f"{path}: {token.info}"
            assert token.map is not None
            found.append(Block(kind, title, token.content, token.map[0] + 1))
    return found


def shortened(line):
    """Return a command with the options of `QUICK`."""
    command = re.match(r"(?:turtlebot-gym|python -m turtlebot_gym_ros) ([\w-]+)", line)
    options = QUICK.get(command[1], {}) if command else {}
    code = line.partition("  #")[0]
    for name, value in options.items():
        code = re.sub(rf" --{name} \S+", "", code) + f" --{name} {value}"
    return code


def environment():
    search = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    return {**os.environ, "PATH": search, "DISABLE_MKDOCS_2_WARNING": "true", "NO_MKDOCS_2_WARNING": "true"}


def run(text):
    """Run a bash block, shortened."""
    script = "\n".join(map(shortened, text.splitlines()))
    done = subprocess.run(["bash", "-euo", "pipefail", "-c", script], env=environment(), capture_output=True, text=True)
    assert done.returncode == 0, f"{script}\n{done.stdout}\n{done.stderr}"


def write_drive(path):
    """Write a recorded drive, as `replay` reads them: 10 s straight ahead."""
    rows = [f"{0.1 * k:.1f},0.2,0.0,{0.02 * k:.2f},0.0,0.0" for k in range(101)]
    path.write_text("\n".join(["t,vx,gyro,px,py,theta", *rows]))


@pytest.fixture(params=PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def page(request):
    return request.param


def test_code_blocks_work(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_drive(tmp_path / "drive.csv")
    names = {"__name__": "page"}
    with patch.dict(turtlebot_gym.NOISES), patch.dict(gym.registry):  # pages may add to them
        for block in blocks_of(page):
            if not CLIENTS.get(Path(block.title).stem, {}).get("in_make_test", True):
                continue
            if block.title:
                Path(block.title).write_text(block.text)
            if block.kind == "python":
                exec(compile("\n" * block.line + block.text, page, "exec"), names)
            elif block.kind == "bash":
                run(block.text)
            elif block.kind == "yaml":
                yaml.safe_load(block.text)


def test_no_code_block_is_left_out(page):
    assert {block.kind for block in blocks_of(page)} <= {*KINDS}
    assert not [token for token in parsed(page) if token.type == "code_block"]  # indented ones have no language
    shown = [line for block in blocks_of(page) if block.kind == "text" for line in block.text.splitlines()]
    assert not [line for line in shown if re.match(r"(\$ |turtlebot-gym |python |pip |ros2 |make )", line)]


def test_the_commands_of_the_pages_are_made_short():
    assert (
        shortened("turtlebot-gym evaluate --episodes 1000 --seed 3  # long") == "turtlebot-gym evaluate --seed 3 --episodes 5"
    )
    assert shortened("python -m turtlebot_gym_ros bringup") == "python -m turtlebot_gym_ros bringup --duration 3"


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The built documentation."""
    pytest.importorskip("mkdocs", reason="needs the extra [docs]")
    folder = tmp_path_factory.mktemp("site")
    build = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(folder)]
    done = subprocess.run(build, cwd=ROOT, env=environment(), capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout + done.stderr == ""
    return folder


@pytest.fixture(scope="module")
def ros(site):
    return (site / "reference" / "ros.html").read_text(encoding="utf-8")


def check(line, ros):
    """Check the names in a command that cannot be run here, against the code and the reference that is made from it."""

    def known(*names):
        for name in names:
            assert f"<code>{name}</code>" in ros, f"{name} is not in the ROS reference"

    words = shlex.split(line, comments=True)
    while words and re.match(r"[A-Z_]+=", words[0]):  # variables of the environment
        words.pop(0)
    match words:
        case []:
            pass
        case ["ros2", "launch", "turtlebot_gym_ros", file, *given]:
            arguments = {each.get("name") for each in ElementTree.parse(LAUNCHES / file).iter("arg")}
            assert {each.partition(":=")[0] for each in given} <= arguments
        case ["ros2", "service", "call", service, kind, _]:
            known(service, kind)
        case ["ros2", "topic", "pub", "--rate", _, topic, kind, _]:
            known(topic, kind)
        case ["ros2", "run", "teleop_twist_keyboard", "teleop_twist_keyboard", "--ros-args", "-r", remapping, *_]:
            known("/" + remapping.partition(":=")[2])
        case ["python", "-m", "turtlebot_gym_ros", node, *given]:
            assert node in NODES
            assert given[:1] in ([], ["--ros-args"])
            for flag, value in zip(given[1::2], given[2::2], strict=True):
                name = value.partition(":=")[0]
                known(f"/{name}" if flag == "-r" else name)
        case ["ros2", "bag", "record", *topics]:
            known(*(topic for topic in topics if topic not in ("/tf", "/tf_static")))
        case ["make", target]:
            assert re.search(rf"^{target}:.*##", (ROOT / "Makefile").read_text(), re.MULTILINE)
        case ["turtlebot-gym", command, *given]:
            options = {item.name for item in fields(COMMANDS[command])}
            assert {word[2:] for word in given if word.startswith("--")} <= options
        case ["tensorboard", "--logdir", "runs"]:
            pass
        case ["wandb", "sync", run]:
            assert run.startswith("runs/offline/wandb/")
        case ["docker", "run", *rest]:
            check(shlex.join(rest[rest.index("turtlebot-gym") + 1 :]), ros)
        case ["ray", "start", *given]:
            assert {word for word in given if word.startswith("--")} <= {"--head", "--port", "--address"}
        case ["sbatch", "--array=0-31", script, *_]:
            assert (ROOT / script).is_file()
        case ["pip", "install", where]:
            assert re.fullmatch(r"\.\[\w+\]", where)
            assert re.search(rf"^{where[2:-1]} = \[", (ROOT / "pyproject.toml").read_text(), re.MULTILINE)
        case ["colcon", "build", "--base-paths", path]:
            assert (ROOT / path / "package.xml").is_file()
        case ["source", "install/setup.bash"] | [".", ".venv/bin/activate"]:
            pass
        case _:
            pytest.fail(f"this command is neither run nor checked: {line}")


def test_commands_that_cannot_be_run_name_what_there_is(page, ros):
    for block in blocks_of(page):
        if block.kind == "console":
            for line in block.text.splitlines():
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


def test_the_site_needs_no_network(site):
    for path in site.rglob("*.html"):
        assert not [each for each in Html(path).loads if urlsplit(each).scheme not in ("", "data")], path


def test_formulas_are_mathml(site):
    notebook = (site / "notebooks" / "01_closed_loop.html").read_text(encoding="utf-8")
    assert notebook.count("<math ") > 40
    assert not [path for path in site.rglob("*.html") if 'class="arithmatex"' in path.read_text(encoding="utf-8")]


def test_the_reference_is_complete(site, ros):
    html = {path.stem: Html(path).ids for path in (site / "reference").glob("*.html")}
    assert {name for name in NODES if name not in ("bringup", "watch", "status")} <= html["ros"]
    assert {f"turtlebot-gym-{name}" for name in COMMANDS} <= html["commands"]
    presets = (site / "reference" / "presets.html").read_text()
    assert all(f"<code>{name}</code>" in presets for name in turtlebot_gym.NOISES)
    environments = (site / "reference" / "environments.html").read_text()
    assert all(f"<code>turtlebot_gym/TurtleBot{name}-v0</code>" in environments for name in ("Nav", "Pose", "Square"))
    assert "turtlebot_gym.estimation.update.update" in html["turtlebot_gym.estimation.update"]
    assert "turtlebot_gym.tasks.task.Task" in html["turtlebot_gym.tasks"]
    modules = {module.name for package in API for module in walk_packages(import_module(package).__path__, f"{package}.")}
    undescribed = {name for name in modules if not any(name in ids for ids in html.values())}
    assert all(name.endswith("__main__") for name in undescribed), undescribed


def test_the_release_notes_are_the_changelog(site):
    told = (site / "releases.html").read_text(encoding="utf-8")
    entries = [token.content for token in parsed(ROOT / "CHANGELOG.md") if token.type == "inline"]
    assert len(entries) > 50
    assert told.count("<li>") >= len(entries) - 3  # all but the title, the sentence below it and the version
    assert "Release notes" in told
    assert 'href="howto/fix.html"' in told


@pytest.mark.parametrize("name", ["README.md", "CONTRIBUTING.md", "CHANGELOG.md", "agents/pretrained/README.md"])
def test_links_between_files_exist(name):
    path = ROOT / name
    inline = [child for token in parsed(path) for child in token.children or ()]
    targets = [str(value) for child in inline for name, value in child.attrs.items() if name in ("href", "src")]
    for target in targets:
        if not urlsplit(target).scheme:
            assert (path.parent / target).exists(), target


MEASURED = {
    "`tutorial`": "tutorial",
    "`documented`, no bias": "documented without its bias",
    "`rough`, no slip": "rough without slip",
    "`rough`": "rough",
}
"""Settings of `benchmarks/estimation.py`, as the page of the belief calls them."""


def test_the_table_of_filters_is_what_was_measured():
    settings = json.loads((ROOT / "benchmarks" / "estimation.json").read_text(encoding="utf-8"))["settings"]
    page, rows, noise = (ROOT / "docs" / "concepts" / "belief.md").read_text(encoding="utf-8"), 0, ""
    for line in page.partition("| NEES of the pose (3) |")[2].splitlines()[2:]:
        if not line.startswith("|"):
            break
        said, name, *numbers = (cell.strip() for cell in line.strip("|").split("|"))
        noise = said or noise
        one = settings[MEASURED[noise]]["filters"][name.replace("`", "")]
        for number, measured, digits in zip(numbers, [*one["ratio"], one["nees"]], (3, 3, 3, 2), strict=True):
            margin = (measured["high"] - measured["low"]) / 2.0
            assert number == f"{measured['value']:.{digits}f} ± {margin:.{digits}f}", line
        rows += 1
    assert rows == 11


def rows_after(page, words):
    """Return the cells of the first table after some words, without its heading."""
    lines = (ROOT / page).read_text(encoding="utf-8").partition(words)[2].splitlines()
    is_row = [line.startswith("|") for line in lines]
    begin = is_row.index(True)
    table = lines[begin : is_row.index(False, begin)]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in table[2:]]


def test_the_table_of_fixes_is_what_was_measured():
    cases = json.loads((ROOT / "benchmarks" / "fix.json").read_text(encoding="utf-8"))["cases"]
    rows = rows_after("docs/howto/fix.md", "## What it is worth")
    for name, *told in rows:
        position, nees = cases[name]["position"], cases[name]["nees"]
        margins = [(each["high"] - each["low"]) / 2.0 for each in (position, nees)]
        assert told == [f"{position['value']:.3f} ± {margins[0]:.3f} m", f"{nees['value']:.2f} ± {margins[1]:.2f}"], name
    assert len(rows) == len(cases)


def test_the_table_of_arrivals_is_what_was_measured():
    rules = json.loads((ROOT / "benchmarks" / "arrival.json").read_text(encoding="utf-8"))["rules"]
    page, rows = (ROOT / "docs" / "concepts" / "tasks.md").read_text(encoding="utf-8"), 0
    names, *lines = [line for line in page.partition("`make bench-arrival`")[2].splitlines() if line.startswith("|")]
    noises = [cell.strip(" `") for cell in names.strip("|").split("|")[1:]]
    for line in lines[1:]:
        rule, *told = (cell.strip() for cell in line.strip("|").split("|"))
        for noise, cell in zip(noises, told, strict=True):
            row = rules[noise][rule]
            never = f", never {100.0 * row['never']:.0f} %" if row["never"] else ""
            assert cell == f"{100.0 * row['false']['value']:.1f} %, {row['later']['value']:.2f} s{never}", line
        rows += 1
    assert rows == 7


def test_the_plan_for_a_cluster_is_what_was_measured():
    told = json.loads((ROOT / "benchmarks" / "cluster.json").read_text(encoding="utf-8"))
    page = (ROOT / "docs" / "howto" / "cluster.md").read_text(encoding="utf-8")
    assert f"{told['ratio_of_2_workers_to_1']:.2f} times what one does" in page
    rows = rows_after("docs/howto/cluster.md", "## What it costs")
    for workers, wanted, busy, *_ in rows:
        row = told["planned"]["by_workers"][workers.replace(",", "")]
        assert (wanted, busy) == (f"{row['results_per_second_wanted']:,.0f}", f"{row['driver_busy']:.2f}"), workers
    assert len(rows) == len(told["planned"]["by_workers"])


def shown(interval, sign="", unit=100.0, digits=1):
    value, low, high = (f"{unit * interval[part]:{sign}.{digits}f}" for part in ("value", "low", "high"))
    return f"{value} ({low}, {high})"


def test_the_tables_of_rooms_are_what_was_measured():
    study = json.loads((ROOT / "benchmarks" / "rooms_study.json").read_text(encoding="utf-8"))
    told = {(row["setting"], row["policy"]): row for row in study["rows"]}
    page, tables = "docs/concepts/rooms.md", 0
    for name, *cells in rows_after(page, "## Which policies find the way"):
        policy = {"PPO, 3 trainings": "ppo, 3 trainings"}.get(name, name.strip("`"))
        rows = [told[world, policy] for world in ("dense", "office")]
        assert cells == [shown(row[part]) for row in rows for part in ("success", "collision")], name
        tables += 1
    worlds = [(name.strip("`"), cells) for name, *cells in rows_after(page, "policies that arrive hardly make a detour")]
    lidars = [(f"dense, {name.strip('`')}", cells) for name, *cells in rows_after(page, "**With an `ideal` LiDAR")]
    for name, cells in [*worlds, *lidars]:
        setting = name.removesuffix(", lds01")
        vfh, ppo = (told[setting, policy] for policy in ("vfh", "ppo-rooms"))
        wanted = [shown(vfh["success"]), shown(ppo["success"]), shown(ppo["collision"]), shown(ppo["success_difference"], "+")]
        assert cells == wanted, name
        tables += 1
    for world, policy, *cells in rows_after(page, "**The safety layer is not free.**"):
        bare, safe = (told[world.strip("`"), policy.strip("`") + end] for end in ("", "+safety"))
        shares = [f"{100.0 * one[part]['value']:.1f}" for part in ("collision", "success") for one in (bare, safe)]
        assert cells == [*shares, shown(safe["later"], "+", 1.0, 2)], policy
        tables += 1
    barn = json.loads((ROOT / "benchmarks" / "barn.json").read_text(encoding="utf-8"))["mean"]
    for name, *cells in rows_after(page, "**The 200 worlds of the BARN challenge**"):
        units = (("success", 100.0, 1), ("collision", 100.0, 1), ("timeout", 100.0, 1), ("barn", 1.0, 3))
        for cell, (part, unit, digits) in zip(cells, units, strict=True):
            one = barn[name.strip("`")][part]
            margin = f"{0.5 * unit * (one['high'] - one['low']):.{digits}f}"
            assert cell == f"{unit * one['value']:.{digits}f}" + (f" ± {margin}" if float(margin) else ""), name
        tables += 1
    assert tables == 8 + 7 + 4 + 6 + len(barn)
