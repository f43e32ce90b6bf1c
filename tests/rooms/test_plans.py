"""Rooms that are given: floor plans, Gazebo worlds, and what is refused."""

import gzip
import math
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

from turtlebot_gym.rooms.gazebo import read_gazebo
from turtlebot_gym.rooms.plan import FloorPlan
from turtlebot_gym.rooms.scan import obstacles_of
from turtlebot_gym.rooms.sensing import clearance
from turtlebot_gym.rooms.worlds import find_lidar, find_world
from turtlebot_gym.values import Pose

BARN = Path(__file__).parents[3] / "shared" / "data" / "barn"
WORLD = """<sdf version="1.6"><world name="default">
<model name="floor"><static>1</static><link name="l"><collision name="c"><geometry><plane/></geometry></collision></link>
</model><model name="pillar"><static>true</static><pose>1 2 0 0 0 0</pose><link name="l"><collision name="c">
<geometry><cylinder><radius>0.25</radius><length>1</length></cylinder></geometry></collision></link></model>
<model name="shelf"><static>1</static><pose>-1 0 0 0 0 1.5707963267948966</pose><link name="l"><pose>1 0 0 0 0 0</pose>
<collision name="c"><pose>0 0.5 0 0 0 0.25</pose><geometry><box><size>0.4 0.2 1</size></box></geometry></collision></link>
</model><model name="lamp"><static>1</static><pose>0 0 2.4 0 0 0</pose><link name="l"><collision name="c"><geometry><cylinder>
<radius>9</radius><length>0.2</length></cylinder></geometry></collision></link></model></world></sdf>"""


def test_a_gazebo_world_is_a_map_of_what_stands_in_it(tmp_path):
    path = tmp_path / "one.sdf"
    path.write_text(WORLD)
    plan = read_gazebo(path, start=Pose(0.0, 1.0, 0.0))
    np.testing.assert_array_equal(find_world(str(path)).map.cells, find_world(path).map.cells)
    scene = plan.scene()
    assert clearance(scene, 0.0, 2.0) == pytest.approx(0.75, abs=0.03)  # from the pillar
    # The shelf's model is turned left: its link lies 1 m above it, and the collision half a metre to the left of that.
    assert clearance(scene, -1.5, 1.0) <= 0.0
    assert clearance(scene, -1.2, 1.0) == pytest.approx(0.3 - 0.1 / math.cos(0.25), abs=0.05)
    assert (plan.start, plan.goal) == (Pose(0.0, 1.0, 0.0), None)
    assert plan.walls.x + plan.walls.half_length == pytest.approx(1.25 + 1.0)  # a metre from the pillar
    assert plan.walls.y + plan.walls.half_width == pytest.approx(2.25 + 1.0)


@pytest.mark.skipif(not BARN.is_dir(), reason="the worlds of the BARN challenge are not there")
@pytest.mark.parametrize("number", [0, 100])
def test_the_barn_challenges_files_are_its_numbers(tmp_path, number):
    path = tmp_path / "barn.world"
    path.write_bytes(gzip.decompress((BARN / f"world_{number}.world.gz").read_bytes()))
    plan = read_gazebo(path, start=Pose(-2.0, 3.0, math.pi / 2.0), goal=Pose(-2.0, 13.0, math.pi / 2.0))
    worlds = np.load(BARN / "worlds.npz")
    first = int(worlds["count"][:number].sum())
    expected = worlds["circles"][first : first + worlds["count"][number]]
    row, column = np.indices(plan.map.cells.shape)
    x, y = ((at + 0.5) * 0.05 + start for at, start in zip((column, row), plan.map.origin, strict=False))
    away = np.min([np.hypot(x - a, y - b) - radius for a, b, radius in expected], axis=0)
    np.testing.assert_array_equal((plan.map.cells == 100)[abs(away) > 1e-3], (away <= 0.0)[abs(away) > 1e-3])
    env = gym.make("turtlebot_gym/TurtleBotRooms-v0", world=plan, lidar="ideal")
    observation, info = env.reset(seed=1)
    np.testing.assert_allclose(info["true_state"][:3], [-2.0, 3.0, math.pi / 2.0])
    assert observation[0] == pytest.approx(10.0, abs=0.3)
    assert info["clearance"] > 0.1


def test_a_plan_is_written_into_a_scene_whose_obstacles_are_seen_from_above():
    plan = FloorPlan(
        walls=(1.0, 2.0, 3.0, 4.0),
        circles=((0.0, 1.0, 0.5), (2.0, 3.0, 0.25, 0.1, -0.2)),
        boxes=((1.0, 0.0, 2.0, 1.0), (2.0, 3.0, 0.4, 0.6, 0.7)),
    )
    scene = plan.scene()
    assert (scene.room.walls.tolist(), scene.room.counts.tolist()) == ([1.0, 2.0, 3.0, 4.0], [2, 2])
    assert scene.room.circles.tolist() == [[0.0, 1.0, 0.5, 0.0, 0.0], [2.0, 3.0, 0.25, 0.1, -0.2]]
    assert scene.room.boxes[0].tolist() == [1.0, 0.0, 1.0, 0.5, 1.0, 0.0]
    shown = obstacles_of(scene)
    assert shown.walls == (1.0, 2.0, 3.0, 4.0)
    assert shown.circles == ((0.0, 1.0, 0.5), (2.0, 3.0, 0.25))
    assert shown.boxes == ((1.0, 0.0, 2.0, 1.0, 0.0), pytest.approx((2.0, 3.0, 0.4, 0.6, 0.7)))


def test_all_environments_of_a_batch_have_the_plan_and_a_start_of_their_own():
    plan = FloorPlan(walls=(0.0, 0.0, 2.5, 2.5), circles=((0.0, 0.0, 0.5),), goal=Pose(2.0, 2.0, 0.0))
    envs = gym.make_vec("turtlebot_gym/TurtleBotRooms-v0", num_envs=40, world=plan, lidar="ideal", info="full")
    _, info = envs.reset(seed=0)
    assert (info["reference"] == (2.0, 2.0, 0.0)).all()
    assert len({tuple(state) for state in info["true_state"]}) == 40
    envs.step(np.zeros((40, 2), np.float32))
    batch = envs.unwrapped._batch
    assert (batch.scenes.room.counts == (1, 0)).all()


KNOWN = r"world must be one of 'clutter', .*, or a file \(.world, .sdf, .yaml, .yml\), got 'denser'. Did you mean 'dense'"


@pytest.mark.parametrize(
    ("world", "message"), [("denser", KNOWN), ("nowhere.world", "There is no Gazebo world 'nowhere.world'")]
)
def test_a_missing_world_is_refused(world, message):
    with pytest.raises(ValueError, match=message):
        find_world(world)


NUMBERS = "holds a shape or a pose with missing or malformed numbers"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("no xml", "is not a Gazebo world"),
        ("<?xml version='1.0' encoding='utf-99'?><sdf/>", "is not a Gazebo world: unknown encoding"),
        ("<?xml version='1.0' encoding='shift-jis'?><sdf/>", "is not a Gazebo world: multi-byte encodings"),
        ("<sdf/>", "holds no obstacle at the height of a robot"),
        *((WORLD.replace(*change), NUMBERS) for change in (("0.4 0.2 1", "0.4 0.2"), ("<radius>0.25", "<radius>wide"))),
    ],
)
def test_a_file_that_is_not_a_world_is_refused(tmp_path, text, message):
    (tmp_path / "bad.world").write_text(text)
    with pytest.raises(ValueError, match=message):
        read_gazebo(tmp_path / "bad.world")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"walls": (0.0, 0.0, 0.0, 1.0)}, "FloorPlan.walls must be around a room"),
        ({"walls": (0.0, 0.0, math.nan, 1.0)}, r"FloorPlan.walls\[2\] must be a number from .*, got nan"),
        ({"walls": 1.0}, "FloorPlan.walls must be 4 numbers, got 1.0"),
        ({"walls": (0.0, 0.0, 301.0, 300.0), "goal": (0.0, 0.0, 0.0)}, "A room must have at most 30,000,000 cells of 0.1 m"),
        ({"map": "x"}, "FloorPlan.map must be a GridMap or None, got 'x'"),
        ({"circles": 1.0}, "FloorPlan.circles must be a sequence, got 1.0"),
        *(({"circles": (circle,)}, r"FloorPlan.circles\[0\].* must be .* number") for circle in ((None, 0.0, 1.0), (0.0, 0.0))),
        ({"circles": ((0.0, 0.0, -1.0),)}, r"FloorPlan.circles\[0\] must be 3 or 5 numbers with positive extents"),
        ({"boxes": ((0.0, 0.0, 1.0, 0.0),)}, r"FloorPlan.boxes\[0\] must be 4 or 5 numbers with positive extents"),
        ({"start": (5.0, 0.0, 0.0)}, "FloorPlan.start must be in the room and in no obstacle"),
        ({"goal": (1.0, 1.0, 0.0), "circles": ((1.1, 1.0, 0.2),)}, "FloorPlan.goal must be in the room and in no obstacle"),
        ({"goal": (1.0, 1.0, 0.0), "boxes": ((1.1, 1.0, 0.4, 0.4, 0.3),)}, "FloorPlan.goal must be in the room and in no obs"),
    ],
)
def test_an_invalid_plan_is_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        FloorPlan(**{"walls": (0.0, 0.0, 2.0, 2.0)} | changes)


def test_a_plan_without_a_way_is_refused_before_anything_is_driven():
    cut = FloorPlan(
        walls=(0.0, 0.0, 2.0, 2.0), boxes=((0.0, 0.0, 0.1, 4.0),), start=Pose(-1.0, 0.0, 0.0), goal=Pose(1.0, 0.0, 0.0)
    )
    with pytest.raises(ValueError, match="no way from its start to its goal for a robot of radius"):
        gym.make("turtlebot_gym/TurtleBotRooms-v0", world=cut)
    full = FloorPlan(walls=(0.0, 0.0, 0.3, 0.3), boxes=((0.0, 0.0, 0.4, 0.4),))
    with pytest.raises(ValueError, match="The floor plan has no way between the places that were drawn"):
        gym.make("turtlebot_gym/TurtleBotRooms-v0", world=full)


def test_an_unknown_lidar_and_one_that_is_too_fast_are_refused():
    with pytest.raises(ValueError, match=r"lidar must be one of 'lds01', .*'ideal', got 'lds03'"):
        find_lidar("lds03")
    with pytest.raises(ValueError, match=r"Lidar\.rate must be at most one scan in a control interval of 0\.2 s, got 10 Hz"):
        gym.make("turtlebot_gym/TurtleBotRooms-v0", lidar="ideal", dt=0.2)
