"""Gazebo worlds as people have them: includes, frames, solid shapes, meshes, and starts inside of what encloses."""

from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from scipy.ndimage import label

from turtlebot_gym.rooms.gazebo import read_gazebo
from turtlebot_gym.rooms.sensing import clearance

WORLDS = Path(__file__).parents[3] / "shared" / "data" / "worlds"
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


def ring():
    """Return four walls around the origin, 4 m long."""
    places = ("0 2 0.5 0 0 0", "0 -2 0.5 0 0 0", "2 0 0.5 0 0 1.5708", "-2 0 0.5 0 0 1.5708")
    return [model("<box><size>4.1 0.1 1</size></box>", place) for place in places]


def starts(plan):
    """Return the places where episodes start and end, shape (100, 2)."""
    envs = gym.make_vec("turtlebot_gym/TurtleBotRooms-v0", num_envs=50, world=plan, info="full")
    info = envs.reset(seed=0)[1]
    return np.concatenate([info[key][:, :2] for key in ("true_state", "reference")])


@pytest.mark.parametrize(
    ("shape", "pose", "inside", "outside"),
    [
        (BOX, "1 2 0.5 0 0 0.3", (1.8, 2.25), (1.8, 2.6)),
        (BOX, '<pose degrees="true">1 2 0.5 0 0 90</pose>', (1.0, 2.9), (1.3, 2.0)),
        (BOX, "1 2 1 0 1.5708 0", (1.0, 2.1), (1.6, 2.0)),  # it stands on its end
        (PILLAR, "1 2 0.5 0 0 0", (1.1, 2.1), (1.2, 2.2)),
        ("<sphere><radius>0.5</radius></sphere>", "1 2 0.48 0 0 0", (1.35, 2.0), (1.45, 2.0)),  # cut 0.3 m below its centre
        ("<box><size>1 1 0.1</size></box>", "1 2 0.05 0 0 0", (1.4, 2.4), (1.6, 2.0)),  # no robot climbs it
        ("<box><size>1 0.01 1</size></box>", "1 2 0.5 0 0 0.3", (1.0, 2.0), (1.0, 2.2)),  # narrower than a cell
        (BOX, "1 2 2.4 0 0 0", None, (1.0, 2.0)),
        ("<box><size>1 1 0.01</size></box>", "1 2 0 0 0 0", None, (1.0, 2.0)),
        ("<plane><normal>0 0 1</normal></plane>", "", None, (0.0, 0.0)),
    ],
)
def test_shapes_are_cut_at_the_height_of_the_lidar(tmp_path, shape, pose, inside, outside):
    corners = model(PILLAR, "-2 -2 0.5 0 0 0"), model(PILLAR, "5 5 0.5 0 0 0")
    scene = read_gazebo(world(tmp_path, model(shape, pose), *corners)).scene()
    assert inside is None or clearance(scene, *inside) <= 0.0
    assert clearance(scene, *outside) > 0.0


def middle(plan):
    """Return the middle of what is occupied in a plan's map, m."""
    row, column = np.nonzero(plan.map.cells == 100)
    return plan.map.resolution * (np.array((column.mean(), row.mean())) + 0.5) + plan.map.origin[:2]


OUTER = f'<model name="o"><static>1</static><pose>0 5 0 0 0 0</pose>{model(PILLAR, "1 1 0 0 0 0", static="0")}</model>'


@pytest.mark.parametrize(
    ("models", "place"),
    [
        ([model(PILLAR, "1 0 0 0 0 1.5707963267948966", link="1 0 0 0 0 0", collision="0 1 0 0 0 0")], (0.0, 1.0)),
        ([model(PILLAR, '<pose relative_to="world">1 2 0 0 0 0</pose>')], (1.0, 2.0)),
        ([OUTER], (1.0, 6.0)),
    ],
)
def test_a_pose_is_that_of_what_holds_it(tmp_path, models, place):
    np.testing.assert_allclose(middle(read_gazebo(world(tmp_path, *models))), place, atol=1e-6)


def library(folder, name="shelf"):
    """Write a model into a folder of models."""
    (folder / name).mkdir(parents=True)
    (folder / name / "model.sdf").write_text(f'<sdf version="1.10">{model(PILLAR, "5 5 0 0 0 0", name="shelf")}</sdf>')


MOVED = '<uri>model://shelf</uri><pose degrees="1">1 2 0 0 0 9</pose><static>0</static>'


@pytest.mark.parametrize(
    ("include", "place", "where"),
    [
        ("<include><uri>model://shelf</uri></include>", (5.0, 5.0), "models"),
        (f"<include>{MOVED}</include>", (1.0, 2.0), "../../elsewhere"),
        (f'<model name="m"><pose>1 0 0 0 0 0</pose><include>{MOVED}</include></model>', (2.0, 2.0), "models"),  # as TurtleBot3
        ("<include><uri>\n https://fuel.gazebosim.org/1.0/Open/models/Shelf</uri></include>", (5.0, 5.0), "cache"),
    ],
)
@pytest.mark.filterwarnings("ignore:.*stands still")
def test_includes_are_followed(tmp_path, monkeypatch, include, place, where):
    path = world(tmp_path / "a" / "worlds", include)
    if where == "cache":
        library(tmp_path / "fuel.gazebosim.org" / "open" / "models" / "shelf", "2")
    else:
        library((path.parent / where).resolve())
    monkeypatch.setenv("GZ_FUEL_CACHE_PATH", str(tmp_path))
    monkeypatch.setenv("GZ_SIM_RESOURCE_PATH", f"/nowhere:{tmp_path / 'elsewhere'}")
    np.testing.assert_allclose(middle(read_gazebo(path)), place, atol=1e-6)


def test_what_is_left_out_is_said(tmp_path):
    robot = model(BOX, name="tb", static="0", more='<joint name="wheel" type="continuous"/>')
    box, mesh = model(PILLAR, "1 2 0.5 0 0 0", name="box", static="0"), model("<mesh><uri>model://hall/wall.dae</uri></mesh>")
    heights = model("<heightmap><uri>h.png</uri></heightmap>")
    path = world(tmp_path, box, robot, mesh, heights, "<include><uri>model://nowhere</uri></include>")
    with pytest.warns(UserWarning, match=".") as said:
        plan = read_gazebo(path)
    np.testing.assert_allclose(middle(plan), (1.0, 2.0), atol=1e-6)
    texts = "".join(str(notice.message) for notice in said)
    for name in ("'box' can be moved", "'tb' is left out", "'model://hall/wall.dae'", "a heightmap", "model://nowhere"):
        assert name in texts


@pytest.mark.parametrize(
    ("models", "message"),
    [
        ([model(PILLAR, '<pose relative_to="x">0 0 0 0 0 0</pose>')], "the pose of 'm' is relative to 'x'"),
        ([model(PILLAR, "0 0 0 0 0")], "'0 0 0 0 0' must be 6 finite numbers"),
        ([model(BOX, "0 0 4 0 0 0")], "holds no obstacle at the height of a robot"),
        (["</wrong>"], "is not a Gazebo world"),
    ],
)
def test_worlds_that_cannot_be_read_are_refused(tmp_path, models, message):
    with pytest.raises(ValueError, match=message):
        read_gazebo(world(tmp_path, *models))


def test_starts_and_goals_are_inside_of_what_encloses(tmp_path):
    far = model(PILLAR, "8 0 0.5 0 0 0")
    places = starts(read_gazebo(world(tmp_path, *ring(), far)))
    assert (abs(places) < 2.0).all()
    assert abs(places).max() > 1.2
    gap = [*ring()[:3], model("<box><size>3 0.1 1</size></box>", "-2 -0.5 0.5 0 0 1.5708"), far]
    assert starts(read_gazebo(world(tmp_path, *gap)))[:, 0].max() > 3.0  # a door of 1 m: the ground is not enclosed


@pytest.mark.skipif(not WORLDS.is_dir(), reason="the worlds of TurtleBot3 are not there")
@pytest.mark.filterwarnings("ignore:.*hexagon.dae", "ignore:.*wall.dae")
def test_turtlebot3s_worlds_are_read():
    plan = read_gazebo(WORLDS / "turtlebot3_dqn_stage1.world")
    assert label(plan.map.cells == 100)[1] == 1
    assert (abs(starts(plan)) < 2.35).all()
    assert label(read_gazebo(WORLDS / "turtlebot3_world.world").map.cells == 100)[1] == 9  # without its walls, which are meshes


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
    places = starts(plan) - (1.0, 0.0)
    assert (abs(places) < 1.9).all()
