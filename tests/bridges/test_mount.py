"""The mount of the LiDAR by /tf_static: what the robot does depends on what is there, and not on how its LiDAR is mounted."""

import math
from types import SimpleNamespace

import numpy as np
from burger import Parameters
from geometry_msgs.msg import Transform, TransformStamped
from std_msgs.msg import Header

from cmd_vel_guard.arbiter import Arbiter
from cmd_vel_guard.collision import RawScan
from turtlebot_gym.estimation.ekf import Estimate
from turtlebot_gym.mounts import StaticFrames
from turtlebot_gym.rooms import scan as rooms
from turtlebot_gym.values import STOP, Belief, Command, Covariance, Pose, State
from turtlebot_gym_ros.blocks import TurtlebotSimulator, VelocityController
from turtlebot_gym_ros.node.block import Stamped

PRESET, OTHER = Pose(-0.032, 0.0, 0.0), Pose(0.05, -0.04, 2.0)
"""Where a Burger's LiDAR is, and where somebody else mounted it."""
BEAMS, T = 3600, 100.0


def test_a_simulated_scan_has_the_frame_of_the_robot():
    for robot, frame in (("burger", "base_scan"), ("turtlebot4", "rplidar_link")):
        plant = TurtlebotSimulator(TurtlebotSimulator.Params(robot=robot, world="clutter"))
        assert plant.outputs["scan"].mount.frame == frame


def transform(parent, child, x, y, yaw):
    made = TransformStamped(header=Header(frame_id=parent), child_frame_id=child, transform=Transform())
    made.transform.translation.x, made.transform.translation.y, made.transform.translation.z = x, y, 0.1
    made.transform.rotation.w, made.transform.rotation.z = math.cos(0.5 * yaw), math.sin(0.5 * yaw)
    return made


def stated(mount):
    """Return the frames of a robot that states its LiDAR's mount, on a link of its own."""
    said = StaticFrames()
    chain = (
        transform("base_footprint", "base_link", 0.02, 0.01, 0.0),
        transform("base_link", "base_scan", mount.x - 0.02, mount.y - 0.01, mount.theta),
    )
    said.hear(SimpleNamespace(transforms=list(chain)))
    return lambda frame: said.mount("base_footprint", frame)


def unstated(frame):
    """Know of no mount."""


def ranges(mount, heading):
    """Return the ranges of a LiDAR in a room of 3 m by 2 m, whose wall is 0.3 m below a robot with a heading."""
    at = (mount.x + 1j * mount.y) * np.exp(1j * heading)
    ways = np.exp(1j * (heading + mount.theta + 2.0 * math.pi * np.arange(BEAMS) / BEAMS))
    with np.errstate(divide="ignore"):
        x = (np.where(ways.real > 0.0, 2.0, -1.0) - at.real) / ways.real
        y = (np.where(ways.imag > 0.0, 1.7, -0.3) - at.imag) / ways.imag
    return np.minimum(np.abs(x), np.abs(y)).astype(np.float32)


def commands(mount, mount_of, heading, **parameters):
    """Return the policy's command, the monitor's verdict on one, and the monitor, with a LiDAR at a mount."""
    lengths = ranges(mount, heading)
    controller = VelocityController(VelocityController.Params(policy="vfh", goal_tolerance=0.0))
    estimate = Estimate(Belief(State(0.0, 0.0, 0.0, 0.0, 0.0), Covariance(**dict.fromkeys(Covariance._fields, 0.01))), 0.0, 0.0)
    seen = Stamped(rooms.Scan(lengths, 0.0, 2.0 * math.pi / BEAMS, 0.01, 8.0), 0.0, mount_of("base_scan"))
    driven = controller.step(0.1, estimate, Pose(1.0, 0.0, 0.0), None, scan=seen)["command"]
    arbiter = Arbiter(Parameters(collision_monitor=True, **parameters), T, mount_of)
    arbiter.hear_scan(RawScan(lengths, 0.0, 2.0 * math.pi / BEAMS, 0.01, 8.0, "base_scan"), T)
    return driven, arbiter.monitor.limit(Command(0.2, 0.2), T), arbiter.monitor


HEADINGS = np.linspace(-math.pi, math.pi, 24, endpoint=False)


def test_with_its_mount_stated_a_lidar_may_be_anywhere():
    """A policy's sectors have corners that move a little with the LiDAR, and the monitor's error grows with a point's range."""
    for heading in HEADINGS:
        expected, got = commands(PRESET, unstated, heading)[:2], commands(OTHER, stated(OTHER), heading)[:2]
        np.testing.assert_allclose(np.divide(got, (0.21, 2.6)), np.divide(expected, (0.21, 2.6)), rtol=0.0, atol=0.05)


def test_another_mount_than_the_presets_is_reported_and_one_that_a_person_gave_is_not_overruled():
    *_, monitor = commands(OTHER, stated(OTHER), 0.0)
    where = "'base_scan' is at x 0.050 m, y -0.040 m, turned by 2.000 rad"
    assert (monitor.trouble(T), monitor.remark) == (
        "",
        f"/tf_static says that {where}, which is not the parameters' mount, and counts",
    )
    monitor._mount_of = unstated
    monitor.hear(RawScan(ranges(PRESET, 0.0), 0.0, 2.0 * math.pi / BEAMS, 0.01, 8.0, "base_scan"), sent=T + 0.1)
    assert monitor.remark == ""  # once it is stated no more
    given = {"scan_mount": "given", "scan_x": 0.05, "scan_y": -0.04, "scan_yaw": 2.0}
    assert commands(OTHER, stated(OTHER), 0.0, **given)[2].trouble(T) == ""
    *_, verdict, monitor = commands(OTHER, stated(OTHER), 0.0, **{**given, "scan_yaw": 0.0})
    assert verdict == STOP
    assert f"{where}, and the given mount is another: correct one" in monitor.trouble(T)
