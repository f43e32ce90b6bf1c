"""The picture of a room."""

import gymnasium as gym
import numpy as np
import pytest

from turtlebot_gym.rooms.lidar import Lidar
from turtlebot_gym.rooms.plan import FloorPlan
from turtlebot_gym.values import Pose

PLAN = FloorPlan(
    walls=(0.0, 0.0, 2.0, 2.0),
    circles=((1.0, 1.0, 0.3), (-1.0, 1.0, 0.3, 0.1, 0.0)),
    boxes=((1.0, -1.0, 0.6, 0.2, np.pi / 2.0),),
    start=Pose(-1.0, -1.0, 0.0),
    goal=Pose(0.0, 0.0, 0.0),
)
SOLID, WHITE, BEAM, WALKER = (0x77, 0x77, 0x77), (255, 255, 255), (0xCC, 0x79, 0xA7), (0x00, 0x72, 0xB2)


def seen(world, steps, lidar="lds01", **options):
    """Return observation and snapshot after some steps, and a function for the colour that the picture has at a place."""
    env = gym.make("turtlebot_gym/TurtleBotRooms-v0", world=world, lidar=lidar, render_mode="rgb_array", **options)
    observation, _ = env.reset(seed=0)
    for _ in range(steps):
        observation, *_ = env.step(np.zeros(2, np.float32))
    picture, snapshot = env.render()[64:], env.unwrapped.snapshot()  # below the header; 5 m are 640 pixels
    return observation, snapshot, lambda x, y: tuple(picture[round((2.5 - y) * 128), round((x + 2.5) * 128)].tolist())


def test_obstacles_are_drawn_where_they_stand_and_beams_end_where_they_were_measured():
    *_, at = seen(PLAN, 0, Lidar(beams=4, rate=5.0, range_min=0.0, range_max=10.0), noise="clean")
    assert {at(1.1, 1.2), at(0.95, -0.75)} == {SOLID}  # a circle, a box turned by 90 degrees
    assert max(at(-2.0, 0.55)) < 150  # the wall, a line of two pixels
    assert {at(1.05, 1.38), at(0.8, -1.05)} == {WHITE}
    near = [(0.008 * i, 0.008 * k) for i in range(-2, 3) for k in range(-2, 3)]
    for x, y in ((0.9, -1.0), (-1.0, 0.7), (-1.0, -2.0)):  # ahead at the box, to the left at the circle, to the right
        assert BEAM in {at(x + dx, y + dy) for dx, dy in near}


@pytest.mark.parametrize(("steps", "x"), [(0, -1.0), (20, -0.8)])  # 0.02 m a step to the right
def test_walkers_are_discs_where_they_are(steps, x):
    *_, at = seen(PLAN, steps, noise="clean")
    assert {at(x, 1.0), at(x, 1.25), at(x, 0.75), at(x + 0.2, 1.0)} == {WALKER}
    assert WALKER not in {at(x - 0.45, 1.0), at(x + 0.45, 1.0)}
