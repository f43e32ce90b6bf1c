"""The ROS package: its nodes' parameters, files that agree with the code, what colcon builds, and what the wheel holds."""

import re
import shutil
import subprocess
import sys
import zipfile
from dataclasses import fields
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml

from cmd_vel_guard import parameters, standby
from turtlebot_gym.config import rules
from turtlebot_gym.docstrings import texts_of
from turtlebot_gym_ros.__main__ import main
from turtlebot_gym_ros.base.frames import Common
from turtlebot_gym_ros.nodes import BLOCKS, NODES, load
from turtlebot_gym_ros.recording import logger

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "bridges" / "turtlebot_gym_ros"
SOURCES = PACKAGE / "turtlebot_gym_ros"
CONFIG = PACKAGE / "config" / "robot.yaml"
LAUNCHES = sorted((PACKAGE / "launch").glob("*.launch.xml"))
GUARDS = ROOT / "bridges" / "cmd_vel_guard" / "launch" / "cmd_vel_guard.launch.xml"
RVIZ = PACKAGE / "rviz" / "turtlebot.rviz"
SHELLS = {name: load(name) for name in BLOCKS}
OTHERS = {"cmd_vel_guard": parameters, "cmd_vel_standby": standby, "data_logger": logger}


def parameters_of(name):
    """Return the names of a node's parameters."""
    kinds = (Common, SHELLS[name].Params) if name in SHELLS else (OTHERS[name].Parameters,)
    return {item.name for kind in kinds for item in fields(kind)}


@pytest.mark.parametrize("node", [*BLOCKS, "data_logger", "cmd_vel_guard"])
def test_every_float_has_a_rule_and_every_parameter_a_description(node):
    """How they become ROS parameters, the guard's tests show."""
    kind = SHELLS[node].Params if node in SHELLS else OTHERS[node].Parameters
    assert texts_of(kind).keys() == {item.name for item in fields(kind)}
    assert {item.name for item in fields(kind) if isinstance(item.default, float)} <= rules(kind).keys()


REFUSED = [
    ("velocity_controller", {"policy": "clever"}, "clever"),
    ("velocity_controller", {"goal_tolerance": 0.005}, "goal_tolerance must be 0, or at least 0.01 m"),
    ("kalman_filter", {"filter": "gyro"}, "filter 'gyro' reads the sensor 'imu'"),
    ("kalman_filter", {"max_gap": 0.05}, "period must be at most max_gap, 0.05 s, got 0.1"),
    ("turtlebot_simulator", {"goals": 2}, "goals must be 0 without a world"),
    ("turtlebot_simulator", {"world": "dense", "lidar": "ideal", "period": 0.2}, "at most one scan in a control interval"),
    ("waypoint_generator", {"waypoints": "/nowhere.yaml"}, "got '/nowhere.yaml'"),
]


@pytest.mark.parametrize(("node", "given", "said"), REFUSED)
def test_what_a_block_cannot_do_is_refused(node, given, said):
    with pytest.raises(ValueError, match=re.escape(said)):
        SHELLS[node](SHELLS[node].Params(**given))


@pytest.mark.parametrize(
    ("argv", "said"),
    [
        (["flight_controller"], "there is no node 'flight_controller'"),
        (["velocity_controller", "--ros-args", "-p", "polcy:=bearing"], "Did you mean 'policy'?"),
        (["kalman_filter", "--ros-args", "-p", "lock_step:=true", "-p", "twist:=commanded"], "lock_step must be false"),
        (["kalman_filter", "filter:=matched"], "unknown argument 'filter:=matched'"),
        (["bringup", "--policy", "nope.onnx"], "No such file or directory: 'nope.onnx'"),
    ],
)
def test_what_is_wrong_is_one_clear_line_and_exit_code_2(capsys, argv, said):
    assert main(argv) == 2
    captured = capsys.readouterr()
    (line,) = captured.err.splitlines()
    assert line.startswith("error: ")
    assert said in line
    assert not captured.out


def test_the_configuration_names_nodes_and_parameters_that_exist_and_moves_nothing_before_it_is_enabled():
    config = {key.removeprefix("/**/"): node["ros__parameters"] for key, node in yaml.safe_load(CONFIG.read_text()).items()}
    for name, given in config.items():
        assert given.keys() <= parameters_of(name), name
    assert not config["velocity_controller"].get("start_enabled", False)
    guard = config["cmd_vel_guard"]
    assert [guard[name] for name in ("start_enabled", "require_emergency_stop", "require_standby")] == [False, True, True]
    assert SHELLS["kalman_filter"].Params(**config["kalman_filter"]).noise == "wheel"


@pytest.mark.parametrize("path", [*LAUNCHES, GUARDS], ids=lambda path: path.stem)
def test_a_launch_file_starts_nodes_and_parameters_that_exist_again_and_again(path):
    launch_file = ElementTree.parse(path).getroot()
    for node in launch_file.iter("node"):
        name = node.get("name")
        assert node.get("respawn") == (None if name == "rviz2" else "true")
        if name == "rviz2":
            continue
        assert node.get("pkg") == ("turtlebot_gym_ros" if name in NODES else "cmd_vel_guard")
        assert node.get("exec") == name
        given = {param.get("name") for param in node.findall("param")} - {None, "use_sim_time"}
        assert given <= parameters_of(name), name
        if "frame_prefix" in parameters_of(name):
            assert "frame_prefix" in given
    text = ElementTree.tostring(launch_file, encoding="unicode")
    declared = {argument.get("name") for argument in (*launch_file.iter("arg"), *launch_file.iter("let"))}
    assert {*re.findall(r"\$\(var (\w+)\)", text)} == declared


def test_on_a_robot_only_the_guard_speaks_to_the_wheels():
    launch_file = ElementTree.parse(PACKAGE / "launch" / "robot.launch.xml").getroot()
    speakers = {}
    for node in launch_file.iter("node"):
        remaps = {remap.get("from"): remap.get("to") for remap in node.findall("remap")}
        for output in getattr(SHELLS.get(node.get("name")), "outputs", {}).values():
            speakers.setdefault(remaps.get(output.topic, output.topic), []).append(node.get("name"))
    assert "cmd_vel" not in speakers
    assert speakers["cmd_vel_in"] == ["velocity_controller"]
    assert "turtlebot_simulator" not in {node.get("name") for node in launch_file.iter("node")}


def files_of(folder):
    return {path for path in folder.rglob("*") if "__pycache__" not in path.parts}


@pytest.mark.slow
def test_colcon_builds_the_package(tmp_path):
    search = f"{Path(sys.executable).parent}:{Path(sys.prefix) / 'bin'}"
    colcon = shutil.which("colcon", path=search) or shutil.which("colcon")
    if colcon is None:
        pytest.skip("COLCON IS MISSING, so the ROS package is not built: pip install colcon-ros")
    before = files_of(PACKAGE)
    done = subprocess.run(
        [colcon, "--log-base", "log", "build", "--base-paths", str(PACKAGE)], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert files_of(PACKAGE) == before
    prefix = tmp_path / "install" / "turtlebot_gym_ros"
    share = prefix / "share" / "turtlebot_gym_ros"
    for path in (CONFIG, *LAUNCHES, RVIZ, *sorted((PACKAGE / "layouts").iterdir()), PACKAGE / "package.xml"):
        assert (share / path.relative_to(PACKAGE)).read_bytes() == path.read_bytes()
    assert {path.name for path in (prefix / "lib" / "turtlebot_gym_ros").iterdir()} == NODES.keys()
    (library,) = prefix.glob("lib/python*/site-packages")
    installed = files_of(library / "turtlebot_gym_ros")
    assert {path.relative_to(library) for path in installed} == {path.relative_to(PACKAGE) for path in files_of(SOURCES)}
    guard = ROOT / "bridges" / "cmd_vel_guard"
    subprocess.run([colcon, "--log-base", "log", "build", "--base-paths", str(guard)], cwd=tmp_path, check=True)
    programs = {path.name for path in (tmp_path / "install" / "cmd_vel_guard" / "lib" / "cmd_vel_guard").iterdir()}
    assert programs == {"cmd_vel_guard", "cmd_vel_standby"}


def test_the_wheel_holds_the_package(tmp_path):
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(tmp_path)]
    subprocess.run(build, cwd=ROOT, check=True, capture_output=True)
    (wheel,) = tmp_path.glob("*.whl")
    names = zipfile.ZipFile(wheel).namelist()
    assert {f"{package}/py.typed" for package in ("turtlebot_gym", "turtlebot_gym_agents", "turtlebot_gym_ros")} <= set(names)
    held = {name for name in names if name.startswith("turtlebot_gym_ros/")}
    sources = {str(path.relative_to(PACKAGE)) for path in files_of(SOURCES) if path.is_file()}
    assert held == sources
    share = ".data/data/share/turtlebot_gym_ros/"
    shared = {name.partition(share)[2] for name in names if share in name}
    folders = [PACKAGE / folder for folder in ("config", "launch", "layouts", "rviz")]
    assert shared == {str(path.relative_to(PACKAGE)) for folder in folders for path in folder.iterdir()}
