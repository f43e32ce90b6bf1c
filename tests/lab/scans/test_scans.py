"""Scan against scan: motion, wheels and mount without a map, and the map of one drive."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason="needs the extra [agents]")

from turtlebot_gym.drive import Drive, Seen
from turtlebot_gym.kernel import HAS_LLVM
from turtlebot_gym.localization.tuning import ROBOT
from turtlebot_gym.models.angles import TWO_PI, wrap, wrap_all
from turtlebot_gym.presets import WHEEL
from turtlebot_gym.rooms.grid import FREE, OCCUPIED, GridMap
from turtlebot_gym.rooms.lidar import LIDARS
from turtlebot_gym.rooms.maps import read_map
from turtlebot_gym.rooms.scan import Scan
from turtlebot_gym.values import ORIGIN, Pose
from turtlebot_gym_lab.evaluation.localize import KNOWN, KnownPlace, errors_of, localize, recorded_of
from turtlebot_gym_lab.evaluation.tours import simulated_tour
from turtlebot_gym_lab.scans.calibrating import by_scans, estimates_of
from turtlebot_gym_lab.scans.fit import compose, inverse, relative
from turtlebot_gym_lab.scans.judging import held_out
from turtlebot_gym_lab.scans.map_files import write_map
from turtlebot_gym_lab.scans.mapping import map_of
from turtlebot_gym_lab.scans.pairs import paired
from turtlebot_gym_lab.scans.turning import gyro_by_scans

pytestmark = [pytest.mark.skipif(not HAS_LLVM, reason="takes minutes in plain Python"), pytest.mark.touched("lab", "tests/lab")]

BEAMS, TAKEN = 180, Pose(-0.032, 0.0, 0.0)
BOX = (3.0, 2.0)
"""Half sides of a room, m."""


def ranges_in_box(lidar, half=BOX):
    """Return the exact ranges of a LiDAR at some pose in an empty room."""
    angles = lidar[2] + TWO_PI * np.arange(BEAMS) / BEAMS
    with np.errstate(divide="ignore"):
        to_x = np.where(np.cos(angles) > 0.0, half[0] - lidar[0], half[0] + lidar[0]) / np.abs(np.cos(angles))
        to_y = np.where(np.sin(angles) > 0.0, half[1] - lidar[1], half[1] + lidar[1]) / np.abs(np.sin(angles))
    return np.minimum(to_x, to_y).astype(np.float32)


def box_drive(path, odometry, mount, *, noise=0.005, half=BOX):
    """Return a drive in an empty room, with a scan at each row."""
    random = np.random.default_rng(3)
    scans = []
    for row, pose in enumerate(compose(path, np.broadcast_to(np.array(mount), path.shape))):
        ranges = ranges_in_box(pose, half) + noise * random.standard_normal(BEAMS).astype(np.float32)
        ranges = np.where(ranges < 3.5, ranges, np.inf).astype(np.float32)
        scans.append(Seen(row, ORIGIN, Scan(ranges, 0.0, TWO_PI / BEAMS, 0.1, 3.5), 0.1 * row, Pose(*mount)))
    return Drive(time=0.1 * np.arange(len(path)), odometry=odometry, scans=tuple(scans))


def circles(rows=300):
    """Return a path of arcs, ahead and back to each side, in a room."""
    speed, turn = 0.2 * np.ones(rows), np.where(np.arange(rows) // 50 % 2 == 0, 0.5, -0.6)
    theta = np.concatenate([[0.0], np.cumsum(0.1 * turn)[:-1]])
    middle = theta + 0.05 * turn
    places = np.cumsum(0.1 * speed[:, None] * np.stack([np.cos(middle), np.sin(middle)], axis=1), axis=0)
    path = np.column_stack([np.vstack([np.zeros((1, 2)), places[:-1]]), theta])
    path[:, :2] -= path[:, :2].mean(axis=0)
    return path


def test_pairs_of_exact_scans_move_as_the_robot_did():
    path = circles()
    recorded = recorded_of(box_drive(path, path, TAKEN, noise=0.0))
    pairs = paired(recorded, path, is_placed=True)
    off = pairs.motion - relative(path[pairs.first], path[pairs.second])
    assert pairs.lost == 0
    assert len(pairs.first) > 20
    assert np.abs(off[:, :2]).max() < 0.003  # corners are rounded by lines
    assert np.abs(off[:, 2]).max() < 0.003


def test_walls_along_the_way_alone_do_not_say_how_far():
    path = np.column_stack([np.linspace(-2.0, 2.0, 200), np.zeros(200), np.zeros(200)])
    for half, is_clear in (((100.0, 1.0), False), ((3.0, 1.0), True)):
        recorded = recorded_of(box_drive(path, path, ORIGIN, half=half))
        information = paired(recorded, path, is_placed=True).information
        assert (information[:, 0, 0] > 0.01 * information[:, 1, 1]).all() == is_clear


def test_a_mount_turned_by_pi_and_wheels_are_found_from_a_box():
    path, mount = circles(), Pose(0.04, -0.02, 3.0)
    step, turn = np.hypot(*np.diff(path[:, :2], axis=0).T), np.diff(path[:, 2])
    theta = np.concatenate([[0.0], np.cumsum(turn / 0.9 / 1.05)])
    middle = 0.5 * (theta[1:] + theta[:-1])
    places = np.cumsum((step / 1.05)[:, None] * np.stack([np.cos(middle), np.sin(middle)], axis=1), axis=0)
    odometry = np.column_stack([np.vstack([np.zeros((1, 2)), places]), theta])
    drive = box_drive(path, odometry, mount)
    stated = replace(drive, scans=tuple(seen._replace(mount=TAKEN) for seen in drive.scans))
    found = by_scans(stated)
    assert not found.upside_down
    np.testing.assert_allclose(found.fit.x[:3], [1.05, 0.9, 0.0], atol=0.005)
    np.testing.assert_allclose(found.mount[:2], mount[:2], atol=0.005)
    assert abs(wrap(found.mount.theta - mount.theta)) < 0.005
    judged = held_out(found)
    assert judged.is_good
    assert judged.after < 0.2 * judged.before


def test_a_lidar_that_hangs_upside_down_is_noticed():
    path = circles()
    drive = box_drive(path, path, TAKEN)
    mirrored = tuple(seen._replace(scan=seen.scan._replace(increment=-seen.scan.increment)) for seen in drive.scans)
    found = by_scans(replace(drive, scans=mirrored))
    assert found.upside_down
    np.testing.assert_allclose(found.mount, TAKEN, atol=0.005)


def test_a_straight_drive_determines_neither_the_turn_nor_where_the_lidar_is():
    path = np.column_stack([np.linspace(-2.0, 2.0, 200), np.zeros(200), np.zeros(200)])
    drive = box_drive(path, path / 1.1, ORIGIN)
    found = by_scans(replace(drive, scans=tuple(seen._replace(mount=TAKEN) for seen in drive.scans)))
    estimates = estimates_of(found)
    determined = [name for name, estimate in estimates.items() if estimate.is_determined]
    assert {"scale", "mount_yaw"} <= set(determined)
    assert not {"turn_scale", "mount_x", "mount_y"} & set(determined)
    assert estimates["scale"].value == pytest.approx(1.1, abs=0.005)
    assert found.mount[:2] == TAKEN[:2]  # the prior
    assert estimates["mount_x"].remedy


def test_scans_of_another_place_are_refused():
    path = circles()
    drive = box_drive(path, path, TAKEN)
    random = np.random.default_rng(0)
    wild = tuple(
        seen._replace(scan=seen.scan._replace(ranges=random.uniform(0.2, 3.4, BEAMS).astype(np.float32)))
        for seen in drive.scans
    )
    with pytest.raises(ValueError, match="pairs of scans fit each other"):
        by_scans(replace(drive, scans=wild))


def test_a_gyro_is_calibrated_by_the_turns_of_scans():
    path = circles()
    rate = np.gradient(path[:, 2], 0.1)
    drive = replace(box_drive(path, path, TAKEN), gyro=rate / 1.02 + 0.01)
    gyro = gyro_by_scans(drive, by_scans(drive))
    assert gyro is not None
    assert gyro.scale[0] == pytest.approx(1.02, abs=0.005)
    assert gyro.bias[0] == pytest.approx(0.01, abs=0.001)
    assert gyro.bias[1] > 0.0
    assert gyro_by_scans(box_drive(path, path, TAKEN), by_scans(box_drive(path, path, TAKEN))) is None


@pytest.fixture(scope="module")
def tour():
    """A tour of an office by wheels and with a mount that nobody knows."""
    lidar = replace(LIDARS["lds01"], x=0.05, y=-0.03, yaw=0.2, accuracy=0.0)
    wheels = replace(WHEEL.process, scale=1.04, turn_scale=0.9, veer=0.05)
    return simulated_tour("office", seed=1, wheels=wheels, lidar=lidar, time=300.0).drive


@pytest.mark.nightly
def test_intervals_hold_the_wheels_and_the_mount_of_a_simulated_robot(tour):
    found = by_scans(replace(tour, scans=tuple(seen._replace(mount=TAKEN) for seen in tour.scans)))
    estimates = estimates_of(found)
    true = {"scale": 1.04, "turn_scale": 0.9, "veer": 0.05, "mount_x": 0.05, "mount_y": -0.03, "mount_yaw": 0.2, "delay": 0.0}
    for name, value in true.items():
        estimate = estimates[name]
        assert estimate.is_determined, name
        half = 0.5 * (estimate.high - estimate.low)
        assert abs(estimate.value - value) < 2.0 * half, name  # 4 deviations: one drive in 3000 fails
    assert abs(estimates["scale"].value / 1.04 - 1.0) < 0.01
    assert estimates["turn_scale"].high < 1.0  # it is these wheels that are found, not the usual ones
    assert held_out(found).after < held_out(found).before


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
    assert errors["median"] < 0.05
    assert errors["lost"] == 0.0


def test_a_map_with_wrong_metres_is_worse():
    """The partner: ranges that are too long, uncorrected, put the walls of a map elsewhere."""
    lidar = replace(LIDARS["lds01"], accuracy=0.05)
    drive = simulated_tour("office", seed=1, lidar=lidar, time=150.0).drive
    by_wheels, as_ranges = map_of(drive), map_of(drive, metres="lidar")
    assert as_ranges.range_share == 0.0
    truth = compose(np.broadcast_to(inverse(drive.truth[0]), drive.truth.shape), drive.truth)
    rows = by_wheels.wheels.recorded.rows
    off = [float(np.median(np.hypot(*(drawn.poses - truth[rows])[:, :2].T))) for drawn in (by_wheels, as_ranges)]
    assert off[0] < 0.5 * off[1]


def test_a_map_file_is_what_nav2_reads(tmp_path):
    cells = np.array([[FREE, OCCUPIED, -1], [FREE, FREE, OCCUPIED]], np.int8)
    image = write_map(GridMap(cells=cells, resolution=0.05, origin=Pose(-1.0, 2.0, 0.0)), tmp_path / "a.yaml")
    assert image.read_bytes() == b"P5\n3 2\n255\n" + bytes([254, 254, 0, 254, 0, 205])
    assert "origin: [-1.0, 2.0, 0.0]" in (tmp_path / "a.yaml").read_text()


def test_the_delay_of_scans_is_found():
    path = circles()
    late = replace(box_drive(path, path, TAKEN), odometry=np.vstack([path[1:], path[-1:]]))
    found = by_scans(late)
    assert found.delay == pytest.approx(0.1, abs=0.02)
    assert wrap_all(np.array([found.mount.theta]))[0] == pytest.approx(0.0, abs=0.01)
