"""The package as people install it: configuration, launch file, programs, and what it needs."""

import ast
import re
import subprocess
import sys
import zipfile
from dataclasses import fields
from pathlib import Path
from xml.etree import ElementTree

from cmd_vel_guard import __main__, parameters, standby

ROOT = Path(__file__).parents[2] / "bridges" / "cmd_vel_guard"
LAUNCH = ROOT / "launch" / "cmd_vel_guard.launch.xml"
KINDS = {"cmd_vel_guard": parameters.Parameters, "cmd_vel_standby": standby.Parameters}


def test_the_launch_file_starts_both_and_gives_parameters_that_exist():
    launch = ElementTree.parse(LAUNCH).getroot()
    assert [node.get("name") for node in launch.iter("node")] == [*__main__.NODES] == [*KINDS]
    for node in launch.iter("node"):
        assert (node.get("pkg"), node.get("exec"), node.get("respawn")) == ("cmd_vel_guard", node.get("name"), "true")
        given = {param.get("name") for param in node.findall("param")[1:]}
        assert given <= {item.name for item in fields(KINDS[node.get("name")])}
    variables = set(re.findall(r"\$\(var (\w+)\)", LAUNCH.read_text()))
    assert variables == {argument.get("name") for argument in launch.iter("arg")}


def test_it_needs_numpy_ros_and_the_values_and_scans_of_the_core_only():
    ros = {"rclpy", "rcl_interfaces", "diagnostic_msgs", "geometry_msgs", "nav_msgs", "sensor_msgs", "std_msgs", "std_srvs"}
    imported = set()
    for path in (ROOT / "cmd_vel_guard").glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            modules = [node.module] if isinstance(node, ast.ImportFrom) else []
            modules += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            imported |= {module if module.startswith("turtlebot_gym") else module.partition(".")[0] for module in modules}
    core = {f"turtlebot_gym.{name}" for name in ("beams", "motion", "mounts", "scan_watch", "values")}
    assert {name for name in imported if name.startswith("turtlebot_gym")} == core
    imported -= core
    assert imported - set(sys.stdlib_module_names) == {"cmd_vel_guard", "numpy", "tf2_msgs", *ros}
    needed = {item.text for item in ElementTree.parse(ROOT / "package.xml").getroot().iter("exec_depend")}
    assert needed == {"python3-numpy", "tf2_msgs", "ros2launch", "ros2service", *ros}


def test_its_decisions_need_no_ros():
    program = "import sys, cmd_vel_guard.arbiter; raise SystemExit('rclpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0


def test_its_own_wheel_holds_all_of_it(tmp_path):
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(tmp_path)]
    subprocess.run(build, cwd=ROOT, check=True, capture_output=True)
    (wheel,) = tmp_path.glob("cmd_vel_guard-*.whl")
    held = {name for name in zipfile.ZipFile(wheel).namelist() if name.startswith("cmd_vel_guard/")}
    files = [path for path in (ROOT / "cmd_vel_guard").iterdir() if path.is_file()]
    assert held == {f"cmd_vel_guard/{path.name}" for path in files}
