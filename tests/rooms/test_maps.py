"""Maps: files as ``map_server`` reads them, rays and distances against shapely and brute force, and drives on them."""

import math

import gymnasium as gym
import numpy as np
import pytest
import shapely
from compiled_rooms import clearance_compiled, draw_compiled
from PIL import Image
from scipy.ndimage import convolve

from turtlebot_gym.compiled.packing import as_tuple
from turtlebot_gym.compiled.program import compiled
from turtlebot_gym.rooms import geodesic, sensing
from turtlebot_gym.rooms.grid import FREE, OCCUPIED, UNKNOWN, GridMap
from turtlebot_gym.rooms.maps import read_map
from turtlebot_gym.rooms.plan import FloorPlan
from turtlebot_gym.rooms.worlds import find_world
from turtlebot_gym.values import Pose

ID = "turtlebot_gym/TurtleBotRooms-v0"
BLOCK = compiled(lambda scene, clearance: geodesic.block(scene, clearance), "path grids in tests")


def cellular(seed, rows=50, columns=70, fill=0.44):
    """Return the cells of a cave with free rooms, walls around, and a patch that is not known."""
    filled = np.random.default_rng(seed).random((rows, columns)) < fill
    for _ in range(4):
        filled = convolve(filled.astype(int), np.ones((3, 3), int), mode="constant", cval=1) >= 5
    cells = np.where(filled, OCCUPIED, FREE).astype(np.int8)
    cells[rows // 3 : rows // 3 + 5, columns // 2 :] = UNKNOWN
    cells[rows // 2 : rows // 2 + 6, 5 : columns // 3] = FREE
    return cells


def boxes_of(grid):
    """Return the occupied cells as polygons in the world, and the map's outline."""
    x, y, yaw = grid.origin
    turn = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])

    def place(left, bottom, right, top):
        at = np.array([(left, bottom), (right, bottom), (right, top), (left, top)]) * grid.resolution
        return shapely.Polygon(at @ turn.T + (x, y))

    solid = [place(j, i, j + 1, i + 1) for i, j in np.argwhere(grid.cells == OCCUPIED)]
    return shapely.union_all(solid), place(0, 0, grid.cells.shape[1], grid.cells.shape[0])


GRIDS = [
    GridMap(cells=cellular(1), resolution=0.047, origin=Pose(0.013, -0.021, 0.0)),
    GridMap(cells=cellular(2), resolution=0.1, origin=Pose(-3.0, 1.0, 0.6)),
    GridMap(cells=cellular(3, 40, 40, 0.36), resolution=0.07, origin=Pose(0.3, -2.0, -2.2)),
    GridMap(cells=cellular(4, 140, 140, 0.1), resolution=0.02, origin=Pose(1.0, 1.0, math.pi / 2.0)),  # squares beyond 127
]


def cell_of(grid, x, y):
    """Return row and column of the cell around a point."""
    dx, dy, yaw = x - grid.origin.x, y - grid.origin.y, grid.origin.theta
    along, across = dx * math.cos(yaw) + dy * math.sin(yaw), dy * math.cos(yaw) - dx * math.sin(yaw)
    return math.floor(across / grid.resolution), math.floor(along / grid.resolution)


def points_about(outline, number, seed):
    """Return points on a map and a little outside."""
    left, bottom, right, top = outline.bounds
    return np.random.default_rng(seed).uniform([left - 0.5, bottom - 0.5], [right + 0.5, top + 0.5], (number, 2))


@pytest.mark.parametrize(("at", "grid"), [*enumerate(GRIDS)])
def test_rays_on_each_map_agree_with_shapely(at, grid, cast_all):
    """At random, along the rows, and a hair beside the corners of cells."""
    solid, outline = boxes_of(grid)
    surfaces = shapely.union(solid.boundary, outline.exterior)
    shapely.prepare(surfaces)
    scene = FloorPlan(walls=grid.walls(), map=grid).scene()
    edges, random = shapely.get_coordinates(solid), np.random.default_rng(at)
    points = [(x, y) for x, y in points_about(outline, 60, at) if shapely.contains_xy(outline.difference(solid), x, y)]
    for x, y in points[:6]:
        angles = random.uniform(-math.pi, math.pi, 200)
        angles[:4] = grid.origin[2] + np.array([0.0, 0.5, 1.0, 1.5]) * math.pi
        beside = edges[random.integers(len(edges), size=10)]
        angles[4:14] = np.arctan2(beside[:, 1] - y, beside[:, 0] - x) + random.choice([-1e-7, 1e-7], 10)
        dx, dy = np.cos(angles), np.sin(angles)
        distances = np.empty(angles.size)
        cast_all(scene, np.full(angles.size, x), np.full(angles.size, y), dx, dy, distances, 99.0)
        ends = np.stack([np.broadcast_to([x, y], (angles.size, 2)), np.stack([x + 20.0 * dx, y + 20.0 * dy], -1)], 1)
        met = shapely.intersection(shapely.linestrings(ends), surfaces)
        np.testing.assert_allclose(distances, shapely.distance(shapely.Point(x, y), met), atol=1e-9)


@pytest.mark.parametrize(("at", "grid"), [*enumerate(GRIDS)])
def test_clearance_agrees_with_shapely(at, grid):
    solid, outline = boxes_of(grid)
    scene = FloorPlan(walls=grid.walls(), map=grid).scene()
    for x, y in points_about(outline, 600, at):
        point, nearest = shapely.Point(x, y), clearance_compiled(scene, x, y)
        if outline.covers(point) and not solid.covers(point):
            assert nearest == pytest.approx(min(point.distance(solid), point.distance(outline.exterior), 1.0), abs=1e-9)
        else:
            assert nearest <= 0.0


def test_a_ray_around_a_corner_ends_everywhere(cast_all):
    """From lattice points along diagonals, where rounding decides which cell is next: it must decide, and end."""
    cells = np.zeros((30, 30), np.int8)
    cells[::7, ::5] = OCCUPIED
    grid = GridMap(cells=cells, resolution=0.1)
    scene = FloorPlan(walls=grid.walls(), map=grid).scene()
    x, y = (part.ravel() for part in np.meshgrid(*[np.arange(1, 30) / 10.0] * 2))
    for angle in np.arange(64) * math.pi / 32.0:
        actual = np.empty(x.size)
        cast_all(scene, x, y, np.full(x.size, math.cos(angle)), np.full(x.size, math.sin(angle)), actual, 99.0)
        assert ((actual >= 0.0) & (actual < 4.3)).all()


def test_starts_and_goals_are_in_known_free_ground_and_not_far_apart(hall):
    plan = find_world(hall)
    scene, rules = plan.scene(), as_tuple(plan.rules())
    grid, places = plan.map, set()
    for key in range(40):
        poses = draw_compiled(scene, rules, 0.105, key)
        for pose in poses:
            cell = cell_of(grid, pose.x, pose.y)
            assert grid.cells[cell] == FREE
            assert sensing.clearance(scene, pose.x, pose.y) > 0.105
            places.add(cell)
        assert math.dist(poses[0][:2], poses[1][:2]) >= 1.5
        assert max(abs(poses[0].x - poses[1].x), abs(poses[0].y - poses[1].y)) <= 6.0
        assert geodesic.way_left(scene, poses[0].x, poses[0].y) > 0.0
    assert len(places) > 70


@pytest.mark.parametrize("draw", range(6))
def test_cells_of_the_path_grid_keep_clear_of_the_map_and_stay_on_known_ground(draw):
    chance = np.random.default_rng(draw)
    cells = np.where(chance.random((40 + 7 * draw, 60)) < (0.01, 0.05, 0.3)[draw % 3], OCCUPIED, FREE)
    cells[chance.random(cells.shape) < 0.05] = UNKNOWN
    origin = Pose(*chance.normal(0.0, 3.0, 2).tolist(), 0.3 * (draw % 2))
    grid = GridMap(cells=cells, resolution=(0.05, 0.1, 0.03, 0.5)[draw % 4], origin=origin)
    scenes = [FloorPlan(walls=grid.walls(), map=grid).scene() for _ in range(2)]
    geodesic.block(scenes[0], 0.21)
    BLOCK(scenes[1], 0.21)
    np.testing.assert_array_equal(scenes[0].room.ways, scenes[1].room.ways)
    (solid, outline), (rows, columns) = boxes_of(grid), geodesic.extent(scenes[0])
    for row, column in chance.integers((rows, columns), size=(300, 2)).tolist():
        x, y = geodesic.centre_of(scenes[0], row, column)
        point, (i, j) = shapely.Point(x, y), cell_of(grid, x, y)
        known = 0 <= i < grid.cells.shape[0] and 0 <= j < grid.cells.shape[1] and grid.cells[i, j] == FREE
        free = known and min(point.distance(solid), point.distance(outline.exterior)) >= 0.21
        assert geodesic.is_free(scenes[0], x, y) == free


def test_a_map_that_is_too_large_is_refused():
    with pytest.raises(ValueError, match="cells must be at most 30,000,000, got 36,000,000: cut it"):
        GridMap(cells=np.zeros((6000, 6000), np.int8), resolution=0.05)


COLOURS = [[[255, 255, 255], [0, 0, 0], [255, 0, 0]], [[10, 20, 30], [255, 255, 0], [150, 150, 210]]]
CHANNELS = [[[0, 0, 0, 255], [255, 255, 255, 255], [255, 255, 255, 0], [128, 128, 128, 255]]]


@pytest.mark.parametrize(
    ("pixels", "given", "cells"),
    [
        # What map_saver writes: 0 occupied, 254 free, 205 unknown; the lowest row first.
        ([[0, 254, 205], [254, 254, 0]], {}, [[0, 0, 100], [100, 0, -1]]),
        # In letters. Of 100: 80 is 0.2 of occupancy, 60 is 0.4, 50 is 0.5; 16 bits at once have other scales.
        ("P2\n# in letters\n3 2\n100\n0 100 80\n50 60 100\n", {"free_thresh": 0.25}, [[-1, -1, 0], [100, 0, 0]]),
        ("P2\n3 1\n65535\n0 40000 65535\n", {}, [[100, -1, 0]]),
        # Negated, brightness is occupancy: 1, 0, 1/3; 20/255, 2/3, 2/3.
        (COLOURS, {"image": "map.png", "negate": 1}, [[0, 100, 100], [100, 0, -1]]),
        # Averages of four channels: 255, 1020, 765 and 639 of 1020, so occupancies 0.75, 0, 0.25 and 0.37.
        (CHANNELS, {"image": "map.png"}, [[100, 0, -1, -1]]),
        # Of 255: 128 is an occupancy of 0.498, a little less than the 0.5 of the threshold; 127 is 0.502, 64 is 0.749.
        ([[0, 127, 128, 64, 63, 255]], {"occupied_thresh": 0.5, "free_thresh": 0.5}, [[100, 100, 0, 100, 100, 0]]),
        # At a threshold: unknown.
        ([[255, 0, 200, 0]], {"occupied_thresh": 1.0, "free_thresh": 0.1, "negate": 1}, [[-1, 0, -1, 0]]),
    ],
)
def test_a_map_is_read_cell_by_cell(tmp_path, write_map, pixels, given, cells):
    pixels = pixels if isinstance(pixels, str) else np.array(pixels, np.uint8)
    grid = read_map(write_map(tmp_path, pixels, origin=[-1, 2.0, 0.5], resolution=0.1, **given)).map
    assert grid.cells.tolist() == cells
    assert (grid.resolution, grid.origin) == (0.1, Pose(-1.0, 2.0, 0.5))


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"resolution": "fine"}, "resolution of the map .* must be a positive number .*, got 'fine'"),
        ({"occupied_thresh": 0.2, "free_thresh": 0.6}, "free_thresh of the map .* must be at most occupied_thresh"),
        ({"occupied_thresh": 65}, "occupied_thresh of the map .* must be a probability"),
        ({"negate": 2}, "negate of the map .* must be 0 or 1, got 2"),
        ({"mode": "scale"}, "mode of the map .* must be .*'trinary'.*, got 'scale'"),
        ({"origin": [1e16, 0.0, 0.0]}, r"origin of the map .*\[0\] must be a number from .*, got 10000000000000000"),
        ({"free_thresh": None, "negate": None}, "must state negate, free_thresh"),
        ({"pixels": np.zeros((3, 4), np.uint8)}, "must hold a free cell; of 12 there is none"),
        ({"pixels": "P5\n80 60\n255\nfew"}, "image .*map.pgm' cannot be read"),
    ],
)
def test_an_invalid_map_is_refused_in_one_line(tmp_path, write_map, given, message):
    path = write_map(tmp_path, **given)
    with pytest.raises(ValueError, match=f"{message}[^\n]*$"):
        gym.make("turtlebot_gym/TurtleBotRooms-v0", world=str(path))


@pytest.mark.parametrize(
    ("image", "mode", "given", "is_said"),
    [
        ("map.pgm", "L", {}, True),
        ("map.png", "RGBA", {"free_thresh": 0.196}, True),  # Nav2 averages the alpha channel, so that greys are lighter
        ("map.png", "L", {"negate": 1}, True),
        ("map.pgm", "L", {"free_thresh": 0.196}, False),
    ],
)
def test_unexplored_cells_that_thresholds_make_free_are_unknown_and_said(tmp_path, write_map, image, mode, given, is_said):
    pixels = np.full((80, 80), 254, np.uint8)
    pixels[:, 40:] = 205
    pixels = 255 - pixels if given.get("negate") else pixels
    path = write_map(tmp_path, pixels, **{"image": "map.pgm", "free_thresh": 0.25} | given)
    Image.fromarray(pixels).convert(mode).save(tmp_path / image)
    path.write_text(path.read_text().replace("map.pgm", image))
    if not is_said:
        read_map(path)  # a warning would be an error
        return
    with pytest.warns(UserWarning, match="^map.yaml: free_thresh .* makes unexplored .* unknown for Nav2"):
        grid = read_map(path).map
    assert (grid.cells[:, 40:] == UNKNOWN).all()
    assert (grid.cells[:, :32] == FREE).all()
    assert np.isnan(grid.field()[:, 60:]).all()  # where a lost robot is not searched for


def test_files_that_are_missing_or_no_map_are_named(tmp_path, hall):
    (tmp_path / "bad.yaml").write_text("just words")
    (hall.parent / "map.pgm").unlink()
    for path, message in (
        ("nowhere.yaml", "not a map"),
        (hall, "no image .*map.pgm' for"),
        (tmp_path / "bad.yaml", "must state"),
    ):
        with pytest.raises(ValueError, match=message):
            find_world(path)
