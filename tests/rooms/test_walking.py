"""Circles that walk: straight on, or as people, who see the robot or not."""

import math
from dataclasses import replace

import numpy as np
import pytest

from turtlebot_gym.envs.navigation_vector import NavigationVectorEnv
from turtlebot_gym.models.random import episode_key
from turtlebot_gym.rooms import walking
from turtlebot_gym.rooms.drawing import draw
from turtlebot_gym.rooms.rules import ROOMS
from turtlebot_gym.rooms.walking import walk
from turtlebot_gym.values import Pose

FAR = Pose(100.0, 0.0, 0.0)
RADIUS, DT = 0.105, 0.1


def step(scene, robot=FAR, *, before=None, rules=ROOMS["crowd"]):
    """Let everybody walk for a control interval, past a robot that stands unless it was elsewhere ``before``."""
    walk(scene, before or robot, robot, RADIUS, rules, DT)


def walker(scene, walls, circle):
    """Leave one circle in a room of some walls."""
    scene.room.walls[:], scene.room.counts[:], scene.room.circles[0] = walls, (1, 0), circle
    return scene


@pytest.mark.parametrize("way", [1.0, 1.0j, 0.6 - 0.8j])
def test_walkers_wait_for_a_robot_that_is_near_and_in_their_way(empty_scene, way):
    def steps(robot, courtesy):
        v, at = 0.5 * way, robot * way
        scene = walker(empty_scene("crowd"), (0.0, 0.0, 10.0, 10.0), (0.0, 0.0, 0.2, v.real, v.imag))
        for _ in range(20):
            step(scene, Pose(at.real, at.imag, 0.0), rules=replace(ROOMS["crowd"], courtesy=courtesy))
        return abs(complex(*scene.room.circles[0, :2]))

    ahead, behind, aside = 0.82, -0.5, 0.5 + 2.0j
    assert steps(ahead, 0.4) == pytest.approx(0.25)  # the first step that begins nearer than 0.4 m to it is not made
    assert steps(ahead, 0.0) == pytest.approx(0.65)  # it runs into the robot, and stands where its centre is inside
    assert steps(behind, 0.4) == steps(aside, 0.4) == pytest.approx(1.0)


def test_walkers_turn_back_at_the_walls(empty_scene):
    scene, places = walker(empty_scene("crowd"), (3.0, -2.0, 1.0, 1.5), (3.52, -1.02, 0.2, 0.5, 0.5)), []
    for _ in range(8):
        step(scene, rules=replace(ROOMS["crowd"], courtesy=0.0))
        places.append(scene.room.circles[0, :2].tolist())
    x, y = zip(*places, strict=True)
    assert x == pytest.approx([3.57, 3.62, 3.67, 3.72, 3.77, 3.72, 3.67, 3.62])
    assert y == pytest.approx([-0.97, -0.92, -0.87, -0.82, -0.77, -0.72, -0.77, -0.82])


@pytest.fixture
def alone(empty_scene):
    """Return a person at the origin of a large room, on the way to (4, 0) at 1 m/s, who sees the robot."""
    scene = walker(empty_scene("people"), (0.0, 0.0, 50.0, 50.0), (0.0, 0.0, 0.2, 1.0, 0.0))
    scene.room.people[0] = 4.0, 0.0, 0.0, 0.0, 1.0, 1.0
    return scene


def test_the_decay_of_forces_is_an_exponential():
    for x in np.linspace(0.0, 60.0, 301):
        assert walking._decay(x) == pytest.approx(math.exp(-x), rel=1e-11, abs=1e-14)


def test_people_push_each_other_along_the_gradient_of_the_papers_potential():
    """Equations 3 and 4 of Helbing and Molnár; by differences."""

    def potential(dx, dy, ahead):
        both = math.hypot(dx, dy) + math.hypot(dx - ahead[0], dy - ahead[1])
        return 2.1 * math.exp(-0.5 * math.sqrt(both**2 - ahead[0] ** 2 - ahead[1] ** 2) / 0.3)

    random, h = np.random.default_rng(0), 1e-6
    for _ in range(50):
        dx, dy, *ahead = random.uniform(-2.0, 2.0, 4)
        along = (potential(dx - h, dy, ahead) - potential(dx + h, dy, ahead)) / (2.0 * h)
        across = (potential(dx, dy - h, ahead) - potential(dx, dy + h, ahead)) / (2.0 * h)
        assert walking._repulsion(dx, dy, *ahead) == pytest.approx((along, across), rel=1e-5, abs=1e-7)


def test_a_person_takes_up_the_pace_and_turns_round_at_the_place(alone):
    scene, places = alone, []
    scene.room.circles[0, 3] = 0.3
    for _ in range(80):
        step(scene, rules=ROOMS["people"])
        places.append(scene.room.circles[0, 0])
    assert 3.3 < max(places) < 4.0
    assert places[-1] < max(places) - 2.0
    assert np.abs(np.diff(places)).max() == pytest.approx(0.1, abs=0.002)


@pytest.mark.parametrize("sees", [True, False])
def test_people_who_see_the_robot_walk_round_it_and_others_run_into_it(alone, sees):
    """Nobody walks through a robot that stands: who does not see it is held up at its edge, and turns back."""
    scene, robot, near = alone, Pose(2.0, 0.15, 0.0), []
    scene.room.people[0, 5] = sees
    for _ in range(40):
        step(scene, robot, rules=ROOMS["people"])
        near.append(math.hypot(scene.room.circles[0, 0] - robot.x, scene.room.circles[0, 1] - robot.y) - 0.2 - RADIUS)
    assert min(near) > 0.03 if sees else min(near) == pytest.approx(0.0, abs=1e-9)


def test_people_stay_in_the_room_out_of_boxes_and_below_their_greatest_speed(empty_scene):
    rules, apart = ROOMS["people"], []
    for key in range(8):
        scene = empty_scene("people")
        draw(scene, rules, RADIUS, episode_key(key, 0), DT)
        n = scene.room.counts[0]
        assert ((scene.room.people[:n, 4] >= 0.5) & (scene.room.people[:n, 4] <= 1.4)).all()
        for _ in range(100):
            step(scene, rules=rules)
            assert (np.hypot(*scene.room.circles[:n, 3:].T) <= 1.3 * scene.room.people[:n, 4] + 1e-9).all()
            places = scene.room.circles[:n, 0] + 1j * scene.room.circles[:n, 1]
            apart += np.abs(places[:, None] - places)[np.triu_indices(n, 1)].tolist()
        assert (np.abs(scene.room.circles[:n, :2]) < (3.0, 2.5)).all()
    assert np.mean(np.array(apart) < 0.3) < 0.01


@pytest.mark.parametrize("moves", [False, True])
def test_contact_with_a_person_is_a_collision_only_if_the_robot_moves(moves):
    rules = replace(ROOMS["people"], blind=1.0, circles=(6.0, 6.0))
    envs = NavigationVectorEnv(16, task="room", world=rules, lidar="ideal", noise="clean", info="full")
    envs.reset(seed=0)
    touched, collided = 0, 0
    for _ in range(150):
        *_, info = envs.step(np.full((16, 2), [0.3 if moves else 0.0, 0.0], np.float32))
        touched += np.sum(info["clearance"] < 1e-9)
        collided += np.sum(info["collision"])
    assert touched > 0
    assert (collided > 0) == moves
