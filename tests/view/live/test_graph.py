"""The viewer's observer of a live graph: it hears what the recorder hears, row by row, and notices where a drive begins."""

import select
import time
from threading import Event
from types import SimpleNamespace
from urllib.request import urlopen

import numpy as np
import pytest
from bench import odometry
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import Pose as RosPose
from geometry_msgs.msg import PoseArray, Quaternion
from nav_msgs.msg import Odometry
from rclpy.time import Time
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header
from std_srvs.srv import Trigger
from swallowed import require_end

from turtlebot_gym_ros.base.process import go_on
from turtlebot_gym_ros.graph.graph import Graph
from turtlebot_gym_ros.node.block import Tracks
from turtlebot_gym_ros.node.convert import conversion
from turtlebot_gym_view.graph import LAG, View, Watcher

pytestmark = pytest.mark.touched("lab/turtlebot_gym_view", "tests/view")


@pytest.fixture
def watcher(another_runner):
    watcher = Watcher(another_runner.context)
    another_runner.add(watcher)
    return watcher


def test_it_sees_a_drive_as_the_recorder_does(watcher, wait_for):
    with Graph(world="dense", policy="vfh", seed=3) as graph:
        graph.wait_until(lambda graph: graph.time >= 4.0)
        recorded = graph.trajectory()
        room = graph.latest["obstacles"]
        _, drive, _ = wait_for(lambda: (read := watcher.drive.read())[1] and len(read[1]) > 35 and read)
    rows = min(len(drive), len(recorded.time))
    first = int(np.argmin(np.abs(recorded.true_state - drive.true_state[0]).sum(axis=1)))
    rows = min(rows, len(recorded.time) - first)
    assert rows > 30
    np.testing.assert_allclose(drive.time[:rows], 0.1 * np.arange(rows), atol=1e-6)
    for name in ("true_state", "odometry", "estimate", "covariance", "command"):
        expected, heard = getattr(recorded, name)[first : first + rows], getattr(drive, name)[:rows]
        known = np.isfinite(heard)
        assert known.mean() > 0.9, name  # a busy machine may lose a message of a viewer, which nobody waits for
        np.testing.assert_array_equal(heard[known], expected[known], err_msg=name)
    assert np.isfinite(drive.nis).mean() > 0.9
    assert np.nanmin(drive.clearance) == pytest.approx(recorded.clearance.min(), abs=0.05)
    assert drive.around.room is not None
    np.testing.assert_allclose(drive.around.room.boxes, room.boxes)
    assert len(drive.scans) > 10


class Robot:
    """A robot that says where it is, and nothing else."""

    def __init__(self, peer, watcher, wait_for):
        self._odom = peer.speak("odom", Odometry)
        self._diagnostics = peer.speak("/diagnostics", DiagnosticArray)
        self._watcher, self._wait_for = watcher, wait_for
        topics = ("odom", "/diagnostics")  # those of the test before are gone, and each hears the other
        wait_for(lambda: all(watcher.node.count_publishers(topic) == 1 for topic in topics))
        wait_for(lambda: self._odom.get_subscription_count() == self._diagnostics.get_subscription_count() == 1)

    def at(self, seconds, x=0.0):
        self._odom.publish(odometry(seconds, x=x))

    def rows(self, number):
        """Wait until a drive has so many rows, and return it."""

        def read():
            _, drive, _ = self._watcher.drive.read()
            return drive if drive is not None and len(drive) >= number else None

        return self._wait_for(read)

    def guard(self, level, text, name="/cmd_vel_guard"):
        self._diagnostics.publish(DiagnosticArray(status=[DiagnosticStatus(level=bytes([level]), name=name, message=text)]))


@pytest.fixture
def robot(peer, watcher, wait_for):
    return Robot(peer, watcher, wait_for)


def test_of_a_robot_it_shows_what_there_is(robot):
    for k in range(20):
        robot.at(100.0 + 0.1 * k, x=0.02 * k)
        robot.at(100.0 + 0.1 * k, x=9.0)  # said again
    drive = robot.rows(20 - LAG)
    np.testing.assert_allclose(drive.time, 0.1 * np.arange(len(drive)), atol=1e-6)
    np.testing.assert_allclose(drive.odometry[:, 0], 0.02 * np.arange(len(drive)), atol=1e-9)
    for unknown in (drive.true_state, drive.estimate, drive.nis, drive.clearance, drive.level):
        assert np.isnan(unknown).all()


def test_it_shows_where_a_lost_robot_may_be(robot, peer, watcher, wait_for):
    speaker = peer.speak("hypotheses", PoseArray)
    wait_for(lambda: speaker.get_subscription_count() == 1)
    for number, moment in ((2, 100.05), (0, 100.55)):
        message = PoseArray(poses=[RosPose(orientation=Quaternion(w=1.0)) for _ in range(number)])
        message.header.stamp = Time(nanoseconds=round(moment * 1e9)).to_msg()
        speaker.publish(message)
    wait_for(lambda: len(watcher.listener["hypotheses"]) == 2)
    for k in range(10 + LAG):
        robot.at(100.0 + 0.1 * k)
    drive = robot.rows(10)
    assert [len(places) for places in drive.hypotheses[:10]] == [0, *[2] * 5, *[0] * 4]
    assert drive.hypotheses[3].tolist() == [[0.0, 0.0, 0.0, 0.5]] * 2


def test_tracks_belong_to_the_odometry_of_the_same_stamp(robot, peer, watcher, wait_for):
    speaker, to = peer.speak("tracks", PointCloud2), conversion(Tracks)
    wait_for(lambda: speaker.get_subscription_count() == 1)
    for k in (1, 3):
        stamp = Time(nanoseconds=round((100.0 + 0.1 * k) * 1e9)).to_msg()
        speaker.publish(to.write(Tracks((0.25 * k,) * 40), Header(stamp=stamp)))
    wait_for(lambda: len(watcher.listener["tracks"]) == 2)
    for k in range(10 + LAG):
        robot.at(100.0 + 0.1 * k)
    drive = robot.rows(10)
    np.testing.assert_array_equal(drive.tracks[:10, 4, 0], [np.nan, 0.25, np.nan, 0.75, *[np.nan] * 6])


def test_another_drive_begins_where_time_leaps(robot, watcher, wait_for):
    for start in (100.0, 50.0, 120.0):  # the clock was set back, and then ran far ahead
        before, _, _ = watcher.drive.read()
        for k in range(10):
            robot.at(start + 0.1 * k, x=start)
        wait_for(lambda before=before: watcher.drive.read()[0] > before)
        wait_for(lambda: len(watcher.drive.read()[1]) >= 10 - LAG)
        _, drive, _ = watcher.drive.read()
        assert set(drive.odometry[:, 0]) == {start}
        assert drive.time[0] == 0.0


def test_another_drive_begins_where_the_plant_was_reset_and_shows_its_own_room(watcher, peer, wait_for):
    with Graph(world="office", policy="vfh", seed=3, speed=1.0) as graph:
        graph.wait_until(lambda graph: graph.time >= 2.0)
        before = watcher.drive.read()[0]
        room = graph.latest["obstacles"]
        peer.ask("turtlebot_simulator/reset", Trigger, Trigger.Request())
        wait_for(lambda: graph.latest["obstacles"].boxes != room.boxes)
        wait_for(lambda: watcher.drive.read()[0] > before and len(watcher.drive.read()[1]) > 10)
        _, drive, _ = watcher.drive.read()
        np.testing.assert_allclose(drive.around.room.boxes, graph.latest["obstacles"].boxes)
    moved = np.hypot(*np.diff(drive.true_state[:, :2], axis=0).T)
    assert np.nanmax(moved) < 0.1  # no line leads from one drive to the other


def test_it_hears_the_guard_of_its_robot_alone(robot, watcher, wait_for):
    robot.guard(2, "another one's", name="/robot2/cmd_vel_guard")
    robot.guard(1, "collision monitor: slow")
    wait_for(lambda: watcher.listener["diagnostics"])
    for k in range(10):
        robot.at(100.0 + 0.1 * k)
    drive = robot.rows(10 - LAG)
    assert set(drive.level) == {1.0}
    assert set(drive.report) == {"collision monitor: slow"}


def test_the_command_serves_what_it_hears_and_ends(launch, robot):
    process = launch("-m", "turtlebot_gym_ros", "watch", "--port", "0")
    deadline, sent = time.monotonic() + 60.0, 0
    while not select.select([process.stdout], [], [], 0.05)[0]:
        assert time.monotonic() < deadline
        robot.at(100.0 + 0.1 * sent)
        sent += 1
    url = process.stdout.readline().split()[0]
    with urlopen(url, timeout=20.0) as answer:
        assert b"<h1>Live</h1>" in answer.read()
    process.terminate()
    _, errors = process.communicate(timeout=30.0)
    assert process.returncode == 0
    assert errors.strip() == "waiting for /odom ..."


@pytest.mark.sample(1)
@pytest.mark.parametrize("words", [["--namespace", "a-b"], ["--host", "203.0.113.1"]])
def test_the_command_refuses_with_one_line(launch, robot, words):
    process = launch("-m", "turtlebot_gym_ros", "watch", "--port", "0", *words)
    deadline, sent = time.monotonic() + 60.0, 0
    while process.poll() is None:
        assert time.monotonic() < deadline
        robot.at(100.0 + 0.1 * sent)
        sent += 1
        time.sleep(0.05)
    assert process.returncode == 2
    assert process.stderr.read().strip().splitlines()[-1].startswith("error: ")


WAITS = {
    "a view without a row": lambda: Watcher.wait(SimpleNamespace(_begun=Event())),
    "a view": lambda: View.stay(SimpleNamespace()) or go_on(),
}


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("wait", WAITS.values(), ids=WAITS)
def test_a_wait_ends_at_an_interruption_that_a_destructor_has_swallowed(monkeypatch, wait):
    require_end(monkeypatch, wait)
