"""Build nav2_msgs/action/NavigateToPose and tf2_msgs/msg/TFMessage as a wheel, where ROS comes from PyPI, which lacks both.

ROS's generators are installed from PyPI into a temporary environment, for a few minutes. CMake, g++ and Python's headers must
be installed.

References:
    Nav2, ``nav2_msgs/action/NavigateToPose.action``; Geometry2, ``tf2_msgs/msg/TFMessage.msg``; both of ROS 2 Jazzy and Kilted.
    Names and types of the fields are part of a type's hash, by which nodes find each other.
"""

from __future__ import annotations

import os
import platform
import re
import subprocess
import sys
import sysconfig
import venv
import zipfile
from collections.abc import Mapping
from importlib.metadata import distributions
from pathlib import Path
from tempfile import TemporaryDirectory

ACTION = """geometry_msgs/PoseStamped pose
string behavior_tree
---
uint16 error_code
string error_msg
---
geometry_msgs/PoseStamped current_pose
builtin_interfaces/Duration navigation_time
builtin_interfaces/Duration estimated_time_remaining
int16 number_of_recoveries
float32 distance_remaining
"""
FILES = {
    "nav2_msgs": ("action/NavigateToPose.action", ACTION),
    "tf2_msgs": ("msg/TFMessage.msg", "geometry_msgs/TransformStamped[] transforms\n"),
}
"""The file and the text of each package's interface."""
GENERATORS = [
    "rosidl-default-generators",
    "rosidl-core-generators",
    "ament-cmake",
    "ament-cmake-ros",
    "ament-cmake-include-directories",
    "ament-cmake-gtest",
    "ament-cmake-gmock",
    "ament-cmake-pytest",
    "ament-package",
    "python-cmake-module",
    "rclpy[fastrtps]",
    "geometry-msgs",
    "action-msgs",
]
TOOLS = ("empy==3.3.4", "lark", "catkin_pkg", "setuptools<80", "numpy")
NEEDS = ("geometry_msgs", "builtin_interfaces", "action_msgs")
PACKAGE = """<?xml version="1.0"?>
<package format="3">
  <name>{name}</name><version>0.1.0</version><description>Generated interfaces</description>
  <maintainer email="turtlebot-gym@users.noreply.github.com">The turtlebot-gym authors</maintainer><license>MIT</license>
  <buildtool_depend>ament_cmake</buildtool_depend><buildtool_depend>rosidl_default_generators</buildtool_depend>
  {depends}<exec_depend>rosidl_default_runtime</exec_depend>
  <member_of_group>rosidl_interface_packages</member_of_group><export><build_type>ament_cmake</build_type></export>
</package>
"""
CMAKE = """cmake_minimum_required(VERSION 3.8)
project({name})
find_package(ament_cmake REQUIRED)
find_package(rosidl_default_generators REQUIRED)
{finds}rosidl_generate_interfaces(${{PROJECT_NAME}} "{file}" DEPENDENCIES {needs})
ament_package()
"""


def build(target: Path, files: Mapping[str, tuple[str, str]] = FILES) -> Path:
    """Build the wheel into a folder, and return its path.

    Args:
        target: The folder.
        files: File and text of the interface of each package; nav2_msgs must be among them.

    Raises:
        ValueError: If ROS does not come from PyPI.
        subprocess.CalledProcessError: If a step fails, which has said why.
    """
    versions = {found.metadata["Name"]: found.version for found in distributions()}
    pinned = sorted(f"{name}=={version}" for name, version in versions.items() if name.startswith("ros-"))
    ros = next((name for name in ("jazzy", "kilted") if f"ros-{name}-rclpy" in versions), None)
    if ros is None:
        raise ValueError("no ROS of PyPI is installed here")
    with TemporaryDirectory() as folder:
        tools, out = Path(folder, "tools"), Path(folder, "out")
        venv.create(tools, with_pip=True)
        (limits := Path(folder, "pinned.txt")).write_text("\n".join(pinned) + "\n")
        packages = [f"ros-{ros}-{name}" for name in GENERATORS]
        _run(tools / "bin/python", "-m", "pip", "install", "-q", "-c", limits, *packages, *TOOLS)
        _move(tools)
        for name, (file, text) in files.items():
            _generate(Path(folder, name), tools, out, name, file, text)
        return _pack(out, target, ros)


def _move(tools: Path) -> None:
    """Correct the CMake files, which name the folders of the Python with which the generators' wheels were made."""
    at = f"python{sys.version_info.major}.{sys.version_info.minor}"
    places = {"include": sysconfig.get_path("include"), "lib": str(tools / "lib" / at)}
    for file in tools.glob("share/**/*.cmake"):
        file.write_text(re.sub(rf"/opt/python/[^/]+/(include|lib)/{re.escape(at)}", lambda m: places[m[1]], file.read_text()))


def _generate(source: Path, tools: Path, out: Path, name: str, file: str, text: str) -> None:
    """Generate, compile and install a package of interfaces."""
    (source / file).parent.mkdir(parents=True)
    (source / file).write_text(text)
    depends = "".join(f"<depend>{package}</depend>" for package in NEEDS)
    finds = "".join(f"find_package({package} REQUIRED)\n" for package in NEEDS)
    (source / "package.xml").write_text(PACKAGE.format(name=name, depends=depends))
    (source / "CMakeLists.txt").write_text(CMAKE.format(name=name, finds=finds, file=file, needs=" ".join(NEEDS)))
    environment = {
        "AMENT_PREFIX_PATH": str(tools),
        "CMAKE_PREFIX_PATH": str(tools),
        "LD_LIBRARY_PATH": str(tools / "lib"),
        "PATH": f"{tools / 'bin'}{os.pathsep}{os.environ['PATH']}",
        "_ROS_WHEELS_BOOTSTRAP_COMPLETE": "1",
    }
    made, python = source / "build", f"-DPython3_EXECUTABLE={tools / 'bin/python'}"
    _run("cmake", "-S", source, "-B", made, f"-DCMAKE_INSTALL_PREFIX={out}", python, "-DBUILD_TESTING=OFF", **environment)
    _run("cmake", "--build", made, "--target", "install", "--parallel", str(os.cpu_count() or 1), **environment)


def _pack(out: Path, target: Path, ros: str) -> Path:
    """Write what was installed as a wheel."""
    tag = "cp{0}{1}-cp{0}{1}-linux_{2}".format(*sys.version_info[:2], platform.machine())
    name = f"turtlebot_gym_interfaces-0.1.0+{ros}"
    (site,) = {path.parents[1] for path in out.glob("**/nav2_msgs/__init__.py")}
    files = {}
    for path in filter(Path.is_file, sorted(out.rglob("*"))):
        inside = path.is_relative_to(site)
        files[str(path.relative_to(site) if inside else Path(f"{name}.data/data") / path.relative_to(out))] = path.read_bytes()
    about, version = f"{name}.dist-info", f"Name: turtlebot-gym-interfaces\nVersion: 0.1.0+{ros}\n"
    files[f"{about}/METADATA"] = f"Metadata-Version: 2.1\n{version}".encode()
    files[f"{about}/WHEEL"] = f"Wheel-Version: 1.0\nRoot-Is-Purelib: false\nTag: {tag}\n".encode()
    files[f"{about}/RECORD"] = "".join(f"{file},,\n" for file in (*files, f"{about}/RECORD")).encode()
    target.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(wheel := target / f"{name}-{tag}.whl", "w", zipfile.ZIP_DEFLATED) as archive:
        for file, content in files.items():
            archive.writestr(file, content)
    return wheel


def _run(*command: str | Path, **environment: str) -> None:
    without = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "PYTHONHOME")}
    subprocess.run(list(map(str, command)), check=True, env={**without, **environment})
