"""Rays and shortest ways, against shapely, brute force and scipy's Dijkstra."""

import math

import numpy as np
import pytest
import shapely
from compiled_rooms import clearance_compiled, draw_compiled
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from turtlebot_gym.compiled.packing import as_tuple
from turtlebot_gym.rooms import rays
from turtlebot_gym.rooms.drawing import draw
from turtlebot_gym.rooms.geodesic import UNKNOWN, block, centre_of, spread, way_left
from turtlebot_gym.rooms.plan import FloorPlan
from turtlebot_gym.rooms.rules import ROOMS
from turtlebot_gym.rooms.scene import UNREACHED


def corners(box):
    """Return the corners of a row of `RoomShape.boxes`."""
    x, y, a, b, cosine, sine = box
    return [(x + cosine * u - sine * v, y + sine * u + cosine * v) for u, v in ((a, b), (-a, b), (-a, -b), (a, -b))]


def lengths_to_polygons(scene, x, y, dx, dy):
    """Return the lengths of rays to boxes and walls, and their distances, from shapely's intersections."""
    cx, cy, half_length, half_width = scene.room.walls
    room = shapely.box(cx - half_length, cy - half_width, cx + half_length, cy + half_width)
    solid = [shapely.Polygon(corners(box)) for box in scene.room.boxes[: scene.room.counts[1]]]
    surfaces = shapely.union_all([room.exterior, *solid])
    ends = np.stack([np.stack([x, y], -1), np.stack([x + 30.0 * dx, y + 30.0 * dy], -1)], 1)
    met = shapely.intersection(shapely.linestrings(ends), surfaces)
    return shapely.distance(shapely.points(x, y), met)


def lengths_to_circles(scene, x, y, dx, dy):
    """Return the lengths of rays to the circles, by the roots of |p + t d - c|^2 = r^2 that numpy finds."""
    shortest = np.full(x.shape, np.inf)
    for cx, cy, r, _, _ in scene.room.circles[: scene.room.counts[0]]:
        b, c = (x - cx) * dx + (y - cy) * dy, (x - cx) ** 2 + (y - cy) ** 2 - r * r
        with np.errstate(invalid="ignore"):
            root = np.sqrt(b * b - c)
        length = np.where(c <= 0.0, 0.0, np.where(-b - root >= 0.0, -b - root, np.inf))
        shortest = np.fmin(shortest, length)
    return shortest


@pytest.mark.nightly
@pytest.mark.parametrize("rooms", [60, pytest.param(250, marks=pytest.mark.nightly)])
def test_rays_agree_with_shapely(rooms, empty_scene, cast_all):
    """Rooms of all kinds; rays at random, along the axes, at corners, and a hair beside tangents."""
    random, tried, worst = np.random.default_rng(1), 0, 0.0
    names = ["dense", "office", "clutter", "crowd", "corridor"]
    for number in range(rooms):
        scene = empty_scene(names[number % len(names)])
        draw_compiled(scene, as_tuple(ROOMS[names[number % len(names)]]), 0.105, number)
        at = random.uniform(-0.98, 0.98, 2) * scene.room.walls[2:]
        angles = random.uniform(-math.pi, math.pi, 360)
        angles[:4] = 0.0, math.pi / 2.0, math.pi, -math.pi / 2.0
        aimed = []
        for x, y in (corner for box in scene.room.boxes[: scene.room.counts[1]] for corner in corners(box)):
            aimed += [math.atan2(y - at[1], x - at[0]) + beside for beside in (-1e-7, 1e-7)]
        for x, y, r, _, _ in scene.room.circles[: scene.room.counts[0]]:
            tangent = math.asin(min(r / math.dist((x, y), at), 1.0))  # at it, and at a corner, rounding decides
            aimed += [math.atan2(y - at[1], x - at[0]) + beside for beside in (tangent - 1e-7, tangent + 1e-7, 1e-7 - tangent)]
        angles = np.concatenate([angles, aimed])
        x, y = np.full(angles.size, at[0]), np.full(angles.size, at[1])
        dx, dy = np.cos(angles), np.sin(angles)
        distances = np.empty(angles.size)
        cast_all(scene, x, y, dx, dy, distances, 99.0)
        expected = np.minimum(lengths_to_polygons(scene, x, y, dx, dy), lengths_to_circles(scene, x, y, dx, dy))
        worst, tried = max(worst, float(np.abs(distances - expected).max())), tried + angles.size
    assert tried >= 360 * rooms
    assert worst < 1e-9


def test_clearance_agrees_with_shapely(empty_scene):
    random = np.random.default_rng(2)
    for number in range(60):
        scene = empty_scene("dense")
        draw_compiled(scene, as_tuple(ROOMS["dense"]), 0.105, number)
        cx, cy, half_length, half_width = scene.room.walls
        room = shapely.box(cx - half_length, cy - half_width, cx + half_length, cy + half_width)
        for x, y in random.uniform(-2.4, 2.4, (30, 2)):
            point = shapely.Point(x, y)
            apart = [point.distance(room.exterior)]
            apart += [math.hypot(x - c[0], y - c[1]) - c[2] for c in scene.room.circles[: scene.room.counts[0]]]
            apart += [point.distance(shapely.Polygon(corners(box))) for box in scene.room.boxes[: scene.room.counts[1]]]
            nearest = clearance_compiled(scene, x, y)
            assert nearest == pytest.approx(min(apart), abs=1e-9) or (nearest < 0.0 and min(apart) <= 0.0)


def test_distances_are_negative_inside():
    assert rays.distance_to_circle(3.0, 4.0, 2.0) == pytest.approx(3.0)
    assert rays.distance_to_circle(0.3, 0.4, 2.0) == pytest.approx(-1.5)
    assert rays.distance_to_box(4.0, 5.0, (0.0, 0.0, 1.0, 1.0, 1.0, 0.0)) == pytest.approx(5.0)
    assert rays.distance_to_box(0.2, 0.0, (0.0, 0.0, 1.0, 0.5, 1.0, 0.0)) == pytest.approx(-0.5)
    assert rays.distance_to_walls(0.5, 1.0, 2.0, 3.0) == pytest.approx(1.5)
    assert rays.distance_to_walls(2.5, 1.0, 2.0, 3.0) == pytest.approx(-0.5)


def test_what_is_near_enough_is_never_missed(empty_scene, cast_all):
    random, missed = np.random.default_rng(4), 0
    for number in range(40):
        scene = empty_scene("clutter")
        draw_compiled(scene, as_tuple(ROOMS["clutter"]), 0.105, number)
        x, y = (np.full(64, at) for at in random.uniform(-2.4, 2.4, 2))
        angles = random.uniform(-math.pi, math.pi, 64)
        whole, part = np.empty(64), np.empty(64)
        cast_all(scene, x, y, np.cos(angles), np.sin(angles), whole, 99.0)
        cast_all(scene, x, y, np.cos(angles), np.sin(angles), part, 1.2)
        near = whole <= 1.2
        np.testing.assert_array_equal(part[near], whole[near])
        assert (part[~near] >= whole[~near]).all()
        missed += int((part > whole).sum())
    assert missed > 50  # and what is far away costs nothing


@pytest.mark.parametrize("beams", [24, 36, 269, 360])
def test_leaving_out_obstacles_changes_no_bit(empty_scene, cast_all, beams):
    random = np.random.default_rng(beams)
    for number in range(60):
        name = ("clutter", "dense", "office", "cellular")[number % 4]
        scene = empty_scene(name)
        draw_compiled(scene, as_tuple(ROOMS[name]), 0.105, number)
        sweep = (2.0 * math.pi / beams + random.uniform(-0.01, 0.02)) * (-1.0) ** (number // 4)  # it turns meanwhile
        angles = random.uniform(-4.0, 4.0) + sweep * np.arange(100)
        x, y = random.uniform(-2.0, 2.0, (2, 1)) + random.uniform(-3e-4, 3e-4, (2, 1)) * np.arange(100)
        every, needed = np.empty(100), np.empty(100)
        cast_all(scene, x, y, np.cos(angles), np.sin(angles), every, 99.0)
        cast_all(scene, x, y, np.cos(angles), np.sin(angles), needed, 99.0, sweep, 6e-4)
        np.testing.assert_array_equal(needed, every)


BLOCKED = 65534


@pytest.mark.parametrize("name", ["dense", "office"])
@pytest.mark.parametrize("key", [3, 4])
def test_lengths_are_those_of_dijkstra(empty_scene, name, key):
    scene = empty_scene(name)
    _, goal = draw(scene, ROOMS[name], 0.105, key, 0.1)
    free = scene.room.ways != BLOCKED
    rows, columns = free.shape
    number = np.arange(rows * columns).reshape(rows, columns)
    ends, lengths = [], []
    for down, right, length in ((0, 1, 5), (1, 0, 5), (1, 1, 7), (1, -1, 7)):
        first = number[: rows - down, max(-right, 0) : columns - max(right, 0)]
        second = number[down:, max(right, 0) : columns - max(-right, 0)]
        both = free.ravel()[first] & free.ravel()[second]
        ends.append(np.stack([first[both], second[both]]))
        lengths.append(np.full(both.sum(), length))
    (first, second), length = np.concatenate(ends, axis=1), np.concatenate(lengths)
    graph = coo_array((length, (first, second)), shape=(number.size, number.size))
    row, column = int((goal.y + scene.room.walls[3]) / 0.1), int((goal.x + scene.room.walls[2]) / 0.1)
    expected = dijkstra(graph, directed=False, indices=number[row, column]).reshape(rows, columns)
    reached = free & np.isfinite(expected)
    np.testing.assert_array_equal(scene.room.ways[reached], expected[reached])
    assert (scene.room.ways[free & ~reached] == UNREACHED).all()


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
            assert (scene.room.ways[row, column] == BLOCKED) == (near < 0.25) or abs(near - 0.25) < 1e-6


def test_the_way_round_a_wall_is_at_most_9_percent_too_long():
    """From (-1, 0) to (1, 0) round the end of a wall at x = 0 that begins at y = 0.5 with a robot that keeps 0.2 m."""
    scene = FloorPlan(walls=(0.0, 0.0, 2.0, 2.0), boxes=((0.0, -0.75, 0.1, 2.5),)).scene()
    block(scene, 0.2)
    spread(scene, 1.0, 0.0)
    shortest = 2.0 * math.hypot(1.0, 0.7)
    assert shortest < way_left(scene, -1.0, 0.0) < 1.09 * shortest  # eight directions cost up to 8 %
    assert way_left(scene, 1.0, 0.5) == pytest.approx(0.5, abs=0.1)
    assert way_left(scene, 0.0, -1.0) == UNKNOWN  # in the wall
