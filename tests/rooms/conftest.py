"""What the tests of rooms share."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from turtlebot_gym.rooms.drawing import capacity
from turtlebot_gym.rooms.rules import ROOMS, RoomRules
from turtlebot_gym.rooms.scene import Scene, make_scenes, scene_at


@pytest.fixture(scope="session")
def empty_scene() -> Callable[..., Scene]:
    """Return a function that makes a scene with room for what some rules draw."""

    def make(rules: RoomRules | str, *, beams: int = 8) -> Scene:
        rules = ROOMS[rules] if isinstance(rules, str) else rules
        circles, boxes = capacity(rules)
        length, width = 2.0 * rules.half_length, 2.0 * rules.half_width
        return scene_at(make_scenes(1, circles=circles, boxes=boxes, length=length, width=width, beams=beams), 0)

    return make
