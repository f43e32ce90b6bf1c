"""A map as a message: cell by cell, where it lies, said once, and kept for whoever comes late."""

import math

import numpy as np
import pytest
from bench import over_the_wire
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import Header

from turtlebot_gym.rooms.grid import GridMap
from turtlebot_gym.values import Pose
from turtlebot_gym_ros.node.convert import conversion

WAY = conversion(GridMap)
LATE = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
HALL = np.full((60, 80), 254, np.uint8)
HALL[0, :] = HALL[-1, :] = HALL[:, 0] = HALL[:, -1] = 0
HALL[:38, 40:43] = 0
HALL[48:52, 12:19] = 0
HALL[30:36, 62:] = 205
"""Pixels of a hall of 8 m by 6 m, the first row the highest; no mirror image of it is the same."""
ORIGIN = (-2.0, -4.0, 0.7)


@pytest.fixture
def hall(tmp_path, write_map):
    """The path of the map, turned by 0.7 rad."""
    return write_map(tmp_path, HALL, resolution=0.1, origin=list(ORIGIN))


def value_at(message, x, y):
    """Return the value of the cell around a point of the world, by the definition of the message; None outside of it."""
    info = message.info
    yaw = 2.0 * math.atan2(info.origin.orientation.z, info.origin.orientation.w)
    away = complex(x - info.origin.position.x, y - info.origin.position.y) * np.exp(-1j * yaw)
    column, row = math.floor(away.real / info.resolution), math.floor(away.imag / info.resolution)
    inside = 0 <= column < info.width and 0 <= row < info.height
    return message.data[row * info.width + column] if inside else None


@pytest.mark.parametrize(("rows", "columns", "resolution", "yaw"), [(1, 1, 0.05, 0.0), (7, 4, 0.1, 0.7), (30, 41, 0.037, -3.1)])
def test_a_map_travels_cell_by_cell(rows, columns, resolution, yaw):
    cells = np.random.default_rng(rows).choice([0, 100, -1, 40], (rows, columns)).astype(np.int8)
    cells[0, 0] = 0
    grid = GridMap(cells=cells, resolution=resolution, origin=Pose(-1.7, 0.3, yaw))
    message = over_the_wire(WAY.write(grid, Header(frame_id="odom")))
    back = WAY.read(message)
    np.testing.assert_array_equal(back.cells, cells)
    assert (back.resolution, back.origin) == (resolution, grid.origin)
    for row, column in np.ndindex(rows, columns):
        across = complex(column + 0.5, row + 0.5) * resolution * np.exp(1j * yaw)
        assert value_at(message, -1.7 + across.real, 0.3 + across.imag) == cells[row, column]


def a_message():
    return WAY.write(GridMap(cells=np.zeros((2, 3), np.int8), resolution=0.1), Header())


def test_the_localizer_in_the_graph_is_the_environments(compare, hall):
    drive = compare.RoomDrive(world=str(hall), noise="wheel", seed=3, localizer="match")
    expected = compare.first(compare.room_episode(drive), 60)
    differ = compare.room_differences(expected, compare.room_live(drive, 60))
    assert max(differ.values()) == 0.0, differ
    other = compare.first(compare.room_episode(drive._replace(localizer=None)), 60)
    assert compare.room_differences(expected, other)["estimate"] > 1e-3
