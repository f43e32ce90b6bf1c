"""A robot's installation: numpy and PyYAML, nothing that trains, draws or compiles, and the same numbers to the bit."""

import subprocess
import sys
from pathlib import Path

from thin import drive

TRAINS = ("llvmlite", "scipy", "gymnasium", "filterpy", "torch", "stable_baselines3", "onnx", "mujoco")
ABSENT = (*TRAINS, "matplotlib", "pygame", "PIL", "tyro", "rich")
ROS = ("rclpy", "geometry_msgs", "nav_msgs", "sensor_msgs", "diagnostic_msgs", "std_msgs", "std_srvs")
PROGRAM = Path(__file__).with_name("thin.py")
ROOT = Path(__file__).parents[2]


def run(*arguments):
    return subprocess.run([sys.executable, *arguments], capture_output=True, text=True, check=False, cwd=ROOT)


def without(body):
    """Return the arguments of a Python in which the packages of `ABSENT` are not installed."""
    return "-c", f"import sys; sys.path.insert(0, {str(PROGRAM.parent)!r}); import thin; import sys\n" + (
        f"sys.meta_path[:] = [thin.Without(finder, {ABSENT!r}) for finder in sys.meta_path]\n{body}"
    )


def test_filter_policy_and_guard_give_the_same_bits_without_what_trains_and_draws():
    done = run(str(PROGRAM), *ABSENT, *ROS)
    assert done.returncode == 0, done.stderr
    *lines, loaded = done.stdout.splitlines()
    assert [tuple(map(float.fromhex, line.split())) for line in lines] == drive()
    assert set(loaded.split()) <= {"numpy", "yaml"}
