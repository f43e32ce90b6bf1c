"""Shortest ways, against scipy's Dijkstra on the same cells."""

import math

import numpy as np
import pytest
import shapely
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from turtlebot_gym.rooms.drawing import draw
from turtlebot_gym.rooms.geodesic import UNKNOWN, block, centre_of, spread, way_left
from turtlebot_gym.rooms.plan import FloorPlan
from turtlebot_gym.rooms.rules import ROOMS
from turtlebot_gym.rooms.scene import UNREACHED

BLOCKED = 65534


@pytest.mark.parametrize("name", ["dense", "office"])
@pytest.mark.parametrize("key", [3, 4])
def test_lengths_are_those_of_dijkstra(empty_scene, name, key):
    scene = empty_scene(name)
    _, goal = draw(scene, ROOMS[name], 0.105, key)
    free = scene.ways != BLOCKED
    rows, columns = free.shape
    number = np.arange(rows * columns).reshape(rows, columns)
    ends, lengths = [], []
    for down, right, length in ((0, 1, 5), (1, 0, 5), (1, 1, 7), (1, -1, 7)):
        one = number[: rows - down, max(-right, 0) : columns - max(right, 0)]
        other = number[down:, max(right, 0) : columns - max(-right, 0)]
        both = free.ravel()[one] & free.ravel()[other]
        ends.append(np.stack([one[both], other[both]]))
        lengths.append(np.full(both.sum(), length))
    (one, other), length = np.concatenate(ends, axis=1), np.concatenate(lengths)
    graph = coo_array((length, (one, other)), shape=(number.size, number.size))
    row, column = int((goal.y + scene.walls[3]) / 0.1), int((goal.x + scene.walls[2]) / 0.1)
    expected = dijkstra(graph, directed=False, indices=number[row, column]).reshape(rows, columns)
    reached = free & np.isfinite(expected)
    np.testing.assert_array_equal(scene.ways[reached], expected[reached])
    assert (scene.ways[free & ~reached] == UNREACHED).all()


def test_cells_are_blocked_within_the_clearance_and_no_farther():
    plan = FloorPlan(walls=(0.0, 0.0, 1.5, 1.0), circles=((0.4, 0.1, 0.2),), boxes=((-0.7, 0.0, 0.4, 0.6, 0.5),))
    scene = plan.scene()
    block(scene, 0.25)
    solid = shapely.union_all(
        [
            shapely.Point(0.4, 0.1).buffer(0.2, quad_segs=2000),
            shapely.affinity.rotate(shapely.box(-0.9, -0.3, -0.5, 0.3), 0.5, use_radians=True, origin=(-0.7, 0.0)),
            shapely.box(-1.5, -1.0, 1.5, 1.0).exterior,
        ]
    )
    for row in range(20):
        for column in range(30):
            x, y = centre_of(scene, row, column)
            assert (x, y) == pytest.approx((-1.45 + 0.1 * column, -0.95 + 0.1 * row))
            near = shapely.Point(x, y).distance(solid)
            assert (scene.ways[row, column] == BLOCKED) == (near < 0.25) or abs(near - 0.25) < 1e-6


def test_the_way_round_a_wall_is_as_long_as_it_is():
    """From (-1, 0) to (1, 0) round the end of a wall at x = 0 that begins at y = 0.5 with a robot that keeps 0.2 m."""
    plan = FloorPlan(walls=(0.0, 0.0, 2.0, 2.0), boxes=((0.0, -0.75, 0.1, 2.5),))
    scene = plan.scene()
    block(scene, 0.2)
    spread(scene, 1.0, 0.0)
    shortest = 2.0 * math.hypot(1.0, 0.7)
    assert shortest < way_left(scene, -1.0, 0.0) < 1.09 * shortest  # eight directions cost up to 8 %
    assert way_left(scene, 1.0, 0.5) == pytest.approx(0.5, abs=0.1)
    assert way_left(scene, 0.0, -1.0) == UNKNOWN  # in the wall


def test_the_way_left_changes_smoothly():
    scene = FloorPlan(walls=(0.0, 0.0, 2.0, 2.0)).scene()
    block(scene, 0.2)
    spread(scene, 1.5, 0.0)
    lengths = np.array([way_left(scene, x, 0.013) for x in np.linspace(-1.5, 1.0, 500)])
    assert np.diff(lengths).max() < 0.006
    assert np.diff(lengths).min() > -0.015  # a step is 0.005 m; where other cells come near, it is up to 0.01 m more
