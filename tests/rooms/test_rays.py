"""Rays and distances against shapely, which knows none of our formulas, and against numbers that were worked out by hand."""

import math

import numpy as np
import pytest
import shapely

from turtlebot_gym.compiled.cache import compiled
from turtlebot_gym.compiled.packing import as_tuple
from turtlebot_gym.rooms import drawing, rays, sensing
from turtlebot_gym.rooms.rules import ROOMS

DRAW = compiled(lambda scene, rules, key: drawing.draw(scene, rules, 0.105, key), "rooms in tests")
NEAR = compiled(lambda scene, x, y: sensing.clearance(scene, x, y), "clearance in tests")


def corners(box):
    """Return the corners of a row of `Scene.boxes`."""
    x, y, a, b, cosine, sine = box
    return [(x + cosine * u - sine * v, y + sine * u + cosine * v) for u, v in ((a, b), (-a, b), (-a, -b), (a, -b))]


def lengths_to_polygons(scene, x, y, dx, dy):
    """Return the lengths of rays to boxes and walls, and their distances, from shapely's intersections."""
    cx, cy, half_length, half_width = scene.walls
    room = shapely.box(cx - half_length, cy - half_width, cx + half_length, cy + half_width)
    solid = [shapely.Polygon(corners(box)) for box in scene.boxes[: scene.counts[1]]]
    surfaces = shapely.union_all([room.exterior, *solid])
    ends = np.stack([np.stack([x, y], -1), np.stack([x + 30.0 * dx, y + 30.0 * dy], -1)], 1)
    met = shapely.intersection(shapely.linestrings(ends), surfaces)
    return shapely.distance(shapely.points(x, y), met)


def lengths_to_circles(scene, x, y, dx, dy):
    """Return the lengths of rays to the circles, by the roots of |p + t d - c|^2 = r^2 that numpy finds."""
    shortest = np.full(x.shape, np.inf)
    for cx, cy, r, _, _ in scene.circles[: scene.counts[0]]:
        b, c = (x - cx) * dx + (y - cy) * dy, (x - cx) ** 2 + (y - cy) ** 2 - r * r
        with np.errstate(invalid="ignore"):
            root = np.sqrt(b * b - c)
        length = np.where(c <= 0.0, 0.0, np.where(-b - root >= 0.0, -b - root, np.inf))
        shortest = np.fmin(shortest, length)
    return shortest


def test_100_000_rays_agree_with_shapely(empty_scene, cast_all):
    """Rooms of all kinds; rays at random, along the axes, at corners, and a hair beside tangents."""
    random, tried, worst = np.random.default_rng(1), 0, 0.0
    names = ["dense", "office", "clutter", "crowd", "corridor"]
    for number in range(250):
        scene = empty_scene(names[number % len(names)])
        DRAW(scene, as_tuple(ROOMS[names[number % len(names)]]), number)
        at = random.uniform(-0.98, 0.98, 2) * scene.walls[2:]
        angles = random.uniform(-math.pi, math.pi, 360)
        angles[:4] = 0.0, math.pi / 2.0, math.pi, -math.pi / 2.0
        aimed = []
        for x, y in (corner for box in scene.boxes[: scene.counts[1]] for corner in corners(box)):
            aimed += [math.atan2(y - at[1], x - at[0]) + beside for beside in (-1e-7, 1e-7)]
        for x, y, r, _, _ in scene.circles[: scene.counts[0]]:
            away = math.hypot(x - at[0], y - at[1])
            if away > r:  # at a tangent or a corner itself, rounding decides between a hit and a miss
                tangent = math.asin(r / away)
                aimed += [math.atan2(y - at[1], x - at[0]) + one for one in (tangent - 1e-7, tangent + 1e-7, 1e-7 - tangent)]
        angles = np.concatenate([angles, aimed])
        x, y = np.full(angles.size, at[0]), np.full(angles.size, at[1])
        dx, dy = np.cos(angles), np.sin(angles)
        found = np.empty(angles.size)
        cast_all(scene, x, y, dx, dy, found, 99.0)
        expected = np.minimum(lengths_to_polygons(scene, x, y, dx, dy), lengths_to_circles(scene, x, y, dx, dy))
        worst, tried = max(worst, float(np.abs(found - expected).max())), tried + angles.size
    assert tried >= 90_000
    assert worst < 1e-9


def test_clearance_agrees_with_shapely(empty_scene):
    random = np.random.default_rng(2)
    for number in range(60):
        scene = empty_scene("dense")
        DRAW(scene, as_tuple(ROOMS["dense"]), number)
        cx, cy, half_length, half_width = scene.walls
        room = shapely.box(cx - half_length, cy - half_width, cx + half_length, cy + half_width)
        for x, y in random.uniform(-2.4, 2.4, (30, 2)):
            point = shapely.Point(x, y)
            apart = [point.distance(room.exterior)]
            apart += [math.hypot(x - c[0], y - c[1]) - c[2] for c in scene.circles[: scene.counts[0]]]
            apart += [point.distance(shapely.Polygon(corners(box))) for box in scene.boxes[: scene.counts[1]]]
            found = NEAR(scene, x, y)
            assert found == pytest.approx(min(apart), abs=1e-9) or (found < 0.0 and min(apart) <= 0.0)


def to_circle(x, y):
    return rays.ray_to_circle(x, y, 1.0, 0.0, 0.25)


def to_box(x, y):
    return rays.ray_to_box(x, y, 1.0, rays.inverse(0.0), 0.5, 0.3)


@pytest.mark.parametrize(
    ("ray_to", "lengths"),
    [
        (to_circle, {(2.0, 0.0): 1.5, (2.0, 0.3): 1.6, (2.0, 0.5): 2.0, (2.0, 0.6): rays.FAR, (0.2, 0.1): 0.0}),
        (to_box, {(2.0, 0.0): 1.5, (2.0, 0.29): 1.5, (2.0, 0.31): rays.FAR, (0.4, -0.2): 0.0}),
    ],
)
def test_a_ray_along_x_to_a_circle_of_half_a_metre_and_to_a_box_of_1_m_by_60_cm(ray_to, lengths):
    behind = {(-2.0, 0.0): rays.FAR}
    assert {at: ray_to(*at) for at in lengths | behind} == pytest.approx(lengths | behind, abs=1e-12)


def test_a_ray_to_the_walls_ends_at_the_nearer_one_and_begins_inside():
    diagonal = math.sqrt(0.5)
    inverse = rays.inverse(diagonal)
    assert rays.ray_to_walls(0.0, 0.0, inverse, inverse, 3.0, 2.0) == pytest.approx(2.0 / diagonal)
    assert rays.ray_to_walls(-1.0, 0.0, 1.0, rays.inverse(0.0), 3.0, 2.0) == pytest.approx(2.0)
    assert rays.ray_to_walls(-4.0, 0.0, 1.0, rays.inverse(0.0), 3.0, 2.0) == 0.0


def test_distances_are_negative_inside():
    assert rays.distance_to_circle(3.0, 4.0, 2.0) == pytest.approx(3.0)
    assert rays.distance_to_circle(0.3, 0.4, 2.0) == pytest.approx(-1.5)
    assert rays._distance_to_box(4.0, 5.0, 1.0, 1.0) == pytest.approx(5.0)
    assert rays._distance_to_box(0.2, 0.0, 1.0, 0.5) == pytest.approx(-0.5)
    assert rays.distance_to_walls(0.5, 1.0, 2.0, 3.0) == pytest.approx(1.5)
    assert rays.distance_to_walls(2.5, 1.0, 2.0, 3.0) == pytest.approx(-0.5)


def test_what_is_near_enough_is_never_missed(empty_scene, cast_all):
    random, missed = np.random.default_rng(4), 0
    for number in range(40):
        scene = empty_scene("clutter")
        DRAW(scene, as_tuple(ROOMS["clutter"]), number)
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
        DRAW(scene, as_tuple(ROOMS[name]), number)
        sweep = (2.0 * math.pi / beams + random.uniform(-0.01, 0.02)) * (-1.0) ** (number // 4)  # it turns meanwhile
        angles = random.uniform(-4.0, 4.0) + sweep * np.arange(100)
        x, y = random.uniform(-2.0, 2.0, (2, 1)) + random.uniform(-3e-4, 3e-4, (2, 1)) * np.arange(100)
        every, needed = np.empty(100), np.empty(100)
        cast_all(scene, x, y, np.cos(angles), np.sin(angles), every, 99.0, np.inf)
        cast_all(scene, x, y, np.cos(angles), np.sin(angles), needed, 99.0, sweep, 6e-4)
        np.testing.assert_array_equal(needed, every)


def test_this_law_notices_a_group_that_is_too_narrow(empty_scene, cast_all):
    scene, angles = empty_scene("dense"), 0.1 * np.arange(100)
    DRAW(scene, as_tuple(ROOMS["dense"]), 0)
    found = np.empty((2, 100))
    for lengths, sweep in zip(found, (np.inf, -0.1), strict=True):  # the other way round
        cast_all(scene, np.zeros(100), np.zeros(100), np.cos(angles), np.sin(angles), lengths, 99.0, sweep)
    assert (found[1] > found[0]).any()
