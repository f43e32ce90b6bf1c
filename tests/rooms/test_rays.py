"""Rays and shortest ways, against shapely, brute force and scipy's Dijkstra."""

import math

import numpy as np
import pytest
import shapely
from compiled_rooms import clearance_compiled

from turtlebot_gym.rooms.drawing import draw
from turtlebot_gym.rooms.geodesic import UNKNOWN, block, centre_of, spread, way_left
from turtlebot_gym.rooms.plan import FloorPlan
from turtlebot_gym.rooms.rules import ROOMS
from turtlebot_gym.rooms.scene import UNREACHED


def polygons_of(scene):
    """Return the room and its boxes as polygons."""
    cx, cy, half_length, half_width = scene.room.walls
    solid = []
    for x, y, a, b, cosine, sine in scene.room.boxes[: scene.room.counts[1]]:
        corners = ((a, b), (-a, b), (-a, -b), (a, -b))
        solid.append(shapely.Polygon([(x + cosine * u - sine * v, y + sine * u + cosine * v) for u, v in corners]))
    return shapely.box(cx - half_length, cy - half_width, cx + half_length, cy + half_width), solid


def circles_of(scene):
    """Return place and radius of each circle."""
    return scene.room.circles[: scene.room.counts[0], :3]


def distance(scene, x, y):
    """Return the distance from a point in the room to the nearest surface, negative inside of an obstacle."""
    point, (room, solid) = shapely.Point(x, y), polygons_of(scene)
    apart = [point.distance(room.exterior)] + [math.hypot(x - cx, y - cy) - r for cx, cy, r in circles_of(scene)]
    return min(apart + [point.distance(box) - point.within(box) * point.distance(box.exterior) for box in solid])


def lengths_of(scene, x, y, dx, dy):
    """Return the lengths of rays: to polygons by shapely, to circles by the roots of |p + t d - c|^2 = r^2."""
    room, solid = polygons_of(scene)
    ends = np.stack([np.stack([x, y], -1), np.stack([x + 30.0 * dx, y + 30.0 * dy], -1)], 1)
    met = shapely.intersection(shapely.linestrings(ends), shapely.union_all([room.exterior, *solid]))
    shortest = shapely.distance(shapely.points(x, y), met)
    for cx, cy, r in circles_of(scene):
        b, c = (x - cx) * dx + (y - cy) * dy, (x - cx) ** 2 + (y - cy) ** 2 - r * r
        with np.errstate(invalid="ignore"):
            root = np.sqrt(b * b - c)
        shortest = np.fmin(shortest, np.where(c <= 0.0, 0.0, np.where(-b - root >= 0.0, -b - root, np.inf)))
    return shortest


@pytest.mark.parametrize("name", ["dense", "office", "clutter", "crowd", "corridor"])
def test_rays_agree_with_shapely(name, drawn_room, cast_all):
    """Rays at random, along the axes, at corners, and a hair beside tangents."""
    random = np.random.default_rng(1)
    for number in range(6):
        scene = drawn_room(name, number)
        at = random.uniform(-0.98, 0.98, 2) * scene.room.walls[2:]
        angles = [0.0, math.pi / 2.0, math.pi, -math.pi / 2.0, *random.uniform(-math.pi, math.pi, 356)]
        for x, y in shapely.get_coordinates(polygons_of(scene)[1]):
            angles += [math.atan2(y - at[1], x - at[0]) + beside for beside in (-1e-7, 1e-7)]
        for x, y, r in circles_of(scene):
            tangent = math.asin(min(r / math.dist((x, y), at), 1.0))  # at it, and at a corner, rounding decides
            angles += [math.atan2(y - at[1], x - at[0]) + beside for beside in (tangent - 1e-7, tangent + 1e-7, 1e-7 - tangent)]
        rays = (np.full(len(angles), at[0]), np.full(len(angles), at[1]), np.cos(angles), np.sin(angles))
        lengths = np.empty(len(angles))
        cast_all(scene, *rays, lengths, 99.0)
        np.testing.assert_allclose(lengths, lengths_of(scene, *rays), rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("sweep", [0.01, -0.01])
@pytest.mark.parametrize("ray", [0, 63])
def test_an_obstacle_that_the_first_or_the_last_ray_alone_meets_counts(ray, sweep, drawn_room, cast_all):
    scene, angles = drawn_room("dense", 0), sweep * np.arange(64)
    (x, y), scene.room.counts[:2], lengths = scene.room.walls[:2], (1, 0), np.empty(64)
    scene.room.circles[0, :3] = x + math.cos(angles[ray]), y + math.sin(angles[ray]), 0.004
    cast_all(scene, np.full(64, x), np.full(64, y), np.cos(angles), np.sin(angles), lengths, 99.0, sweep=sweep)
    assert np.flatnonzero(lengths < 1.0).tolist() == [ray]


def test_clearance_agrees_with_shapely(drawn_room):
    random, inside = np.random.default_rng(2), 0
    for number in range(60):
        scene = drawn_room("dense", number)
        for x, y in random.uniform(-2.4, 2.4, (30, 2)):
            expected = distance(scene, x, y)
            assert clearance_compiled(scene, x, y) == pytest.approx(expected, abs=1e-9)
            inside += expected < 0.0
    assert inside > 50


@pytest.mark.parametrize("beams", [24, 36, 269, 360])
def test_leaving_out_obstacles_changes_no_bit_of_what_is_near_enough(drawn_room, cast_all, beams):
    random, missed = np.random.default_rng(beams), 0
    for number in range(60):
        scene = drawn_room(("clutter", "dense", "office", "cellular")[number % 4], number)
        sweep = (2.0 * math.pi / beams + random.uniform(-0.01, 0.02)) * (-1.0) ** (number // 4)  # it turns meanwhile
        angles = random.uniform(-4.0, 4.0) + sweep * np.arange(100)
        x, y = random.uniform(-2.0, 2.0, (2, 1)) + random.uniform(-3e-4, 3e-4, (2, 1)) * np.arange(100)
        rays, (every, needed, part) = (x, y, np.cos(angles), np.sin(angles)), np.empty((3, 100))
        cast_all(scene, *rays, every, 99.0)
        cast_all(scene, *rays, needed, 99.0, sweep=sweep, drift=6e-4)
        cast_all(scene, *rays, part, 1.2)
        np.testing.assert_array_equal(needed, every)
        near = every <= 1.15  # from the first ray's origin it is 1.2 m at most
        np.testing.assert_array_equal(part[near], every[near])
        assert (part >= every).all()
        missed += int((part > every).sum())
    assert missed > 50  # what is far away costs nothing


BLOCKED = 65534


@pytest.mark.parametrize("name", ["dense", "office"])
@pytest.mark.parametrize("key", [3, 4])
def test_each_length_is_that_of_the_best_neighbour_and_the_step_to_it(empty_scene, name, key):
    """Bellman's equation, whose only solution are the shortest ways."""
    scene = empty_scene(name)
    _, goal = draw(scene, ROOMS[name], 0.105, key, 0.1)
    free = scene.room.ways != BLOCKED
    ways = np.pad(np.where(free & (scene.room.ways != UNREACHED), scene.room.ways, np.inf), 1, constant_values=np.inf)
    best, (rows, columns) = np.full(free.shape, np.inf), free.shape
    for down in (0, 1, 2):
        for right in (0, 1, 2):
            step = (np.inf, 5.0, 7.0)[(down != 1) + (right != 1)]
            best = np.minimum(best, ways[down : down + rows, right : right + columns] + step)
    best[int((goal.y + scene.room.walls[3]) / 0.1), int((goal.x + scene.room.walls[2]) / 0.1)] = 0.0
    np.testing.assert_array_equal(ways[1:-1, 1:-1][free], best[free])


def test_cells_are_blocked_within_the_clearance_and_no_farther():
    plan = FloorPlan(walls=(0.0, 0.0, 1.5, 1.0), circles=((0.4, 0.1, 0.2),), boxes=((-0.7, 0.0, 0.4, 0.6, 0.5),))
    scene = plan.scene()
    block(scene, 0.25)
    for row in range(20):
        for column in range(30):
            x, y = centre_of(scene, row, column)
            assert (x, y) == pytest.approx((-1.45 + 0.1 * column, -0.95 + 0.1 * row))
            near = distance(scene, x, y)
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
