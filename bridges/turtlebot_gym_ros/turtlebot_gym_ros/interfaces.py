"""Build the messages that PyPI lacks, nav2_msgs' action and tf2_msgs' transforms, where ROS comes from PyPI.

ROS's generators are on PyPI. They are installed into an environment of their own, in the user's folder for caches; what they
generate becomes a wheel, which pip installs, and removes: ``pip uninstall turtlebot-gym-interfaces``.

References:
    Geometry2, ``tf2_msgs/msg/TFMessage.msg``; Nav2, ``nav2_msgs/action/NavigateToPose.action``; ROS 2 Jazzy and Kilted. Names
    and types of the fields are part of a type's hash, so they are those of the distribution.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import platform
import re
import shutil
import subprocess
import sys
import sysconfig
import venv
import zipfile
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, distributions, version
from importlib.util import find_spec
from pathlib import Path

DISTRIBUTIONS = ("jazzy", "kilted")
TRANSFORMS = "geometry_msgs/TransformStamped[] transforms\n"
GOAL = "geometry_msgs/PoseStamped pose\nstring behavior_tree\n"
RESULT = {"jazzy": "uint16 error_code\n", "kilted": "uint16 error_code\nstring error_msg\n"}
FEEDBACK = """geometry_msgs/PoseStamped current_pose
builtin_interfaces/Duration navigation_time
builtin_interfaces/Duration estimated_time_remaining
int16 number_of_recoveries
float32 distance_remaining
"""
GENERATORS = (
    "rosidl-default-generators", "rosidl-core-generators", "ament-cmake", "ament-cmake-ros", "ament-cmake-include-directories",
    "ament-cmake-gtest", "ament-cmake-gmock", "ament-cmake-pytest", "ament-package", "python-cmake-module", "rclpy[fastrtps]",
    "geometry-msgs", "action-msgs",
)  # fmt: skip
"""Packages of a distribution from which interfaces are generated."""
TOOLS = ("empy==3.3.4", "lark", "catkin_pkg", "setuptools<80", "numpy")
NEEDS = ("geometry_msgs", "builtin_interfaces", "action_msgs")
PACKAGE = """<?xml version="1.0"?>
<package format="3">
  <name>{name}</name><version>{version}</version><description>Generated interfaces</description>
  <maintainer email="turtlebot-gym@users.noreply.github.com">The turtlebot-gym authors</maintainer><license>MIT</license>
  <buildtool_depend>ament_cmake</buildtool_depend><buildtool_depend>rosidl_default_generators</buildtool_depend>
  {needs}<exec_depend>rosidl_default_runtime</exec_depend>
  <member_of_group>rosidl_interface_packages</member_of_group><export><build_type>ament_cmake</build_type></export>
</package>
"""
CMAKE = """cmake_minimum_required(VERSION 3.8)
project({name})
find_package(ament_cmake REQUIRED)
find_package(rosidl_default_generators REQUIRED)
{needs}rosidl_generate_interfaces(${{PROJECT_NAME}} "{file}" DEPENDENCIES {names})
ament_package()
"""
VERSION = "0.1.0"
WHEEL = "turtlebot_gym_interfaces"


def definitions(distribution: str) -> dict[str, tuple[str, str]]:
    """Return the file and the text of each package's interface."""
    action = "---\n".join((GOAL, RESULT[distribution], FEEDBACK))
    return {"tf2_msgs": ("msg/TFMessage.msg", TRANSFORMS), "nav2_msgs": ("action/NavigateToPose.action", action)}


def installed_distribution() -> str:
    """Return the ROS distribution whose wheels are installed.

    Raises:
        ValueError: If there is none, so that ROS, if any, comes from an installation.
    """
    for name in DISTRIBUTIONS:
        try:
            version(f"ros-{name}-rclpy")
        except PackageNotFoundError:
            continue
        return name
    ros = os.environ.get("ROS_DISTRO", "DISTRO")
    raise ValueError(
        f"interfaces are built for the ROS of PyPI, which is not installed here; with a ROS installation: "
        f"sudo apt install ros-{ros}-nav2-msgs ros-{ros}-tf2-msgs"
    )


def _pinned() -> list[str]:
    """Return the installed ROS packages with their versions, since what is generated is linked against them."""
    versions = {distribution.metadata["Name"]: distribution.version for distribution in distributions()}
    return sorted(f"{name}=={version}" for name, version in versions.items() if name.startswith("ros-"))


def build(*, say: bool = False) -> Path:
    """Build the interfaces, unless that was done before, and return the wheel.

    Args:
        say: Whether to print what is done.

    Raises:
        ValueError: If a tool is missing, or a step fails; the message has its last lines.
    """
    distribution = installed_distribution()
    missing = [tool for tool in ("cmake", "make", "g++") if not shutil.which(tool)]
    if not Path(sysconfig.get_path("include"), "Python.h").exists():
        missing.append("Python.h")
    if missing:
        raise ValueError(f"{', '.join(missing)} missing: sudo apt install cmake g++ make python3-dev")
    tag = f"cp{sys.version_info.major}{sys.version_info.minor}"
    wheel = f"{WHEEL}-{VERSION}+{distribution}-{tag}-{tag}-linux_{platform.machine()}.whl"
    made_of = definitions(distribution), PACKAGE, CMAKE, GENERATORS, TOOLS, _pinned(), wheel
    key = hashlib.sha256(repr(made_of).encode()).hexdigest()[:16]
    folder = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "turtlebot_gym" / f"interfaces-{key}"
    if (made := folder / wheel).exists():
        return made
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    tell = print if say else lambda text: None
    tell(f"installing ROS's generators into {folder} ...")
    python = _install_generators(folder, distribution)
    for name, (file, text) in definitions(distribution).items():
        tell(f"building {name} ...")
        _generate(folder, python, name, file, text)
    _pack(folder / "out", made.with_suffix(".part"), distribution, f"{tag}-{tag}-linux_{platform.machine()}")
    made.with_suffix(".part").rename(made)
    for package in ("tools", "nav2_msgs", "tf2_msgs"):
        shutil.rmtree(folder / package)
    return made


def _install_generators(folder: Path, distribution: str) -> Path:
    """Install the generators into an environment in a folder, and return its Python."""
    tools = folder / "tools"
    venv.create(tools, with_pip=True)
    python, pinned = tools / "bin" / "python", folder / "pinned.txt"
    pinned.write_text("\n".join(_pinned()) + "\n")
    names = [f"ros-{distribution}-{name}" for name in GENERATORS]
    _run(python, "-m", "pip", "install", "-q", "--disable-pip-version-check", "-c", pinned, *names, *TOOLS)
    at = f"python{sys.version_info.major}.{sys.version_info.minor}"
    places = {"include": sysconfig.get_path("include"), "lib": str(tools / "lib" / at)}
    for file in tools.glob("share/**/*.cmake"):  # they name the folders of the Python with which the wheels were made
        text = file.read_text()
        movable = re.sub(rf"/opt/python/[^/]+/(include|lib)/{re.escape(at)}", lambda match: places[match[1]], text)
        if movable != text:
            file.write_text(movable)
    return python


def _generate(folder: Path, python: Path, name: str, file: str, text: str) -> None:
    """Generate, compile and install a package of interfaces into ``folder / "out"``."""
    source, tools, out = folder / name, folder / "tools", folder / "out"
    (source / file).parent.mkdir(parents=True)
    (source / file).write_text(text)
    depends = "".join(f"<depend>{package}</depend>" for package in NEEDS)
    (source / "package.xml").write_text(PACKAGE.format(name=name, version=VERSION, needs=depends))
    finds = "".join(f"find_package({package} REQUIRED)\n" for package in NEEDS)
    (source / "CMakeLists.txt").write_text(CMAKE.format(name=name, needs=finds, file=file, names=" ".join(NEEDS)))
    paths = {
        "AMENT_PREFIX_PATH": f"{tools}", "CMAKE_PREFIX_PATH": f"{tools}", "LD_LIBRARY_PATH": f"{tools / 'lib'}",
        "PATH": f"{tools / 'bin'}{os.pathsep}{os.environ['PATH']}", "_ROS_WHEELS_BOOTSTRAP_COMPLETE": "1",
    }  # fmt: skip
    made, options = source / "build", (f"-DCMAKE_INSTALL_PREFIX={out}", f"-DPython3_EXECUTABLE={python}", "-DBUILD_TESTING=OFF")
    _run("cmake", "-S", source, "-B", made, *options, **paths)
    _run("cmake", "--build", made, "--target", "install", "--parallel", str(os.cpu_count() or 1), **paths)


def _pack(out: Path, wheel: Path, distribution: str, tag: str) -> None:
    """Write what was installed as a wheel."""
    (site,) = {path.parent.parent for path in out.glob("**/nav2_msgs/__init__.py")}
    about, data = f"{WHEEL}-{VERSION}+{distribution}.dist-info", f"{WHEEL}-{VERSION}+{distribution}.data/data"
    files: dict[str, bytes] = {}
    for path in sorted(path for path in out.rglob("*") if path.is_file()):
        inside = path.is_relative_to(site)
        name = path.relative_to(site) if inside else Path(data) / path.relative_to(out)
        files[str(name)] = path.read_bytes()
    summary = f"nav2_msgs/action/NavigateToPose and tf2_msgs/msg/TFMessage of ROS 2 {distribution.title()}"
    name = WHEEL.replace("_", "-")
    files[f"{about}/METADATA"] = (
        f"Metadata-Version: 2.1\nName: {name}\nVersion: {VERSION}+{distribution}\nSummary: {summary}\n".encode()
    )
    files[f"{about}/WHEEL"] = f"Wheel-Version: 1.0\nGenerator: {name}\nRoot-Is-Purelib: false\nTag: {tag}\n".encode()
    files[f"{about}/RECORD"] = "".join(f"{name},,\n" for name in (*files, f"{about}/RECORD")).encode()
    with zipfile.ZipFile(wheel, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(name, content)


def _run(*command: str | Path, **environment: str) -> None:
    """Run a command, or raise a ``ValueError`` with its last lines."""
    without = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "PYTHONHOME")}
    done = subprocess.run(
        list(map(str, command)), stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env={**without, **environment},
        check=False,
    )  # fmt: skip
    if done.returncode:
        output = " ".join(" ".join(done.stdout.splitlines()[-5:]).split())
        raise ValueError(f"{' '.join(map(str, command[:4]))} failed: {output}")


def main(argv: Sequence[str] | None = None) -> int:
    """Build the interfaces and install them; return 0, or 2 with one line on stderr if that failed."""
    about = "Build nav2_msgs and tf2_msgs, which PyPI lacks, into this environment; a minute, with cmake and g++."
    parser = argparse.ArgumentParser(prog="interfaces", description=about)
    parser.parse_args(argv)
    installed = [name for name in ("nav2_msgs", "tf2_msgs") if find_spec(name)]
    if len(installed) == 2:
        print("nav2_msgs and tf2_msgs are installed.")
        return 0
    try:
        wheel = build(say=True)
        _run(sys.executable, "-m", "pip", "install", "-q", "--disable-pip-version-check", "--force-reinstall", wheel)
    except (ValueError, OSError) as error:
        print(f"error: {error}.", file=sys.stderr)
        return 2
    print(f"installed; to remove them: pip uninstall {WHEEL.replace('_', '-')}")
    return 0
