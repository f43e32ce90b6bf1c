"""Files of maps, read cell by cell as ``map_server`` reads them; what is wrong with one is one clear line."""

import gymnasium as gym
import numpy as np
import pytest
from PIL import Image

from turtlebot_gym.rooms.grid import FREE, UNKNOWN
from turtlebot_gym.rooms.maps import read_map
from turtlebot_gym.rooms.worlds import find_world
from turtlebot_gym.values import Pose

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
