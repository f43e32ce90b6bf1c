"""Options of reset: a world, a start and a goal for one episode."""

import math

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.error import ResetNeeded

from turtlebot_gym.rooms.plan import FloorPlan
from turtlebot_gym.rooms.rules import RoomRules
from turtlebot_gym.values import Pose

ID = "turtlebot_gym/TurtleBotRooms-v0"
HALL = FloorPlan(walls=(0.0, 0.0, 3.0, 2.0), circles=((0.0, 0.0, 0.5),), boxes=((1.5, 1.0, 0.5, 0.5),))


def drive(env, **reset):
    """Return what an environment tells at a reset and in five steps after it."""
    observation, info = env.reset(**reset)
    values = [[*observation.tolist(), *info["true_state"].tolist(), *info["reference"].tolist(), info["way_left"]]]
    for _ in range(5):
        observation, reward, *_, info = env.step(np.array([0.5, 0.2], np.float32))
        values.append([*observation.tolist(), reward, info["clearance"]])
    return values


def make(**options):
    return gym.make(ID, **{"world": "clutter", "lidar": "ideal"} | options)


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


@pytest.mark.parametrize("world", ["corridor", RoomRules(circles=(2.0, 20.0)), HALL])
def test_another_world_is_as_if_the_environment_were_made_with_it(world):
    assert drive(make(), seed=4, options={"world": world}) == drive(make(world=world), seed=4)


def test_options_hold_for_one_episode():
    values = []
    for options in ({"world": HALL, "start": (-2.0, 0.0, 0.0)}, {}, None):
        env = make()
        env.reset(seed=4, options=options)
        values.append(drive(env))
    assert values[0] == values[1] == values[2]


def test_a_plan_keeps_what_is_not_given():
    env = make(world=FloorPlan(walls=(0.0, 0.0, 3.0, 2.0), goal=Pose(2.0, 0.0, 0.0)))
    _, info = env.reset(seed=1, options={"start": (-2.0, 0.0, 0.0)})
    assert info["reference"].tolist() == [2.0, 0.0, 0.0]
    assert info["way_left"] == pytest.approx(4.0, abs=0.2)
    _, info = env.reset(options={"world": HALL, "goal": (-2.0, 1.0, 0.0)})
    assert info["reference"].tolist() == [-2.0, 1.0, 0.0]


def test_a_picture_shows_the_world_that_was_given():
    env = make(render_mode="rgb_array")
    env.reset(seed=0)
    before = env.render()
    env.reset(seed=0, options={"world": HALL})
    assert (env.render() != before).any()
    env.reset(seed=0)
    np.testing.assert_array_equal(env.render(), before)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"starts": (0.0, 0.0, 0.0)}, "options must be among 'world', 'start', 'goal', got 'starts'"),
        ({"start": (0.0,)}, "start must be x, y and perhaps a heading"),
        *(({"goal": goal}, "goal") for goal in ((0.0, 0.0, math.nan), "door", np.zeros((3, 3)), {0, 1, 2}, [1j, 0, 0])),
        *(({"start": start}, "start must be in the room, got Pose") for start in ((9.0, 0.0, 0.0), (0.0, 2.6, 0.0))),
        ({"world": "corridor", "goal": (3.0, 1.5, 0.0)}, "goal must be in the room, got Pose"),
        ({"world": HALL, "start": (0.3, 0.0, 0.0)}, "FloorPlan.start must be in the room and in no obstacle"),
        ({"world": HALL, "goal": (0.0, 9.0, 0.0)}, "FloorPlan.goal must be in the room and in no obstacle"),
        ({"world": HALL, "goal": (0.0, 0.55, 0.0)}, "No way leads from start to goal for a robot of radius 0.105 m"),
        ({"world": "attic"}, "world must be one of 'clutter'"),
    ],
)
def test_invalid_options_of_a_reset_are_refused_and_begin_nothing(options, message):
    env = make(disable_env_checker=True).unwrapped
    with pytest.raises(ValueError, match=f"{message}[^\n]*$"):
        env.reset(seed=0, options=options)
    with pytest.raises(ResetNeeded):
        env.step(np.zeros(2, np.float32))


def test_more_obstacles_than_can_be_drawn_are_refused():
    for more in ({"circles": (0.0, 385.0)}, {"boxes": (81.0, 81.0)}):
        with pytest.raises(ValueError, match="RoomRules must have at most 384 circles and 80 boxes"):
            RoomRules(**more)
    crowded = FloorPlan(walls=(0.0, 0.0, 9.0, 9.0), circles=((1.0, 0.0, 0.1),) * 500)  # what is given has no such limit
    assert crowded.scene().room.counts.tolist() == [500, 0]


def vector(n=3, **options):
    return gym.make_vec(ID, num_envs=n, lidar="ideal", info="full", **options)


@pytest.mark.parametrize("maker", [make, vector], ids=["scalar", "vector"])
@pytest.mark.parametrize("world", [{"start": (50.0, 0.0, 0.0)}, {"half_length": 1e-9}, {"min_distance": 1e9}], ids=str)
def test_a_room_in_which_no_way_leads_to_the_goal_is_refused_at_each_reset(maker, world):
    env = maker(world=world)
    for _ in range(2):
        with pytest.raises(ValueError, match=r"No way leads from start to goal for a robot of radius 0.105 m"):
            env.reset(seed=0)
        with pytest.raises(ResetNeeded):
            env.unwrapped.step(np.zeros(env.action_space.shape, np.float32))
