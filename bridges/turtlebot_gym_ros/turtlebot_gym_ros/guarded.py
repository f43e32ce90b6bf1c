"""The robots of this project for ``cmd_vel_guard``, which finds this function by an entry point of ``cmd_vel_guard.robots``."""

from __future__ import annotations

from turtlebot_gym.files import is_file
from turtlebot_gym.presets import make_robot
from turtlebot_gym.robots import ROBOTS


def numbers_of(name: str) -> dict[str, object] | None:
    """Return a robot's numbers by the names of the guard's parameters; None for a name that is neither a preset nor a file.

    Raises:
        ValueError: If the file has no robot.
    """
    if name not in ROBOTS and not is_file(name):
        return None
    robot = make_robot(name)
    limits = ("max_linear", "max_angular", "max_wheel", "wheel_separation", "reverse", "radius", "footprint_x")
    mount = {f"scan_{part}": getattr(robot.lidar, part) for part in ("frame", "x", "y", "yaw")}
    return {name: getattr(robot, name) for name in limits} | mount
