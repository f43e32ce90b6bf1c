"""Floor plans, worlds, starts and goals for one episode, and what is refused of them."""

import math

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.error import ResetNeeded

from turtlebot_gym.rooms.plan import FloorPlan
from turtlebot_gym.rooms.rules import RoomRules
from turtlebot_gym.rooms.scan import obstacles_of
from turtlebot_gym.values import Pose

ID = "turtlebot_gym/TurtleBotRooms-v0"
HALL = FloorPlan(walls=(0.0, 0.0, 3.0, 2.0), circles=((0.0, 0.0, 0.5),), boxes=((1.5, 1.0, 0.5, 0.5),))


def make(**options):
    return gym.make(ID, **{"world": "clutter", "lidar": "ideal"} | options)


def vector(n=3, **options):
    return gym.make_vec(ID, num_envs=n, lidar="ideal", info="full", **options)


def test_a_plan_is_written_into_a_scene_whose_obstacles_are_seen_from_above():
    plan = FloorPlan(walls=(1.0, 2.0, 3.0, 4.0), circles=((2.0, 3.0, 0.25, 0.1, -0.2),), boxes=((2.0, 3.0, 0.4, 0.6, 0.7),))
    scene = plan.scene()
    assert scene.room.circles.tolist() == [[2.0, 3.0, 0.25, 0.1, -0.2]]
    assert scene.room.boxes.tolist() == [pytest.approx([2.0, 3.0, 0.2, 0.3, math.cos(0.7), math.sin(0.7)])]
    walls, circles, boxes = obstacles_of(scene)
    assert (walls, circles, boxes) == ((1.0, 2.0, 3.0, 4.0), ((2.0, 3.0, 0.25),), (pytest.approx((2.0, 3.0, 0.4, 0.6, 0.7)),))


def test_all_environments_of_a_batch_have_the_plan_and_a_start_of_their_own():
    plan = FloorPlan(walls=(0.0, 0.0, 2.5, 2.5), circles=((0.0, 0.0, 0.5),), goal=Pose(2.0, 2.0, 0.0))
    envs = vector(40, world=plan)
    _, info = envs.reset(seed=0)
    assert (info["reference"] == (2.0, 2.0, 0.0)).all()
    assert len({tuple(state) for state in info["true_state"]}) == 40
    envs.step(np.zeros((40, 2), np.float32))
    assert (envs.unwrapped._batch.scenes.room.counts == (1, 0)).all()


def test_start_and_goal_are_those_that_were_given():
    env = make(world="dense")
    for seed in range(5):
        _, info = env.reset(seed=seed, options={"start": (-2.0, 0.1, 0.5), "goal": [2.0, 0.0, 1.0]})
        np.testing.assert_allclose([*info["true_state"][:3], *info["reference"]], [-2.0, 0.1, 0.5, 2.0, 0.0, 1.0])
        assert info["clearance"] > 0.0
        assert 3.9 < info["way_left"] < 9.0
    _, info = env.reset(seed=0, options={"goal": (0.3, 0.2, 0.0)})
    assert math.dist(info["true_state"][:2], (0.3, 0.2)) >= 1.5
    _, info = env.reset(seed=0, options={"start": (0.0, 0.0, 0.0), "goal": (0.5, 0.0, 0.0)})  # nearer than rooms are drawn
    assert info["way_left"] < 1.5
    _, info = env.reset(options={"world": HALL, "goal": (-2.0, 1.0, 0.0)})
    assert info["reference"].tolist() == [-2.0, 1.0, 0.0]


def drive(env, **reset):
    """Return what an environment tells at a reset and in five steps after it."""
    observation, info = env.reset(**reset)
    values = [[*observation.tolist(), *info["true_state"].tolist(), *info["reference"].tolist(), info["way_left"]]]
    for _ in range(5):
        observation, reward, *_, info = env.step(np.array([0.5, 0.2], np.float32))
        values.append([*observation.tolist(), reward, info["clearance"]])
    return values


@pytest.mark.parametrize("world", ["corridor", RoomRules(circles=(2.0, 20.0)), HALL])
def test_another_world_is_as_if_the_environment_were_made_with_it_and_holds_for_one_episode(world):
    env, other = make(), make(world=world)
    assert drive(env, seed=4, options={"world": world}) == drive(other, seed=4)
    usual = make()
    usual.reset(seed=4)
    assert drive(env) == drive(usual)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"starts": (0.0, 0.0, 0.0)}, "options must be among 'world', 'start', 'goal', got 'starts'"),
        ({"goal": (0.0, 0.0, math.nan)}, "goal"),
        ({"start": (9.0, 0.0, 0.0)}, "start must be in the room, got Pose"),
        ({"world": HALL, "goal": (0.0, 0.4, 0.0)}, "FloorPlan.goal must be in the room and in no obstacle"),
        ({"world": "attic"}, "world must be one of 'clutter'"),
    ],
)
def test_invalid_options_of_a_reset_are_refused_and_begin_nothing(options, message):
    env = make(disable_env_checker=True).unwrapped
    with pytest.raises(ValueError, match=f"{message}[^\n]*$"):
        env.reset(seed=0, options=options)
    with pytest.raises(ResetNeeded):
        env.step(np.zeros(2, np.float32))


@pytest.mark.parametrize("maker", [make, vector], ids=["scalar", "vector"])
def test_a_room_in_which_no_way_leads_to_the_goal_is_refused_at_each_reset(maker):
    wall = FloorPlan(walls=(0.0, 0.0, 2.0, 2.0), boxes=((0.0, 0.0, 0.1, 4.0),), start=(-1.0, 0.0, 0.0), goal=(1.0, 0.0, 0.0))
    env = maker(world=wall)
    for _ in range(2):
        with pytest.raises(ValueError, match=r"No way leads from start to goal for a robot of radius 0.105 m"):
            env.reset(seed=0)
        with pytest.raises(ResetNeeded):
            env.unwrapped.step(np.zeros(env.action_space.shape, np.float32))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"walls": (0.0, 0.0, 0.0, 1.0)}, "FloorPlan.walls must be around a room"),
        ({"circles": ((None, 0.0, 1.0),)}, r"FloorPlan.circles\[0\].* must be .* number"),
        ({"circles": ((0.0, 0.0, -1.0),)}, r"FloorPlan.circles\[0\] must be 3 or 5 numbers with positive extents"),
        ({"boxes": ((0.0, 0.0, 1.0, 0.0),)}, r"FloorPlan.boxes\[0\] must be 4 or 5 numbers with positive extents"),
        ({"start": (5.0, 0.0, 0.0)}, "FloorPlan.start must be in the room and in no obstacle"),
    ],
)
def test_an_invalid_plan_is_refused_before_anything_is_driven(changes, message):
    with pytest.raises(ValueError, match=message):
        make(world=FloorPlan(**{"walls": (0.0, 0.0, 2.0, 2.0)} | changes))


def test_a_lidar_that_is_too_fast_for_the_control_interval_is_refused():
    with pytest.raises(ValueError, match=r"Lidar\.rate must be at most one scan in a control interval of 0\.2 s, got 10 Hz"):
        make(dt=0.2)
