"""The picture of a room."""

from functools import cache

import gymnasium as gym
import numpy as np

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


@cache
def picture(steps=0):
    """Return the picture after some steps, without its header of 64 rows: 5 m are 640 pixels."""
    lidar = Lidar(beams=4, rate=5.0, range_min=0.0, range_max=10.0)
    env = gym.make("turtlebot_gym/TurtleBotRooms-v0", world=PLAN, lidar=lidar, noise="clean", render_mode="rgb_array")
    env.reset(seed=0)
    for _ in range(steps):
        env.step(np.zeros(2, np.float32))
    return env.render()[64:]


def at(x, y, steps=0):
    return tuple(int(value) for value in picture(steps)[round((2.5 - y) * 128), round((x + 2.5) * 128)])


def test_obstacles_are_drawn_where_they_stand_and_beams_end_where_they_were_measured():
    assert at(1.1, 1.2) == SOLID
    assert at(1.05, 1.38) == WHITE
    assert at(0.95, -0.75) == SOLID  # the box is turned: 0.2 m along x, 0.6 m along y
    assert at(0.8, -1.05) == WHITE
    assert at(-2.0, 0.55) == SOLID  # the wall
    for end in ((0.9, -1.0), (-1.0, 0.7), (-1.0, -2.0)):  # ahead at the box, to the left at the circle, to the right
        assert at(*end) == BEAM


def test_walkers_are_discs_where_they_are():
    for steps, x in ((0, -1.0), (20, -0.8)):  # 0.02 m a step to the right
        inside, outside = [(x, 1.0), (x, 1.25), (x, 0.75), (x + 0.2, 1.0)], [(x - 0.45, 1.0), (x + 0.45, 1.0)]
        assert {at(*place, steps) for place in inside} == {WALKER}
        assert WALKER not in {at(*place, steps) for place in outside}


def test_a_track_is_a_line_along_the_way_of_whom_the_robot_sees():
    walker = FloorPlan(walls=PLAN.walls, circles=((-1.6, 1.0, 0.2, 0.5, 0.0),), start=PLAN.start, goal=PLAN.goal)
    env = gym.make(
        "turtlebot_gym/TurtleBotRooms-v0", world=walker, noise="wheel", observation="ekf,tracks", render_mode="rgb_array"
    )
    env.reset(seed=0)
    for _ in range(30):
        observation, *_ = env.step(np.zeros(2, np.float32))
    (x, y, vx, vy), robot = observation[-40:-36].tolist(), env.unwrapped.snapshot().body.true_state
    assert abs(vx) > 0.2
    row, column = (2.5 - (robot.y + y + 0.8 * vy)) * 128, (2.5 + robot.x + x + 0.8 * vx) * 128
    assert env.render()[64 + round(row), round(column)].tolist() == [0xD5, 0x5E, 0x00]
