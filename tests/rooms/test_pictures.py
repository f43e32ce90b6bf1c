"""The picture of a room."""

from dataclasses import replace

import gymnasium as gym
import numpy as np

from turtlebot_gym.rooms.lidar import Lidar
from turtlebot_gym.rooms.plan import FloorPlan
from turtlebot_gym.values import Pose

ID = "turtlebot_gym/TurtleBotRooms-v0"
PLAN = FloorPlan(
    walls=(0.0, 0.0, 2.0, 2.0),
    circles=((1.0, 1.0, 0.3), (-1.0, 1.0, 0.3, 0.1, 0.0)),
    boxes=((1.0, -1.0, 0.6, 0.2, np.pi / 2.0),),
    start=Pose(-1.0, -1.0, 0.0),
    goal=Pose(0.0, 0.0, 0.0),
)
SOLID, WHITE, BEAM = (0x55, 0x55, 0x55), (255, 255, 255), (0xCC, 0x79, 0xA7)
WALKER, ESTIMATE = (0x00, 0x72, 0xB2), (0xD5, 0x5E, 0x00)


def picture(steps=0, plan=PLAN):
    """Return the picture after some steps, without its header of 64 rows: 5 m are 640 pixels."""
    lidar = Lidar(beams=4, rate=5.0, range_min=0.0, range_max=10.0)
    env = gym.make(ID, world=plan, lidar=lidar, noise="clean", render_mode="rgb_array")
    env.reset(seed=0)
    for _ in range(steps):
        env.step(np.zeros(2, np.float32))
    return env.render()[64:]


def at(drawn, x, y):
    return tuple(int(value) for value in drawn[round((2.5 - y) * 128), round((x + 2.5) * 128)])


def test_obstacles_are_drawn_where_they_stand():
    drawn = picture()
    assert at(drawn, 1.1, 1.2) == SOLID
    assert at(drawn, 1.05, 1.38) == WHITE
    assert at(drawn, 0.95, -0.75) == SOLID  # the box is turned: 0.2 m along x, 0.6 m along y
    assert at(drawn, 0.8, -1.05) == WHITE
    assert at(drawn, -2.0, 0.55) == SOLID  # the wall


def test_walkers_are_discs_where_they_are():
    for steps, x in ((0, -1.0), (20, -0.8)):  # 0.02 m a step to the right
        drawn = picture(steps=steps)
        assert at(drawn, x, 1.0) == at(drawn, x, 1.25) == at(drawn, x, 0.75) == at(drawn, x + 0.2, 1.0) == WALKER
        assert WALKER not in (at(drawn, x - 0.45, 1.0), at(drawn, x + 0.45, 1.0))


def test_a_track_is_a_ring_where_the_robot_believes_somebody_and_a_line_along_the_way():
    walker = replace(PLAN, circles=((-1.6, 1.0, 0.2, 0.5, 0.0),))
    env = gym.make(ID, world=walker, noise="wheel", observation="ekf,tracks", render_mode="rgb_array")
    env.reset(seed=0)
    for _ in range(30):
        observation, *_ = env.step(np.zeros(2, np.float32))
    x, y, vx, vy, deviation, *_, certainty = observation[-40:-32].tolist()
    assert certainty == 1.0
    drawn, robot = env.render()[64:], env.unwrapped.snapshot().body.true_state
    assert abs(vx) > 0.2
    assert at(drawn, robot.x + x + 0.8 * vx, robot.y + y + 0.8 * vy) == ESTIMATE
    ring = [
        (2.0 / np.sqrt(2.0) * deviation * np.cos(angle), 2.0 / np.sqrt(2.0) * deviation * np.sin(angle)) for angle in (2.0, 4.0)
    ]
    for a, b in ring:
        near = [at(drawn, robot.x + x + share * a, robot.y + y + share * b) for share in np.linspace(0.93, 1.07, 15)]
        assert max(red - blue for red, _, blue in near) > 100  # the ring is thinner than two pixels


def test_beams_end_where_they_were_measured():
    drawn = picture()
    assert at(drawn, 0.9 + 0.0, -1.0) == BEAM  # ahead, at the box
    assert at(drawn, -1.0, 0.7) == BEAM  # to the left, at the circle
    assert at(drawn, -1.0, -2.0) == BEAM


def test_a_new_room_has_a_new_picture():
    env = gym.make(ID, world="clutter", render_mode="rgb_array")
    pictures = []
    for seed in (1, 2, 1):
        env.reset(seed=seed)
        pictures.append(env.render())
    assert (pictures[0] != pictures[1]).any()
    np.testing.assert_array_equal(pictures[0], pictures[2])


def test_beams_are_lines_from_the_lidar_to_their_ends():
    drawn = picture().astype(int)
    tinted = drawn[..., 0] - drawn[..., 1] > 5  # of purple; grid and obstacles are grey

    def along(y):
        """Return where a line lies between the robot and the box, within a row of pixels of y."""
        row = round((2.5 - y) * 128)
        return tinted[row - 1 : row + 2, round(1.75 * 128) : round(3.2 * 128)].any(axis=0)

    assert along(-1.0).all()
    assert not along(-0.9).any()
    assert not along(-1.1).any()
