"""The blocks in a room, in a ``for`` loop: what they hand to each other is the environment's to the bit."""

import pytest

import turtlebot_gym  # noqa: F401  # registers the environments
from turtlebot_gym.rooms.lidar import LIDARS
from turtlebot_gym.values import STOP
from turtlebot_gym_ros.blocks import KalmanFilter, TurtlebotSimulator, VelocityController, WaypointGenerator
from turtlebot_gym_ros.node.block import Stamped

DT = 0.1


def make(block, **parameters):
    return block(block.Params(**parameters))


class Loop:
    """The four blocks, driven as lock-step drives them."""

    def __init__(self, *, world, lidar, seed, noise="tutorial", policy="vfh"):
        self.plant = make(TurtlebotSimulator, world=world, lidar=lidar, seed=seed, noise=noise)
        self.filter = make(KalmanFilter, noise=noise)
        self.generator = make(WaypointGenerator, waypoints="room")
        lidar_parameters = {"lidar_yaw": LIDARS[lidar].yaw, "lidar_beams": LIDARS[lidar].beams}
        self.controller = make(VelocityController, policy=policy, noise=noise, goal_tolerance=0.0, **lidar_parameters)
        self.command, self.scan, self.at, self.stamp = None, None, 0, 0
        self.frozen = False

    def step(self):
        """Take one step, and return what the plant said; stamps are whole nanoseconds, as in messages."""
        values = self.plant.step(DT, self.command)
        now = self.at * 100_000_000
        if "scan" in values:
            self.scan = self.scan if self.frozen else values["scan"].value
            self.stamp = now - round(values["scan"].age * 1e9)
        estimate = self.filter.step(DT if self.at else 0.0, values["odometry"])["estimate"]
        way = self.generator.step(DT, estimate, None, values["goal"])
        scan = Stamped(self.scan, (now - self.stamp) / 1e9)
        self.command = self.controller.step(DT, estimate, **way, scan=scan)["command"]
        self.at += 1
        return values


@pytest.mark.parametrize("lidar", ["lds01", "ideal"])
def test_a_policy_does_not_drive_by_a_frozen_lidar(lidar):
    loop = Loop(world="dense", lidar=lidar, seed=3)
    for _ in range(30):
        loop.step()
        assert loop.controller.notice is None
    loop.frozen = True
    for _ in range(12):
        loop.step()
    assert loop.command == STOP
    assert "the LiDAR is frozen" in loop.controller.notice
    loop.frozen = False
    for _ in range(4):
        loop.step()
    assert loop.controller.notice is None
