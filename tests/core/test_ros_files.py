"""Robots and noise from a URDF, Nav2's parameters and robot_localization's: what is taken, and what is said."""

import math
from pathlib import Path

import numpy as np
import pytest

from turtlebot_gym import ROBOTS, make_noise, make_robot
from turtlebot_gym.notices import Notice
from turtlebot_gym.robots import LidarMount
from turtlebot_gym.ros_files.footprints import enclosing_circle

WORLDS = Path(__file__).parents[3] / "shared" / "data" / "worlds"
there = pytest.mark.skipif(not WORLDS.is_dir(), reason="the files of TurtleBot3 and Nav2 are not there")


def said(make, *arguments):
    """Return what is made, and what is said about it, in one text of a line each."""
    with pytest.warns(Notice) as notices:
        made = make(*arguments)
    texts = [str(notice.message) for notice in notices]
    assert not any("\n" in text for text in texts)
    return made, "\n".join(texts)


@there
def test_a_burgers_urdf_is_the_preset():
    robot, text = said(make_robot, WORLDS / "burger.urdf")
    preset = ROBOTS["burger"]
    assert (robot.wheel_separation, robot.lidar) == (preset.wheel_separation, preset.lidar)
    assert robot.radius == pytest.approx(preset.radius, abs=0.0011)
    assert robot.footprint_x == pytest.approx(preset.footprint_x, abs=0.0011)
    assert "wheel radius 0.033" in text
    assert "As burger, since not stated: max_linear, max_angular" in text


@there
def test_nav2s_parameters_give_limits_and_override_what_stands_before():
    robot, text = said(make_robot, f"waffle+{WORLDS / 'burger.urdf'}+{WORLDS / 'nav2_params.yaml'}")
    limits = (robot.max_linear, robot.max_angular, robot.max_linear_acceleration, robot.max_angular_acceleration)
    assert limits == (0.5, 1.9, 3.0, 3.5)  # the controller turns more slowly than the smoother allows
    assert (robot.reverse, robot.max_wheel, robot.radius, robot.wheel_separation) == (True, math.inf, 0.22, 0.16)
    assert "max_angular 1.9 (FollowPath.wz_max)" in text
    assert "not taken: another limit backwards, 0.35 m/s" in text


def nav2(folder, name="nav2.yaml", **nodes):
    """Write a file of ROS parameters, and return its path."""
    path = folder / name
    path.write_text("\n".join(f"{node}:\n  ros__parameters: {{{values}}}" for node, values in nodes.items()))
    return path


RPP = "nav2_regulated_pure_pursuit_controller::RegulatedPurePursuitController"


@pytest.mark.parametrize(
    ("nodes", "expected"),
    [
        (
            {"velocity_smoother": "max_velocity: [0.3, 0.0, 1.0], min_velocity: [0.0, 0.0, -1.0]"},
            {"max_linear": 0.3, "max_angular": 1.0, "reverse": False},
        ),
        (
            {"velocity_smoother": "max_velocity: [0.3, 0, 0, 0, 0, 1.1], max_accel: [1.0, 0, 0, 0, 0, 2.0]"},
            {"max_linear": 0.3, "max_angular": 1.1, "max_linear_acceleration": 1.0, "max_angular_acceleration": 2.0},
        ),
        (
            {
                "controller_server": "controller_plugins: [F], F.plugin: dwb_core::DWBLocalPlanner, F: {max_vel_x: 0.26, "
                "min_vel_x: 0.0, max_vel_theta: 1.0, acc_lim_x: 2.5}"
            },
            {"max_linear": 0.26, "max_angular": 1.0, "reverse": False, "max_linear_acceleration": 2.5},
        ),
        (
            {"controller_server": f"FollowPath: {{plugin: {RPP}, desired_linear_vel: 0.4, allow_reversing: true}}"},
            {"max_linear": 0.4, "reverse": True},
        ),
        (
            {
                "controller_server": "FollowPath: {plugin: nav2_rotation_shim_controller::RotationShimController, "
                "primary_controller: nav2_graceful_controller::GracefulController, v_linear_max: 0.4, v_angular_max: 0.9}"
            },
            {"max_linear": 0.4, "max_angular": 0.9, "reverse": False},
        ),
        (
            {"local_costmap": 'footprint: "[[0.2, 0.1], [0.2, -0.1], [-0.4, -0.1], [-0.4, 0.1]]", robot_radius: 9.0'},
            {"footprint_x": -0.1, "radius": 0.317},
        ),
    ],
)
def test_each_controllers_own_names_are_known(tmp_path, nodes, expected):
    robot, _ = said(make_robot, str(nav2(tmp_path, **nodes)))
    assert {name: getattr(robot, name) for name in expected} == pytest.approx(expected)


URDF = """<robot name="r"><link name="base_link">
<collision><origin xyz="0.1 0 0.2"/><geometry>{shape}</geometry></collision></link>
{wheels}<link name="{lidar}"/><joint name="s" type="fixed"><parent link="base_link"/><child link="{lidar}"/>
<origin xyz="0.3 0 0.4" rpy="{tilt}"/></joint></robot>"""
WHEEL = """<link name="{0}"><collision><geometry><cylinder radius="0.1" length="0.04"/></geometry></collision></link>
<joint name="{0}_joint" type="continuous"><parent link="base_link"/><child link="{0}"/><axis xyz="0 1 0"/>
<origin xyz="{1} {2} 0.1"/><limit velocity="8" effort="1"/></joint>"""


def urdf(folder, *, shape='<box size="0.6 0.4 0.2"/>', at=0.1, lidar="laser", tilt="0 0 3.14159265", name="r.urdf", more=""):
    """Write the URDF of a robot with four wheels and a caster, and return its path."""
    places = [(f"wheel_{k}", at + x, y) for k, (x, y) in enumerate([(0.2, 0.25), (0.2, -0.25), (-0.2, 0.25), (-0.2, -0.25)])]
    wheels = "".join(WHEEL.format(*place) for place in [*places, ("caster_wheel", -0.3, 0.1)])
    path = folder / name
    path.write_text(URDF.format(shape=shape, wheels=wheels + more, lidar=lidar, tilt=tilt))
    return path


def test_wheels_mount_and_footprint_are_about_the_axle(tmp_path):
    robot, text = said(make_robot, urdf(tmp_path))
    assert (robot.wheel_separation, robot.max_wheel) == (0.5, pytest.approx(0.8))
    assert robot.lidar == LidarMount(frame="laser", x=0.2, yaw=3.141593)
    assert math.hypot(0.3 - robot.footprint_x, 0.25) <= robot.radius + 1e-9  # the foremost wheels' edge, ahead of the axle
    assert robot.footprint_x + 0.5 <= robot.radius + 1e-9  # the caster's
    assert robot.radius < 0.47
    assert "not taken: the base's origin, -0.1 m ahead of the axle" in text


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"lidar": "camera"}, "a LiDAR: no link has the name of one"),
        ({"tilt": "3.14159 0 0"}, "the LiDAR laser, which is tilted or upside down"),
        (
            {"shape": '<mesh filename="package://r/body.stl"/>'},
            "the collision of base_link: there is no mesh 'package://r/body.stl'",
        ),
    ],
)
def test_what_a_urdf_lacks_is_said(tmp_path, changes, message):
    assert message in said(make_robot, urdf(tmp_path, **changes))[1]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"name": "r.urdf.xacro"}, r"r.urdf.xacro: it is a xacro file; .* xacro FILE > robot.urdf"),
        ({"tilt": "0 0 ${pi / 2}"}, "it is a xacro file"),
        ({"more": '<x:include xmlns:x="http://ros.org/wiki/xacro" filename="wheels.xacro"/>'}, "it is a xacro file"),
        ({"shape": '<box size="1 2"/>'}, "'1 2' must be 3 finite numbers"),
        ({"more": "<link"}, "it is no URDF"),
    ],
)
def test_other_descriptions_are_refused(tmp_path, changes, message):
    with pytest.raises(ValueError, match=message):
        make_robot(urdf(tmp_path, **changes))


def test_a_description_of_an_arm_is_no_robot_on_wheels(tmp_path):
    (tmp_path / "arm.urdf").write_text('<robot name="arm"><link name="base"/></robot>')
    with pytest.raises(ValueError, match=r"arm\.urdf: it says nothing of a robot on two wheels: wheels: no continuous joints"):
        make_robot(str(tmp_path / "arm.urdf"))


@there
@pytest.mark.parametrize(
    ("make", "name", "message"),
    [
        (make_robot, "ekf.yaml", "ekf.yaml: it states no limit and no footprint"),
        (make_noise, "nav2_params.yaml", "no node in it has an odom0, as robot_localization's ekf_node has"),
        (make_robot, "nowhere.urdf", "there is no such file"),
    ],
)
def test_the_wrong_file_is_refused(make, name, message):
    with pytest.raises(ValueError, match=message):
        make(WORLDS / name)


@there
def test_an_ekfs_parameters_give_the_noise_of_the_twist():
    noise, text = said(make_noise, WORLDS / "ekf.yaml")
    assert noise.process.alpha1 * 0.2**2 == pytest.approx(0.025 * 0.1)  # per s, and here per step of 0.1 s
    assert noise.process.alpha4 == pytest.approx(0.02 * 0.1)
    assert not noise.odometry.wheel
    assert "Not taken: R, which messages state and this file does not" in text
    assert "the sensors imu0, odom1, pose0, twist0" in text


@pytest.mark.parametrize(("fused", "wheel"), [((6, 11), True), ((0, 1, 5), False)])
def test_what_is_fused_decides_on_the_odometry(tmp_path, fused, wheel):
    config = str([at in fused for at in range(15)]).lower()
    diagonal = str([0.0] * 6 + [0.04] + [0.0] * 8)
    path = nav2(tmp_path, ekf_node=f"odom0: /odom, odom0_config: {config}, process_noise_covariance: {diagonal}")
    noise, _ = said(make_noise, path)
    assert (noise.odometry.wheel, noise.process.alpha1) == (wheel, pytest.approx(0.1))
    with pytest.raises(ValueError, match="process_noise_covariance must be 15 x 15 numbers or the 15 of its diagonal"):
        make_noise(nav2(tmp_path, ekf_node="odom0: /odom, process_noise_covariance: [1.0]"))


def test_the_circle_encloses_all_points():
    points = np.random.default_rng(0).uniform(-0.3, 0.2, (50, 2))
    x, radius = enclosing_circle(points)
    assert np.hypot(points[:, 0] - x, points[:, 1]).max() <= radius
    assert all(np.hypot(points[:, 0] - x - d, points[:, 1]).max() > radius - 2e-3 for d in (-0.01, 0.01))
