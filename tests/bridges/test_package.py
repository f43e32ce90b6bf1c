"""The ROS package around the modules: its files agree with the code, colcon builds it, and the wheel holds it."""

import ast
import re
import shlex
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml
from rclpy.node import Node

import turtlebot_gym
from cmd_vel_guard import parameters, standby
from cmd_vel_guard.declare import declare
from cmd_vel_guard.declare import declare as declare_guard
from turtlebot_gym_ros.node.shell import Shell
from turtlebot_gym_ros.nodes import BLOCKS, NODES, load
from turtlebot_gym_ros.recording import logger

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "bridges" / "turtlebot_gym_ros"
SOURCES = PACKAGE / "turtlebot_gym_ros"
CONFIGS = sorted((PACKAGE / "config").glob("*.yaml"))
LAUNCHES = sorted((PACKAGE / "launch").glob("*.launch.xml"))
PROGRAMS = {"bringup", "status"}
"""Programs without parameters of nodes."""
RVIZ = PACKAGE / "rviz" / "turtlebot.rviz"
SHELLS = {name: load(name) for name in BLOCKS}
ROS_OWN = {"use_sim_time", "start_type_description_service"}


ANYWHERE = "/**/"
"""Stands before a node's name in a configuration, so that it counts in any namespace."""


def configured(path):
    content = yaml.safe_load(path.read_text())
    assert all(key.startswith(ANYWHERE) for key in content)
    return {key.removeprefix(ANYWHERE): parameters for key, parameters in content.items()}


def declared(name, context, config):
    """Return the parameters that a node declares when it reads a file; it refuses what it does not know."""
    arguments = ["--ros-args", "--params-file", str(config)]
    if name in SHELLS:
        block = SHELLS[name]
        shell = Shell(block, block.Params, name=name, context=context, arguments=arguments[1:])
        names = {*shell.node.list_parameters([], 0).names}
        shell.close()
    else:
        modules = {"cmd_vel_guard": parameters, "cmd_vel_standby": standby, "data_logger": logger}
        params = modules[name].Parameters
        node = Node(name, context=context, cli_args=arguments, automatically_declare_parameters_from_overrides=True)
        (declare_guard if NODES[name].guards else declare)(node, params)
        names = {*node.list_parameters([], 0).names}
        node.destroy_node()
    return {name for name in names if not name.startswith("qos_overrides.")} - ROS_OWN


@pytest.mark.parametrize(
    ("config", "name"),
    [(path, name) for path in CONFIGS for name in configured(path)],
    ids=lambda each: getattr(each, "stem", each),
)
def test_config_has_every_parameter(runner, config, name):
    assert {*configured(config)[name]["ros__parameters"]} == declared(name, runner.context, config)


def test_config_names_all_nodes_of_the_graph():
    assert {name for path in CONFIGS for name in configured(path)} == {*NODES} - PROGRAMS


def test_on_a_robot_nothing_moves_before_it_is_enabled():
    config = configured(PACKAGE / "config" / "robot.yaml")
    assert config["velocity_controller"]["ros__parameters"]["start_enabled"] is False
    guard = config["cmd_vel_guard"]["ros__parameters"]
    assert [guard[name] for name in ("start_enabled", "require_emergency_stop", "require_standby")] == [False, True, True]


@pytest.fixture(params=LAUNCHES, ids=lambda path: path.stem)
def launch_file(request):
    return ElementTree.parse(request.param).getroot()


def config_of(launch_file):
    (path,) = (let.get("value") for let in launch_file.iter("let") if let.get("name") == "config")
    return configured(PACKAGE / path.removeprefix("$(find-pkg-share turtlebot_gym_ros)/"))


def test_launch_starts_nodes_that_exist_with_parameters_that_exist(launch_file):
    config = config_of(launch_file)
    for node in launch_file.iter("node"):
        if node.get("pkg") == "rviz2":
            continue
        assert node.get("pkg") == ("cmd_vel_guard" if NODES[node.get("name")].guards else "turtlebot_gym_ros")
        assert node.get("exec") == node.get("name")
        assert node.get("exec") in NODES
        params = node.findall("param")
        assert params[0].get("from") == "$(var config)"  # first, so that the others count
        given = {param.get("name") for param in params[1:]}
        assert given <= {*config[node.get("name")]["ros__parameters"], "use_sim_time"}


def test_launch_arguments_are_used_and_default_to_the_configuration(launch_file):
    text = ElementTree.tostring(launch_file, encoding="unicode")
    variables = {argument.get("name") for argument in (*launch_file.iter("arg"), *launch_file.iter("let"))}
    assert {*re.findall(r"\$\(var (\w+)\)", text)} == variables
    defaults = {arg.get("name"): arg.get("default") for arg in launch_file.iter("arg")}
    config = config_of(launch_file)
    for node in launch_file.iter("node"):
        for param in node.findall("param")[1:]:
            name = param.get("name")
            if name in defaults and name != "start_enabled":
                default = defaults[name] if param.get("type") == "str" else yaml.safe_load(defaults[name])
                assert default == config[node.get("name")]["ros__parameters"][name], name


def test_launch_starts_rviz_only_if_asked_and_with_its_file(launch_file):
    (asked,) = (arg for arg in launch_file.iter("arg") if arg.get("name") == "rviz")
    assert asked.get("default") == "false"
    (viewer,) = (node for node in launch_file.iter("node") if node.get("name") == "rviz2")
    assert viewer.get("if") == "$(var rviz)"
    file = f"$(find-pkg-share turtlebot_gym_ros)/{RVIZ.relative_to(PACKAGE)}"
    frame = "$(var frame)" if "frame" in {let.get("name") for let in launch_file.iter("let")} else "odom"  # that of goals
    assert viewer.get("args") == f"-d {file} -f $(var frame_prefix){frame}"


def topics_of(name):
    """Return the topics of a node that a launch file may remap."""
    if name == "rviz2":
        return {*re.findall(r"Value: (/\w+)", RVIZ.read_text()), "/clock"}
    if name == "data_logger":
        return {"/clock"}
    if name.startswith("cmd_vel_"):
        return {"cmd_vel"} | ({"emergency_stop"} if name == "cmd_vel_guard" else set())
    block = SHELLS[name]
    moves = {"emergency_stop"} if any(output.stop is not None for output in block.outputs.values()) else set()
    return {end.topic for end in (*block.inputs.values(), *block.outputs.values())} | moves


def test_launch_remaps_topics_that_exist(launch_file):
    for node in launch_file.iter("node"):
        remaps = {remap.get("from"): remap.get("to") for remap in node.findall("remap")}
        assert remaps.keys() <= topics_of(node.get("name")), node.get("name")
        absolute = {here: there for here, there in remaps.items() if here.startswith("/")}
        assert absolute == {here: here.removeprefix("/") for here in absolute}  # into the namespace


def test_launch_puts_all_nodes_into_a_namespace_and_all_frames_behind_a_prefix(launch_file):
    (group,) = launch_file.findall("group")
    assert group[0].tag == "push_ros_namespace"
    assert group[0].get("namespace") == "$(var namespace)"
    nodes = [*launch_file.iter("node")]
    assert [*group.iter("node")] == nodes
    for node in nodes:
        if "frame_prefix" in config_of(launch_file).get(node.get("name"), {}).get("ros__parameters", {}):
            (given,) = (param for param in node.findall("param") if param.get("name") == "frame_prefix")
            assert (given.get("value"), given.get("type")) == ("$(var frame_prefix)", "str")
        else:
            assert node.get("name") in ("data_logger", "rviz2", "cmd_vel_standby")


def test_every_node_that_moves_a_robot_hears_the_same_emergency_stop(launch_file):
    for node in launch_file.iter("node"):
        if "emergency_stop" in topics_of(node.get("name")):
            remaps = {remap.get("from"): remap.get("to") for remap in node.findall("remap")}
            assert remaps["emergency_stop"] == "$(var emergency_stop)", node.get("name")
        if node.get("name") == "rviz2":
            assert {remap.get("from") for remap in node.findall("remap")} - {"/clock"} == topics_of("rviz2") - {"/clock"}


@pytest.mark.parametrize("namespace", ["", "robot1", "lab/robot1"])
def test_a_configuration_counts_in_any_namespace(runner, namespace):
    config = str(PACKAGE / "config" / "robot.yaml")
    block = SHELLS["kalman_filter"]
    arguments = ["--params-file", config, "-r", f"__ns:=/{namespace}"]
    shell = Shell(block, block.Params, name="kalman_filter", context=runner.context, arguments=arguments)
    assert shell.node.get_namespace() == f"/{namespace}"
    assert shell.params.noise == configured(Path(config))["kalman_filter"]["ros__parameters"]["noise"] == "wheel"
    shell.close()


def test_every_node_is_started_again_and_only_once_enabled(launch_file):
    for node in launch_file.iter("node"):
        assert node.get("respawn") == (None if node.get("pkg") == "rviz2" else "true"), node.get("name")
        given = {param.get("name"): param.get("value") for param in node.findall("param")}
        by_default = config_of(launch_file).get(node.get("name"), {}).get("ros__parameters", {}).get("start_enabled", False)
        enabled = given.get("start_enabled", str(by_default).lower())
        assert enabled == ("$(var start_enabled)" if node.get("name") == "cmd_vel_guard" else "false"), node.get("name")
    for once in launch_file.iter("executable"):
        assert once.get("respawn") is None
        *words, node, kind, request = shlex.split(once.get("cmd").replace("$(var space)", "/robot1"))
        assert words == ["ros2", "service", "call"]
        assert node.removeprefix("/robot1/").removesuffix("/enable") in SHELLS
        assert (kind, yaml.safe_load(request)) == ("std_srvs/srv/SetBool", {"data": True})


@pytest.mark.parametrize(("namespace", "space"), [("", ""), ("robot1", "/robot1"), ("/lab/robot1/", "/lab/robot1")])
@pytest.mark.parametrize("name", ["simulation", "teleoperation"])
def test_a_node_is_enabled_in_its_namespace(name, namespace, space):
    launch_file = ElementTree.parse(PACKAGE / "launch" / f"{name}.launch.xml").getroot()
    (value,) = (let.get("value") for let in launch_file.iter("let") if let.get("name") == "space")
    expression = value.removeprefix("$(eval '").removesuffix("')").replace("\\'", "'").replace("$(var namespace)", namespace)
    assert eval(expression) == space


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


def test_setup_knows_all_nodes_and_the_version():
    asked = subprocess.run([sys.executable, "setup.py", "--version"], cwd=PACKAGE, capture_output=True, text=True, check=True)
    assert asked.stdout.strip().splitlines()[-1] == turtlebot_gym.__version__


def test_package_depends_on_the_ros_packages_that_it_imports():
    imported = {
        name.split(".")[0]
        for path in SOURCES.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, (ast.Import, ast.ImportFrom))
        for name in ([node.module] if isinstance(node, ast.ImportFrom) else [alias.name for alias in node.names])
        if name
    }
    ros = {name for name in imported if name.startswith(("rcl", "ament_")) or name.endswith(("_msgs", "_srvs", "_interfaces"))}
    root = ElementTree.parse(PACKAGE / "package.xml").getroot()
    depends = {element.text for element in root.iter("exec_depend")}
    assert ros == depends - {"cmd_vel_guard", "python3-numpy", "python3-yaml", "ros2launch", "ros2service"}


def files_of(folder):
    return {path for path in folder.rglob("*") if "__pycache__" not in path.parts}


@pytest.mark.nightly
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
    for path in (*CONFIGS, *LAUNCHES, RVIZ, *sorted((PACKAGE / "layouts").iterdir()), PACKAGE / "package.xml"):
        assert (share / path.relative_to(PACKAGE)).read_bytes() == path.read_bytes()
    assert {path.name for path in (prefix / "lib" / "turtlebot_gym_ros").iterdir()} == {
        name for name, entry in NODES.items() if not entry.guards
    }
    (library,) = prefix.glob("lib/python*/site-packages")
    installed = files_of(library / "turtlebot_gym_ros")
    assert {path.relative_to(library) for path in installed} == {path.relative_to(PACKAGE) for path in files_of(SOURCES)}
    # An installed program runs its node, from the installed modules.
    program = (
        f"import runpy, sys; sys.path.insert(0, {str(library)!r}); sys.argv[:] = sys.argv[1:]\n"
        f"import turtlebot_gym_ros; assert turtlebot_gym_ros.__file__.startswith({str(library)!r})\n"
        "runpy.run_path(sys.argv[0], run_name='__main__')"
    )
    executable = prefix / "lib" / "turtlebot_gym_ros" / "kalman_filter"
    arguments = [sys.executable, "-c", program, str(executable), "--ros-args", "-p", "period:=-9.0"]
    ran = subprocess.run(arguments, capture_output=True, text=True, timeout=60)
    assert ran.returncode == 2
    assert ran.stderr.startswith("error: period must be ")


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
