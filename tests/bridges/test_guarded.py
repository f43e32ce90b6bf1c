"""The robots of this project behind the guard: their footprints, mounts and limits."""

import math
from pathlib import Path

import yaml

from cmd_vel_guard.arbiter import Arbiter
from cmd_vel_guard.collision import Footprint
from cmd_vel_guard.parameters import Parameters
from cmd_vel_guard.values import Mount
from turtlebot_gym.robots import ROBOTS, LidarMount

T = 100.0
CONFIG = Path(__file__).parents[2] / "bridges/cmd_vel_guard/config"
SAFE = {"start_enabled": False, "require_emergency_stop": True, "require_standby": True}


def test_the_footprints_hold_the_bodies():
    """Corners of the bodies and of the wheels in the robots' URDF, m; to a millimetre."""
    corners = {
        "burger": (0.105, [(-0.102, 0.07), (0.038, 0.07), (0.033, 0.089), (-0.033, 0.089)]),
        "waffle": (0.22, [(-0.197, 0.133), (0.069, 0.133), (0.033, 0.153), (-0.033, 0.153)]),
        "turtlebot4": (0.171, [(-0.17, 0.0), (0.17, 0.0), (0.0, 0.17)]),
    }
    for robot, (radius, places) in corners.items():
        assert ROBOTS[robot].radius == radius
        assert all(math.hypot(x - ROBOTS[robot].footprint_x, y) <= radius + 0.001 for x, y in places), robot
    assert ROBOTS["burger"].lidar == ROBOTS["tutorial"].lidar == LidarMount(frame="base_scan", x=-0.032)
    assert ROBOTS["waffle"].lidar == LidarMount(frame="base_scan", x=-0.064)
    assert ROBOTS["turtlebot4"].lidar == LidarMount(frame="rplidar_link", x=-0.04, yaw=math.pi / 2.0)


def test_the_guards_files_have_the_numbers_of_the_presets():
    for path in CONFIG.glob("*.yaml"):
        known, robot = yaml.safe_load(path.read_text())["/**/cmd_vel_guard"]["ros__parameters"], ROBOTS[path.stem]
        limits = ("max_linear", "max_angular", "max_wheel", "wheel_separation", "radius", "footprint_x")
        mount = {f"scan_{part}": getattr(robot.lidar, part) for part in ("frame", "x", "yaw")}
        assert known == {limit: getattr(robot, limit) for limit in limits} | mount | SAFE
        assert robot.reverse
        assert robot.lidar.y == 0.0
        mount = Mount(robot.lidar.frame, robot.lidar.x, 0.0, robot.lidar.yaw)
        monitor = Arbiter(Parameters(**known), T).monitor
        assert monitor._body == Footprint(
            robot.radius, robot.footprint_x, Mount(robot.lidar.frame, robot.lidar.x, 0.0, robot.lidar.yaw)
        )
