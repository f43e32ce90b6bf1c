"""Gazebo worlds as people have them: includes, frames, solid shapes, meshes, and starts inside of what encloses."""

import gzip
import math
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from scipy.ndimage import label

from turtlebot_gym.rooms.gazebo import read_gazebo
from turtlebot_gym.rooms.sensing import clearance
from turtlebot_gym.values import Pose

WORLDS = Path(__file__).parents[3] / "shared" / "data" / "worlds"
BARN = WORLDS.parent / "barn"
PILLAR = "<cylinder><radius>0.2</radius><length>1</length></cylinder>"
BOX = "<box><size>2 0.4 1</size></box>"


def model(geometry, pose="", *, name="m", static="1", more="", link="", collision=""):
    """Return a model with one collision; poses are elements or texts."""
    tags = [f"<pose>{text}</pose>" if text and text[0] != "<" else text for text in (pose, link, collision)]
    return (
        f'<model name="{name}"><static>{static}</static>{tags[0]}{more}<link name="l">{tags[1]}'
        f'<collision name="c">{tags[2]}<geometry>{geometry}</geometry></collision></link></model>'
    )


def world(folder, *models, name="a.world", version="1.9"):
    """Write a world, and return its path."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / name).write_text(f'<sdf version="{version}"><world name="w">{"".join(models)}</world></sdf>')
    return folder / name


def ring(half=2.0, height="0.5 0 0 0"):
    """Return four walls around the origin."""
    places = [(0, half, 0), (0, -half, 0), (half, 0, 90), (-half, 0, 90)]
    return [
        model(f"<box><size>{2 * half + 0.1} 0.1 1</size></box>", f'<pose degrees="1">{x} {y} 0.5 0 0 {yaw}</pose>')
        for x, y, yaw in places
    ]


def starts(plan, seeds=50):
    """Return the places where episodes start and end, shape (2 seeds, 2), in plain Python and in a batch alike."""
    env = gym.make("turtlebot_gym/TurtleBotRooms-v0", world=plan)
    infos = [env.reset(seed=seed)[1] for seed in range(seeds)]
    batch = gym.make_vec("turtlebot_gym/TurtleBotRooms-v0", num_envs=seeds, world=plan, info="full")
    many = batch.reset(seed=list(range(seeds)))[1]
    np.testing.assert_array_equal(many["true_state"], [info["true_state"] for info in infos])
    return np.array([info[key][:2] for info in infos for key in ("true_state", "reference")])


@pytest.mark.sample(6)
@pytest.mark.parametrize(
    ("shape", "pose", "inside", "outside"),
    [
        (BOX, "1 2 0.5 0 0 0.3", (1.8, 2.25), (1.8, 2.6)),
        (BOX, '<pose degrees="true">1 2 0.5 0 0 90</pose>', (1.0, 2.9), (1.3, 2.0)),
        (BOX, "1 2 1 0 1.5708 0", (1.0, 2.1), (1.6, 2.0)),  # it stands on its end
        (PILLAR, "1 2 0.5 0 0 0", (1.1, 2.1), (1.2, 2.2)),
        ("<sphere><radius>0.5</radius></sphere>", "1 2 0.48 0 0 0", (1.35, 2.0), (1.45, 2.0)),  # cut 0.3 m below its centre
        ("<box><size>1 1 0.1</size></box>", "1 2 0.05 0 0 0", (1.4, 2.4), (1.6, 2.0)),  # low, and no robot climbs it
        ("<box><size>1 0.01 1</size></box>", "1 2 0.5 0 0 0.3", (1.0, 2.0), (1.0, 2.2)),  # narrower than a cell
        ("<cylinder><radius>0.1</radius><length>2</length></cylinder>", "1 2 0.18 1.2 0 0", (1.0, 2.0), (1.3, 2.0)),
        ("<ellipsoid><radii>1 0.3 0.4</radii></ellipsoid>", "1 2 0.18 0 0 0", (1.9, 2.0), (1.0, 2.4)),
        (BOX, "1 2 2.4 0 0 0", None, (1.0, 2.0)),
        ("<box><size>1 1 0.01</size></box>", "1 2 0 0 0 0", None, (1.0, 2.0)),
        ("<plane><normal>0 0 1</normal></plane>", "", None, (0.0, 0.0)),
    ],
)
def test_shapes_are_cut_at_the_height_of_the_lidar(tmp_path, shape, pose, inside, outside):
    scene = read_gazebo(
        world(tmp_path, model(shape, pose), model(PILLAR, "-2 -2 0.5 0 0 0"), model(PILLAR, "5 5 0.5 0 0 0"))
    ).scene()
    assert inside is None or clearance(scene, *inside) <= 0.0
    assert clearance(scene, *outside) > 0.0


def middle(plan):
    """Return the middle of what is occupied in a plan's map, m."""
    row, column = np.nonzero(plan.map.cells == 100)
    return plan.map.resolution * (np.array((column.mean(), row.mean())) + 0.5) + plan.map.origin[:2]


@pytest.mark.parametrize(
    ("models", "place"),
    [
        ([model(PILLAR, "1 0 0 0 0 1.5707963267948966", link="1 0 0 0 0 0", collision="0 1 0 0 0 0")], (0.0, 1.0)),
        ([model(PILLAR, '<pose relative_to="world">1 2 0 0 0 0</pose>')], (1.0, 2.0)),
        (
            [f'<model name="o"><static>1</static><pose>0 5 0 0 0 0</pose>{model(PILLAR, "1 1 0 0 0 0", static="0")}</model>'],
            (1.0, 6.0),
        ),
        ([model(PILLAR), '<state world_name="w"><model name="m"><pose>1 2 0 0 0 0</pose></model></state>'], (1.0, 2.0)),
    ],
)
def test_a_pose_is_that_of_what_holds_it(tmp_path, models, place):
    np.testing.assert_allclose(middle(read_gazebo(world(tmp_path, *models))), place, atol=1e-6)


def library(folder, name="shelf", geometry=PILLAR, more=""):
    """Write a model into a folder of models, its newest file under another name than the others."""
    home = folder / name
    home.mkdir(parents=True)
    (home / "model.config").write_text(
        f'<model><sdf version="1.10">new.sdf</sdf><sdf version="1.5">model.sdf</sdf><name>{name}</name></model>'
    )
    (home / "new.sdf").write_text(f'<sdf version="1.10">{model(geometry, "5 5 0 0 0 0", name=name)}{more}</sdf>')
    (home / "model.sdf").write_text("<sdf/>")
    return home


MOVED = '<uri>model://shelf</uri><pose degrees="1">1 2 0 0 0 9</pose><name>n</name><static>0</static>'


@pytest.mark.parametrize(
    ("include", "place", "where"),
    [
        ("<include><uri>model://shelf</uri></include>", (5.0, 5.0), "models"),
        ("<include><uri>model://shelf/new.sdf</uri><pose>1 2 0 0 0 0</pose></include>", (1.0, 2.0), "../models"),
        (f"<include>{MOVED}</include>", (1.0, 2.0), "../../elsewhere"),
        (f'<model name="m"><pose>1 0 0 0 0 0</pose><include>{MOVED}</include></model>', (2.0, 2.0), "models"),  # as TurtleBot3
        ("<include><uri>\n https://fuel.gazebosim.org/1.0/Open/models/Shelf</uri></include>", (5.0, 5.0), "cache"),
    ],
)
@pytest.mark.filterwarnings("ignore:.*stand still here. n")
def test_includes_are_followed(tmp_path, monkeypatch, include, place, where):
    path = world(tmp_path / "a" / "worlds", include)
    in_cache = {"folder": tmp_path / "fuel.gazebosim.org" / "open" / "models" / "shelf", "name": "2"}
    library(**(in_cache if where == "cache" else {"folder": (path.parent / where).resolve()}))
    monkeypatch.setenv("GZ_FUEL_CACHE_PATH", str(tmp_path))
    monkeypatch.setenv("GZ_SIM_RESOURCE_PATH", f"/nowhere:{tmp_path / 'elsewhere'}")
    np.testing.assert_allclose(middle(read_gazebo(path)), place, atol=1e-6)


def test_what_is_left_out_is_said(tmp_path):
    robot = model(BOX, name="tb", static="0", more='<plugin filename="libgazebo_ros_diff_drive.so" name="d"/>')
    path = world(
        tmp_path,
        model(PILLAR, "1 2 0.5 0 0 0", name="box", static="0"),
        robot,
        model("<mesh><uri>model://hall/wall.dae</uri></mesh>"),
        "<include><uri>model://nowhere</uri></include><include><uri>https://fuel.org/1.0/x/models/Ground Plane</uri></include>",
        model("<heightmap><uri>h.png</uri></heightmap>"),
        '<actor name="ann"/>',
    )
    with pytest.warns(UserWarning, match=".") as said:
        plan = read_gazebo(path)
    np.testing.assert_allclose(middle(plan), (1.0, 2.0), atol=1e-6)
    texts = sorted(str(notice.message) for notice in said)
    begins = [
        "a heightmap is left out: it is not read here.",
        "left out as robots: tb.",
        "left out, since not found (",
        "left out, since their ways are not read: ann.",
        "models that are not static stand still here: box.",
        "the mesh 'model://hall/wall.dae' is left out: not found",
    ]
    assert len(texts) == 6
    assert all(text.startswith(f"a.world: {begin}") and "\n" not in text for text, begin in zip(texts, begins, strict=True))
    assert "model://nowhere" in texts[2]


@pytest.mark.parametrize(
    ("models", "message"),
    [
        ([model(PILLAR, '<pose relative_to="x">0 0 0 0 0 0</pose>')], "the pose of 'm' is relative to 'x': state it"),
        ([model(PILLAR, "0 0 0 0 0")], "'0 0 0 0 0' must be 6 finite numbers"),
        ([model("<cylinder><radius>-1</radius><length>1</length></cylinder>")], "radius must be positive, not -1"),
        (["<include><uri>model://loop/x.sdf</uri><placement_frame>l</placement_frame></include>"], "placement_frame of"),
        ([model(BOX, "0 0 4 0 0 0")], "holds no obstacle at the height of a robot"),
        (["</wrong>"], "is not a Gazebo world"),
        (
            ["<include><uri>model://a.world</uri></include>", "<include><uri>model://loop</uri></include>"],
            "include one another more than 20 deep",
        ),
    ],
)
def test_worlds_that_cannot_be_read_are_refused(tmp_path, models, message):
    loop = tmp_path / "models" / "loop"
    loop.mkdir(parents=True)
    (loop / "model.sdf").write_text("<sdf><model name='l'><include><uri>model://loop</uri></include></model></sdf>")
    (loop / "x.sdf").write_text("<sdf><model name='x'/></sdf>")
    with pytest.raises(ValueError, match=message):
        read_gazebo(world(tmp_path, *models))


def test_starts_and_goals_are_inside_of_what_encloses(tmp_path):
    far = model(PILLAR, "8 0 0.5 0 0 0")
    places = starts(read_gazebo(world(tmp_path, *ring(), far)), seeds=20)
    assert (abs(places) < 2.0).all()
    assert abs(places).max() > 1.2
    gap = [*ring()[:3], model("<box><size>3 0.1 1</size></box>", "-2 -0.5 0.5 0 0 1.5708"), far]
    assert starts(read_gazebo(world(tmp_path, *gap)), seeds=20)[:, 0].max() > 3.0  # a door of 1 m: the ground is not enclosed
    given = read_gazebo(world(tmp_path, *ring(), far), start=Pose(4.0, 0.0, 0.0))
    assert not (given.map.cells == -1).any()


@pytest.mark.skipif(not WORLDS.is_dir(), reason="the worlds of TurtleBot3 are not there")
@pytest.mark.parametrize(("name", "half"), [("turtlebot3_dqn_stage1", 2.35), ("turtlebot3_world", 1.25)])
@pytest.mark.filterwarnings("ignore:.*hexagon.dae", "ignore:.*wall.dae")
def test_episodes_start_inside_of_turtlebot3s_worlds(name, half):
    plan = read_gazebo(WORLDS / f"{name}.world")
    assert label(plan.map.cells == 100)[1] == (9 if name == "turtlebot3_world" else 1)
    assert name == "turtlebot3_world" or (abs(starts(plan)) < half).all()  # whose walls are meshes, which are not there


def test_what_stands_on_a_thick_floor_stands_on_the_ground(tmp_path):
    floor, lamp = (
        model(f"<box><size>8 8 {size}</size></box>", f"0 0 {height} 0 0 0") for size, height in ((0.2, 0.05), (1, 2))
    )
    with pytest.warns(UserWarning, match="the ground is the top of a box, at 0.15 m"):
        plan = read_gazebo(world(tmp_path, floor, model(PILLAR, "2 0 0.65 0 0 0"), lamp))
    np.testing.assert_allclose(middle(plan), (2.0, 0.0), atol=1e-6)
    with pytest.raises(ValueError, match="no obstacle at the height of a robot"):
        read_gazebo(world(tmp_path, floor.replace("0 0 0.05", "0 0 0.5"), model(PILLAR, "2 0 1.1 0 0 0")))


@pytest.mark.parametrize("ending", ["stl", "obj", "dae"])
def test_a_mesh_has_its_outline_at_the_height_of_the_lidar(tmp_path, ending):
    trimesh = pytest.importorskip("trimesh")
    pytest.importorskip("collada")
    parts = [((4.2, 0.2, 2.0), (0.0, y, 1.0)) for y in (2.0, -2.0)] + [((0.2, 4.0, 2.0), (x, 0.0, 1.0)) for x in (2.0, -2.0)]
    parts += [((4.0, 4.0, 0.02), (0.0, 0.0, -0.01)), ((1.0, 1.0, 0.1), (0.0, 0.0, 0.8))]  # a floor, and a table top
    boxes = [trimesh.creation.box(size, trimesh.transformations.translation_matrix(place)) for size, place in parts]
    trimesh.util.concatenate(boxes).apply_scale(1000.0).export(tmp_path / f"walls.{ending}")  # as drawn in mm
    shape = f"<mesh><uri>file://walls.{ending}</uri><scale>0.001 0.001 0.001</scale></mesh>"
    plan = read_gazebo(world(tmp_path, model(shape, "1 0 0 0 0 0")))
    scene = plan.scene()
    assert clearance(scene, 2.5, 0.0) == pytest.approx(0.4, abs=0.03)
    assert clearance(scene, 1.0, 0.0) == 1.0  # the most on a map: neither the table top nor the floor
    assert clearance(scene, 1.02, 2.02) < 0.0
    places = starts(plan, seeds=20) - (1.0, 0.0)
    assert (abs(places) < 1.9).all()


@pytest.mark.skipif(not BARN.is_dir(), reason="the worlds of the BARN challenge are not there")
@pytest.mark.parametrize("number", [0, 100])
def test_the_barn_challenges_files_are_its_numbers(tmp_path, number):
    path = tmp_path / "barn.world"
    path.write_bytes(gzip.decompress((BARN / f"world_{number}.world.gz").read_bytes()))
    start, goal = (Pose(-2.0, y, math.pi / 2.0) for y in (3.0, 13.0))
    plan, worlds = read_gazebo(path, start=start, goal=goal), np.load(BARN / "worlds.npz")
    first = int(worlds["count"][:number].sum())
    expected = worlds["circles"][first : first + worlds["count"][number]]
    row, column = np.indices(plan.map.cells.shape)
    x, y = ((at + 0.5) * 0.05 + corner for at, corner in zip((column, row), plan.map.origin, strict=False))
    away = np.min([np.hypot(x - a, y - b) - radius for a, b, radius in expected], axis=0)
    np.testing.assert_array_equal((plan.map.cells == 100)[abs(away) > 1e-3], (away <= 0.0)[abs(away) > 1e-3])
    observation, info = gym.make("turtlebot_gym/TurtleBotRooms-v0", world=plan, lidar="ideal").reset(seed=1)
    np.testing.assert_allclose(info["true_state"][:3], start)
    assert observation[0] == pytest.approx(10.0, abs=0.3)
