"""The environments of rooms: equal to the bit in plain Python, alone and in a batch; contact, reward, infos and pictures."""

import math
from dataclasses import fields, replace
from functools import partial

import gymnasium as gym
import numpy as np
import pytest

from turtlebot_gym.compiled.batch import Batch
from turtlebot_gym.envs.navigation import NavigationEnv
from turtlebot_gym.envs.navigation_vector import NavigationVectorEnv
from turtlebot_gym.heart import Episode
from turtlebot_gym.rewards import IN_ROOMS, default_weights
from turtlebot_gym.rooms.lidar import LIDARS, Lidar
from turtlebot_gym.rooms.maps import read_map
from turtlebot_gym.rooms.plan import FloorPlan
from turtlebot_gym.rooms.rules import ROOMS
from turtlebot_gym.rooms.scene import arrays_of
from turtlebot_gym.systems import make_parameters, make_room
from turtlebot_gym.tasks import ROOM
from turtlebot_gym.values import Pose

ID = "turtlebot_gym/TurtleBotRooms-v0"
HALL = FloorPlan(walls=(0.0, 0.0, 3.0, 3.0), start=Pose(0.0, 0.0, 0.0), goal=Pose(2.0, 0.0, 0.0))
room, rooms = partial(NavigationEnv, task="room"), partial(NavigationVectorEnv, task="room")


CASES = [("office", "lds02"), ("cellular", "ideal"), ("people", "lds01"), ("dense", "a1"), ("map", "a1")]


@pytest.mark.parametrize(("world", "lidar"), CASES)
def test_rooms_are_the_same_compiled_and_in_plain_python(world, lidar, in_step, hall):
    p, plan = make_parameters(ROOM, noise="rough", integrator="midpoint", delay=1), read_map(hall) if world == "map" else None
    p = p._replace(reward=default_weights(IN_ROOMS), room=make_room(plan or ROOMS[world], LIDARS[lidar], p.dt))
    batch = Batch(35, p, (Pose(0.0, 0.0, 0.0),), plan=plan)
    plain, contacts = {i: Episode(p, seed=i, plan=plan) for i in (0, 5, 33)}, 0
    for _ in in_step(batch, plain, [0.4, -0.3], [1.2, 0.3], 40):
        for i, episode in plain.items():
            scenes = batch.system.surroundings.at(batch.scenes, i), episode.scene
            np.testing.assert_equal(*([*arrays_of(scene)] for scene in scenes))
        contacts += int(batch.numbers("room.collided").sum())
    assert contacts > 0 or world == "office", "nothing was touched: the test saw too little"
    assert plan is None or batch.scenes.room.squares is plan.scene().room.squares, "one map for all"


def test_contact_ends_an_episode_where_the_footprint_touches_the_wall():
    """The wall is at x = 3, the robot's radius 0.105 m: contact at x = 2.895, of the true pose."""
    env = room(world=replace(HALL, goal=Pose(-2.0, 0.0, 0.0)), noise="clean", lidar="ideal")
    _, info = env.reset(seed=0)
    assert (info["clearance"], info["path_length"], info["collision"]) == (pytest.approx(2.895), 0.0, False)
    x, terminated = 0.0, False
    while not terminated:
        assert x < 2.895
        _, reward, terminated, _, info = env.step(np.array([1.0, 0.0], np.float32))
        x = info["true_state"][0]
        assert info["clearance"] == pytest.approx(2.895 - x)
        assert info["path_length"] == pytest.approx(x)
    assert 2.895 < x < 2.93
    assert (info["collision"], info["is_success"]) == (True, False)
    assert -51.5 < reward < -49.0


def test_nearness_costs_and_progress_is_that_of_the_shortest_way():
    """0.115 m from a wall: 0.5 times (1 - 0.115 / 0.15) a step, and 0.1 for the time.

    Behind a wall whose end is at y = 1 the robot has to drive up, away from the goal, to get nearer.
    """
    env = room(world=replace(HALL, start=Pose(0.0, 2.78, 0.0)), noise="clean", lidar="ideal")
    env.reset(seed=0)
    assert env.step(np.zeros(2, np.float32))[1] == pytest.approx(-0.1 - 0.5 * (1.0 - 0.115 / 0.15))
    behind = replace(HALL, boxes=((1.0, -1.0, 0.1, 4.0),), start=Pose(0.6, 0.0, math.pi / 2.0), goal=Pose(1.5, -1.0, 0.0))
    env = room(world=behind, noise="clean", lidar="ideal", reward={"time": 0.0, "effort": 0.0, "nearness": 0.0})
    env.reset(seed=0)
    rewards = [env.step(np.array([1.0, 0.0], np.float32))[1] for _ in range(30)]
    assert np.mean(rewards[5:]) == pytest.approx(1.0, abs=0.1)


def test_the_first_scan_is_complete_and_its_age_is_observed():
    env = room(world=HALL, noise="clean", lidar=Lidar(beams=36, rate=5.0, range_min=0.0, stamped_at_end=True))
    observation, _ = env.reset(seed=0)
    assert observation.shape == (50,)
    assert observation[[13, 22, 17]] == pytest.approx([3.0 / 3.5, 3.0 / 3.5, 1.0])  # ahead, left, 40 degrees: beyond 3.5 m
    ages = [observation[49]] + [env.step(np.zeros(2, np.float32))[0][49] for _ in range(4)]
    assert ages == pytest.approx([0.0, 0.1, 0.0, 0.1, 0.0])


ERRORS = {"deviation": 0.01, "deviation_share": 0.02, "accuracy": 0.05, "quantization": 0.05, "dropout": 0.1}
LIDAR = Lidar(beams=40, rate=5.0, range_min=0.3, range_max=2.5, dead=((0.5, 0.3),), x=0.05, y=0.02, yaw=0.3, **ERRORS)
CHANGED = {"dead": ((0.5, 0.6),), "turning": not LIDAR.turning, "stamped_at_end": not LIDAR.stamped_at_end}
"""Others are doubled."""


def rollout(**options):
    """Return what an environment tells in 30 steps."""
    env = room(**{"world": "clutter", "lidar": LIDAR, "noise": "rough"} | options)
    values = [env.reset(seed=2)[0].tolist()]
    for step in range(30):
        observation, reward, *ends, info = env.step(np.array([0.5, 0.3 * math.sin(0.3 * step)], np.float32))
        values.append([*observation.tolist(), reward, *ends, info["clearance"]])
    return values


def test_every_parameter_of_a_lidar_changes_a_rollout():
    usual = rollout()
    for name in (field.name for field in fields(Lidar)):
        value = CHANGED[name] if name in CHANGED else 2 * getattr(LIDAR, name)
        assert rollout(lidar=replace(LIDAR, **{name: value})) != usual, name


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
    env = gym.make(ID, world=world, lidar=lidar, render_mode="rgb_array", **options)
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
