"""The robots of this project behind the guard: their footprints and mounts, as presets and as files."""

import math
from dataclasses import replace

import pytest
from guarded import Parameters, numbers_of

from cmd_vel_guard.arbiter import Arbiter
from cmd_vel_guard.collision import Footprint
from cmd_vel_guard.values import Mount
from turtlebot_gym import write_parameters
from turtlebot_gym.robots import ROBOTS, LidarMount

T = 100.0


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


def test_a_robot_is_one_entry_for_the_monitor_too(monkeypatch, tmp_path):
    """As a preset and as a file."""
    scout = replace(ROBOTS["waffle"], radius=0.2, footprint_x=-0.01, lidar=LidarMount(frame="laser", x=0.1, yaw=0.5))
    monkeypatch.setitem(ROBOTS, "scout", scout)
    write_parameters(scout, tmp_path / "scout.yaml")
    for robot in ("scout", str(tmp_path / "scout.yaml")):
        monitor = Arbiter(Parameters(collision_monitor=True, robot=robot), T).monitor
        assert monitor._body == Footprint(0.2, -0.01, Mount("laser", 0.1, 0.0, 0.5))


def test_the_limits_of_a_robot_in_a_file_hold(tmp_path):
    path = tmp_path / "own.yaml"
    path.write_text("{max_linear: 0.07, max_angular: 0.5, radius: 0.2}")
    without_lidar = Arbiter(Parameters(robot=str(path), collision_monitor=True), T)
    assert without_lidar._robot.max_linear == 0.07
    assert without_lidar.monitor is None
    mount = {"collision_monitor": True, "scan_mount": "given", "scan_x": 0.1}
    assert Arbiter(Parameters(robot=str(path), **mount), T).monitor._body.radius == 0.2
    with pytest.raises(ValueError, match="There is no robot file"):
        Parameters(robot=str(tmp_path / "none.yaml"))


def test_a_name_that_is_no_robot_here_may_be_one_elsewhere():
    assert numbers_of("somebody's") is None
