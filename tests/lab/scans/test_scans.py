"""The map of one drive, and the next drive in it."""

import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason="needs the extra [agents]")

from tours import simulated_tour

from turtlebot_gym.kernel import HAS_LLVM
from turtlebot_gym.localization.tuning import ROBOT
from turtlebot_gym.rooms.grid import FREE, OCCUPIED, GridMap
from turtlebot_gym.rooms.maps import read_map
from turtlebot_gym.values import Pose
from turtlebot_gym_lab.evaluation.localize import KNOWN, KnownPlace, errors_of, localize, recorded_of
from turtlebot_gym_lab.scans.map_files import write_map
from turtlebot_gym_lab.scans.mapping import compose, inverse, map_of

pytestmark = [pytest.mark.skipif(not HAS_LLVM, reason="takes minutes in plain Python"), pytest.mark.touched("lab", "tests/lab")]


def mapped(world, seed, time):
    """Return the errors of a drive by another robot in the map of a drive, and whether it was ever lost."""
    first = simulated_tour(world, seed=seed, time=time).drive
    drawn = map_of(first)
    second = simulated_tour(world, seed=seed, time=200.0, generator=np.random.default_rng(99)).drive
    recorded = recorded_of(second)
    truth = compose(np.broadcast_to(inverse(first.truth[0]), second.truth.shape), second.truth)
    place = KnownPlace(drawn.grid.field(hits=True), drawn.grid.frame, ROBOT, Pose(*truth[0].tolist()), KNOWN)
    course = localize(recorded, place)
    return drawn, errors_of(course, np.arange(len(truth)), truth)


@pytest.mark.nightly
def test_the_next_drive_is_localized_in_the_map_of_one_drive(tmp_path):
    drawn, errors = mapped("office", 1, 300.0)
    assert errors["median"] < 0.05
    assert errors["lost"] == 0.0
    path = tmp_path / "lab.yaml"
    write_map(drawn.grid, path)
    read = read_map(path).map
    assert read is not None
    np.testing.assert_array_equal(read.cells, drawn.grid.cells)
    np.testing.assert_allclose(read.frame, drawn.grid.frame)
    with pytest.raises(ValueError, match="exists"):
        write_map(drawn.grid, path)


@pytest.mark.nightly
@pytest.mark.parametrize(("world", "seed"), [("office", 5), ("office", 6), ("dense", 3)])
def test_other_floors_are_mapped_as_well(world, seed):
    _, errors = mapped(world, seed, 600.0)
    assert errors["median"] < 0.08
    assert errors["lost"] == 0.0


def test_a_map_file_is_what_nav2_reads(tmp_path):
    cells = np.array([[FREE, OCCUPIED, -1], [FREE, FREE, OCCUPIED]], np.int8)
    image = write_map(GridMap(cells=cells, resolution=0.05, origin=Pose(-1.0, 2.0, 0.0)), tmp_path / "a.yaml")
    assert image.read_bytes() == b"P5\n3 2\n255\n" + bytes([254, 254, 0, 254, 0, 205])
    assert "origin: [-1.0, 2.0, 0.0]" in (tmp_path / "a.yaml").read_text()
