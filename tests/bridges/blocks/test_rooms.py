"""The blocks in a room, in a ``for`` loop: a frozen LiDAR, and the map of a drawn room."""

import numpy as np
import pytest

import turtlebot_gym  # noqa: F401  # registers the environments
from turtlebot_gym.rooms.lidar import LIDARS
from turtlebot_gym.values import STOP
from turtlebot_gym_ros.blocks import KalmanFilter, TurtlebotSimulator, VelocityController, WaypointGenerator
from turtlebot_gym_ros.node.block import Stamped

DT = 0.1


@pytest.mark.parametrize("lidar", ["lds01", "ideal"])
def test_a_policy_does_not_drive_by_a_frozen_lidar(lidar):
    """The four blocks, driven as lock-step drives them."""
    plant = TurtlebotSimulator(TurtlebotSimulator.Params(world="dense", lidar=lidar, seed=3))
    estimator, generator = KalmanFilter(KalmanFilter.Params()), WaypointGenerator(WaypointGenerator.Params(waypoints="room"))
    seen = {"lidar_yaw": LIDARS[lidar].yaw, "lidar_beams": LIDARS[lidar].beams}
    controller = VelocityController(VelocityController.Params(policy="vfh", goal_tolerance=0.0, **seen))
    command, scan, measured = None, None, 0.0
    for k in range(46):
        frozen, values = 30 <= k < 42, plant.step(DT, command)
        if "scan" in values:
            scan = scan if frozen else values["scan"].value
            measured = DT * k - values["scan"].age
        estimate = estimator.step(DT * (k > 0), values["odometry"])["estimate"]
        way = generator.step(DT, estimate, None, values["goal"])
        command = controller.step(DT, estimate, **way, scan=Stamped(scan, DT * k - measured))["command"]
        if k < 30 or k == 45:
            assert controller.notice is None
        if k == 41:
            assert command == STOP
            assert "the LiDAR is frozen" in controller.notice


def test_a_drawn_room_has_the_map_of_the_environments_localizer_anew_in_each_episode():
    node = TurtlebotSimulator(TurtlebotSimulator.Params(world="dense", noise="wheel", localizer="match", goals=2, seed=3))
    fields = []
    for _ in range(2):
        field = node.step(0.1, None)["map"].field()
        np.testing.assert_array_equal(field, node._episode.scene.memory.field)
        assert "map" not in node.step(0.1, None)
        fields.append(field)
        node.reset()
    assert (fields[0] != fields[1]).any()
