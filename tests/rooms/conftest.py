"""Shared by the tests of rooms."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from compiled_rooms import draw_compiled

from turtlebot_gym.compiled.packing import as_tuple
from turtlebot_gym.compiled.program import compiled
from turtlebot_gym.rooms.drawing import capacity
from turtlebot_gym.rooms.rules import ROOMS, RoomRules
from turtlebot_gym.rooms.scene import Scene, make_scenes, scene_at
from turtlebot_gym.rooms.sensing import BLOCK, ROOM, cast


@pytest.fixture(scope="session")
def empty_scene() -> Callable[..., Scene]:
    """Return a function that makes a scene large enough for some rules."""

    def make(rules: RoomRules | str) -> Scene:
        rules = ROOMS[rules] if isinstance(rules, str) else rules
        (circles, boxes), length, width = capacity(rules), 2.0 * rules.half_length, 2.0 * rules.half_width
        return scene_at(make_scenes(1, circles=circles, boxes=boxes, length=length, width=width, beams=8, people=circles), 0)

    return make


@pytest.fixture(scope="session")
def drawn_room(empty_scene) -> Callable[..., Scene]:
    """Return a function that draws a room by its name and a key."""

    def make(name: str, key: int) -> Scene:
        scene = empty_scene(name)
        draw_compiled(scene, as_tuple(ROOMS[name]), 0.105, key)
        return scene

    return make


def _cast_all(scene, x, y, dx, dy, lengths, reach, sweep, drift):
    rays = np.empty(ROOM)
    for first in range(0, len(lengths), BLOCK):
        n = min(BLOCK, len(lengths) - first)
        for ray in range(n):
            rays[ray], rays[BLOCK + ray] = x[first + ray], y[first + ray]
            rays[2 * BLOCK + ray], rays[3 * BLOCK + ray] = dx[first + ray], dy[first + ray]
        cast(scene, rays, n, reach, sweep, drift)
        lengths[first : first + n] = rays[4 * BLOCK : 4 * BLOCK + n]


@pytest.fixture(scope="session")
def cast_all() -> Callable[..., None]:
    """Return a function that casts any number of rays, compiled for one list of types."""
    function = compiled(_cast_all, "rays in tests")
    return lambda *rays, sweep=np.inf, drift=0.0: function(*rays, sweep, drift)


HALL = np.full((60, 80), 254, np.uint8)
HALL[0, :] = HALL[-1, :] = HALL[:, 0] = HALL[:, -1] = 0
HALL[:40, 38:42] = 0
HALL[30:34, 60:] = 205
"""A hall of 8 m by 6 m with a wall in it and unknown ground, at a resolution of 0.1 m."""


@pytest.fixture
def hall(tmp_path, write_map) -> Path:
    """Return the file of the hall's map."""
    return write_map(tmp_path, HALL, resolution=0.1, origin=[-4.0, -3.0, 0.3])
