"""The localizer as a node: it knows where it is, or says that it does not and lets the robot stop."""

import numpy as np
import pytest

from turtlebot_gym.rooms.grid import GridMap
from turtlebot_gym.rooms.scan import Scan
from turtlebot_gym.values import STOP, Command, Pose
from turtlebot_gym_ros.blocks import Localizer, TurtlebotSimulator
from turtlebot_gym_ros.node.block import Stamped

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
        options = {"localizer": "match", "hits": False, "start": "odometry", **parameters}
        self.node, self.scan, self.answer, self.at = Localizer(Localizer.Params(**options)), None, {}, 0

    def go(self, seconds, command=COMMAND, initial_pose=None, see=lambda scan: scan):
        """Drive, and return how often an estimate was published."""
        published = 0
        for _ in range(round(10.0 * seconds)):
            sent = self.plant.step(0.1, command)
            self.scan = sent.get("scan", self.scan and self.scan._replace(age=self.scan.age + 0.1))
            scan = self.scan._replace(value=see(self.scan.value))
            self.answer = self.node.step(0.1 if self.at else 0.0, sent["odometry"], scan, GRID, initial_pose)
            initial_pose, self.truth, self.odometry = None, sent["truth"], sent["odometry"]
            self.at += 1
            published += "estimate" in self.answer
        return published

    @property
    def error(self):
        mean = self.answer["estimate"].belief.mean
        return np.hypot(mean.x - self.truth.x, mean.y - self.truth.y)


@pytest.fixture
def drive(tmp_path, write_map):
    pixels = np.where(GRID.cells[::-1] == 100, 0, 254).astype(np.uint8)
    path = write_map(tmp_path, pixels, origin=list(GRID.origin))
    return lambda **parameters: Drive(path, **parameters)


def test_it_stays_where_the_robot_is_and_ties_the_odometry_to_the_map(drive):
    loop = drive(publish_tf=True)
    assert loop.go(20.0) == 200
    assert loop.error < 0.05
    assert loop.node.notice is None
    assert loop.node.figures["localization"] == "tracking"
    assert loop.node.figures["weight of the best hypothesis"] == "1.00"
    (x, y, theta), child = loop.answer["tf"].value
    assert child == "odom"
    wheels, mean = loop.odometry.pose, loop.answer["estimate"].belief.mean
    expected = complex(x, y) + complex(wheels.x, wheels.y) * np.exp(1j * theta)
    assert expected == pytest.approx(complex(mean.x, mean.y), abs=1e-12)
    assert np.exp(1j * (theta + wheels.theta)) == pytest.approx(np.exp(1j * mean.theta), abs=1e-12)


def test_a_robot_that_does_not_know_where_it_is_says_nothing_until_it_does(drive):
    loop = drive(start="unknown")
    for _ in range(2):
        loop.go(0.1)
        assert loop.answer == {}
        assert loop.node.notice.startswith("lost")
        assert loop.go(5.5) > 20
        assert loop.error < 0.1
        loop.node.services["reinitialize_global_localization"]()


def nonsense(seed):
    """Return what gives a scan ranges that have nothing to do with the map."""
    rng = np.random.default_rng(seed)
    return lambda scan: scan._replace(ranges=rng.uniform(0.2, 3.0, 360).astype(np.float32))


@pytest.mark.parametrize("when_lost", ["stop", pytest.param("drive", marks=pytest.mark.slow)])
def test_a_lost_robot_stops_unless_told_otherwise(drive, when_lost):
    loop = drive(when_lost=when_lost)
    loop.go(2.0)
    published = loop.go(4.0, see=nonsense(5))  # not after every draw so soon, see the next test
    assert loop.node.figures["localization"] == "lost"
    assert published == 40 if when_lost == "drive" else published < 30
    assert ("estimate" in loop.answer) == (when_lost == "drive")
    assert loop.go(5.0, STOP) > 20  # and finds itself when it sees again
    assert loop.error < 0.1


def test_a_scan_is_read_as_it_was_sent(drive):
    """Clockwise, from elsewhere, with another number of beams, and mounted as /tf_static says."""
    loop = drive()

    def turned(scan):
        half = scan.ranges[::-2]
        return Scan(half, 359 * scan.increment + 0.3, -2.0 * scan.increment, 0.12, 3.5, 0.0, 0.2)

    mount = Pose(-0.032, 0.0, -0.3)
    step = loop.node.step
    loop.node.step = lambda dt, odometry, scan, *rest: step(dt, odometry, Stamped(scan.value, scan.age, mount), *rest)
    loop.go(10.0, see=turned)
    assert loop.error < 0.05
    assert loop.node.figures["localization"] == "tracking"


def test_a_person_lets_it_go_on_from_where_it_was_after_a_reset_of_the_odometry(drive):
    loop, more = drive(), {}
    step = loop.node.step

    def moved(dt, odometry, *rest):
        x, y, theta = odometry.pose
        return step(dt, odometry._replace(pose=Pose(x + 2.0, y, theta)), *rest, **more)

    loop.go(5.0)
    loop.node.step = moved
    assert loop.go(1.0, STOP) == 0
    assert "odometry jumps by 2.00 m" in loop.node.fault
    more["resume"] = True
    assert loop.go(0.1, STOP) == 1
    assert loop.error < 0.05
    assert loop.node.fault is None


def test_the_map_of_a_file_is_published_once_also_while_the_robot_is_lost(drive, tmp_path):
    loop = drive(map=str(tmp_path / "map.yaml"), start="unknown")
    loop.go(0.1)
    assert loop.answer.keys() == {"map"}
    assert loop.node.outputs["map"].latched
    np.testing.assert_array_equal(loop.answer["map"].cells, GRID.cells)
    loop.go(0.1)
    assert not loop.answer
