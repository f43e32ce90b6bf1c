"""The localizer as a node: it knows where it is, or says that it does not and lets the robot stop."""

import time

import numpy as np
import pytest

from turtlebot_gym.rooms.grid import GridMap
from turtlebot_gym.rooms.scan import Scan
from turtlebot_gym.values import STOP, Command, Fix, Pose
from turtlebot_gym_ros.blocks import Localizer, TurtlebotSimulator
from turtlebot_gym_ros.node.block import Aged

COMMAND = Command(0.1, 0.5)


def hall():
    """A hall of 6 m by 5 m, of which no mirror image is the same."""
    cells = np.zeros((100, 120), np.int8)
    cells[[0, -1]] = cells[:, [0, -1]] = 100
    cells[60:, 70:74], cells[20:26, 20:40] = 100, 100
    return GridMap(cells=cells, resolution=0.05, origin=Pose(-1.5, -2.5, 0.0))


GRID = hall()


class Drive:
    """A simulated robot that drives a circle in the hall, and its localizer."""

    def __init__(self, hall_file, **parameters):
        self.plant = TurtlebotSimulator(
            TurtlebotSimulator.Params(world=str(hall_file), lidar="lds01", noise="wheel", period=0.1, seed=2)
        )
        given = {"localizer": "match", "hits": False, "start": "odometry", **parameters}
        self.node, self.scan, self.said, self.at = Localizer(Localizer.Params(**given)), None, {}, 0

    def go(self, seconds, command=COMMAND, seat=None, see=lambda scan: scan):
        """Drive, and return how often an estimate was published."""
        published = 0
        for _ in range(round(10.0 * seconds)):
            sent = self.plant.step(0.1, command)
            self.scan = sent.get("scan", self.scan and self.scan._replace(age=self.scan.age + 0.1))
            scan = self.scan._replace(value=see(self.scan.value))
            self.said = self.node.step(0.1 if self.at else 0.0, sent["odometry"], scan, GRID, seat)
            seat, self.truth, self.odometry = None, sent["truth"], sent["odometry"]
            self.at += 1
            published += "estimate" in self.said
        return published

    @property
    def error(self):
        mean = self.said["estimate"].belief.mean
        return np.hypot(mean.x - self.truth.x, mean.y - self.truth.y)


@pytest.fixture
def drive(tmp_path, write_map):
    pixels = np.where(GRID.cells[::-1] == 100, 0, 254).astype(np.uint8)
    path = write_map(tmp_path, pixels, origin=list(GRID.origin))
    return lambda **parameters: Drive(path, **parameters)


def test_it_stays_where_the_robot_is_and_ties_the_odometry_to_the_map(drive):
    it = drive(publish_tf=True)
    assert it.go(20.0) == 200
    assert it.error < 0.05
    assert it.node.notice is None
    assert it.node.figures["localization"] == "tracking"
    assert it.node.figures["weight of the best hypothesis"] == "1.00"
    (x, y, theta), child = it.said["tied"].value
    assert child == "odom"
    wheels, mean = it.odometry.pose, it.said["estimate"].belief.mean
    there = complex(x, y) + complex(wheels.x, wheels.y) * np.exp(1j * theta)
    assert there == pytest.approx(complex(mean.x, mean.y), abs=1e-12)
    assert np.exp(1j * (theta + wheels.theta)) == pytest.approx(np.exp(1j * mean.theta), abs=1e-12)


def test_a_robot_that_does_not_know_where_it_is_says_nothing_until_it_does(drive):
    it = drive(start="unknown")
    it.go(0.1)
    assert it.said == {}
    assert it.node.notice.startswith("lost")
    it.go(0.5)
    others = it.said["places"].poses
    assert 1 < len(others) <= 16
    assert min(np.hypot(x - it.truth.x, y - it.truth.y) for x, y, _ in others) < 0.3
    assert it.go(5.0) > 20
    assert "places" not in it.said
    assert it.error < 0.1


def test_it_looks_anew_when_asked(drive):
    it = drive()
    it.go(2.0)
    it.node.services["reinitialize_global_localization"]()
    assert "estimate" not in it.node.step(0.1, it.odometry, it.scan._replace(age=it.scan.age + 0.1), GRID)
    assert it.go(3.0) > 10
    assert it.error < 0.1


def test_a_person_says_where_it_is(drive):
    it = drive()
    it.go(1.0)
    it.go(0.1, seat=Fix(Pose(1.0, 1.0, 0.3), (0.01, 0.01, 0.01), 0.0, True))
    assert it.error > 0.2
    it.go(0.1, seat=Fix(Pose(*it.truth[:3]), (0.01, 0.01, 0.01), 0.0, True))
    assert it.error < 0.15


def nonsense(seed):
    """Return what gives a scan ranges that have nothing to do with the map."""
    rng = np.random.default_rng(seed)
    return lambda scan: scan._replace(ranges=rng.uniform(0.2, 3.0, 360).astype(np.float32))


@pytest.mark.parametrize("when_lost", ["stop", "drive"])
def test_a_lost_robot_stops_unless_told_otherwise(drive, when_lost):
    it = drive(when_lost=when_lost)
    it.go(2.0)
    published = it.go(4.0, see=nonsense(5))  # not after every draw so soon, see the next test
    assert it.node.figures["localization"] == "lost"
    assert published == 40 if when_lost == "drive" else published < 30
    assert ("estimate" in it.said) == (when_lost == "drive")
    assert it.go(5.0, STOP) > 20  # and finds itself when it sees again
    assert it.error < 0.1


@pytest.mark.slow
def test_after_most_draws_of_nonsense_a_standing_robot_finds_itself_within_five_seconds(drive):
    """After 13 of the 15; one of the others believes for a minute that it is elsewhere: a limit of the localizer."""
    right = 0
    for seed in range(1, 16):
        it = drive()
        it.go(2.0)
        it.go(4.0, see=nonsense(seed))
        it.go(5.0, STOP)
        right += "estimate" in it.said and it.error < 0.1
    assert right >= 12


def test_after_steps_that_were_skipped_it_goes_on_from_where_the_wheels_have_led(drive):
    it = drive()
    it.go(2.0)
    for _ in range(30):  # without a scan no step is taken
        sent = it.plant.step(0.1, COMMAND)
        it.scan = sent.get("scan", it.scan._replace(age=it.scan.age + 0.1))
    assert it.node.step(0.0, sent["odometry"], it.scan, GRID)
    assert it.go(2.0) == 20
    assert it.error < 0.05


def test_without_a_scan_that_says_anything_it_is_unsure(drive):
    it = drive()
    it.go(1.0)
    it.go(3.0, see=lambda scan: scan._replace(ranges=np.full(360, np.inf, np.float32)))
    assert it.said
    assert it.node.notice == "unsure: no scan has said anything for 2 s"


def test_a_scan_is_read_as_it_was_sent(drive):
    """Clockwise, from elsewhere, with another number of beams, and mounted as /tf_static says."""
    it = drive()

    def turned(scan):
        half = scan.ranges[::-2]
        return Scan(half, 359 * scan.increment + 0.3, -2.0 * scan.increment, 0.12, 3.5, 0.0, 0.2)

    mount = Pose(-0.032, 0.0, -0.3)
    step = it.node.step
    it.node.step = lambda dt, odometry, scan, *rest: step(dt, odometry, Aged(scan.value, scan.age, mount), *rest)
    it.go(10.0, see=turned)
    assert it.error < 0.05
    assert it.node.figures["localization"] == "tracking"


@pytest.mark.nightly
@pytest.mark.parametrize("localizer", ["match", "robot"])
def test_it_takes_a_twentieth_of_a_core(drive, localizer):
    """With ten scans a second, numba or not: 1.0 % with 20 beams, 3.1 % with 60. The least of ten parts counts.

    Other programs only add to it: 5.6 % were measured over all of them beside two busy processes.
    """
    it, spent = drive(localizer=localizer), []
    step = it.node.step

    def timed(*arguments):
        begin = time.thread_time()
        said = step(*arguments)
        spent.append(time.thread_time() - begin)
        return said

    it.go(1.0)
    it.node.step = timed
    it.go(20.0)
    assert min(np.reshape(spent, (10, -1)).sum(axis=1)) < 0.05  # each is of ten scans


def test_the_map_of_a_file_is_published_once_also_while_the_robot_is_lost(drive, tmp_path):
    it = drive(map=str(tmp_path / "map.yaml"), start="unknown")
    it.go(0.1)
    assert it.said.keys() == {"map"}
    assert it.node.outputs["map"].latched
    np.testing.assert_array_equal(it.said["map"].cells, GRID.cells)
    it.go(0.1)
    assert not it.said
