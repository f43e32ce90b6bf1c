"""The node that tracks people: a real scan of another mount and direction says the same, and its messages keep every bit."""

import math

import numpy as np
import pytest
from std_msgs.msg import Header

from turtlebot_gym import Episode
from turtlebot_gym.rooms.scan import Scan
from turtlebot_gym.systems import Options
from turtlebot_gym.values import STOP, Odometry, Pose
from turtlebot_gym_ros.blocks import PeopleTracker
from turtlebot_gym_ros.node.block import Stamped, Tracks
from turtlebot_gym_ros.node.convert import conversion

NOBODY = Tracks((0.0,) * 40)


def drive(change=lambda scan: (scan, None), steps=60, **parameters):
    """Return what the node publishes as the environment's robot stands among people, and what the environment shows."""
    setup = Options(world="people", lidar="lds01", noise="wheel", observation="ekf,tracks").setup()
    episode = Episode(setup.parameters, setup.waypoints, seed=2, system=setup.system)
    block = PeopleTracker(PeopleTracker.Params(tick=0.1, **parameters))
    lidar, found = setup.parameters.room.lidar, []
    for step in range(steps + 1):
        if step:
            episode.act((0.0, 0.2))
        world, scene = episode.world, episode.scene
        step_of = math.tau / int(lidar.beams)
        scan = Scan(scene.lidar.ranges[1].copy(), 0.0, step_of, lidar.range_min, lidar.range_max)
        scan, mount = change(scan)
        found.append(
            (block.step(0.1, world.senses.odometry, Stamped(scan, world.room.scan_age, mount)), scene.tracker.seen.copy())
        )
    return found


def test_it_shows_what_the_environment_does():
    found = drive()
    for answer, expected in found:
        np.testing.assert_array_equal(np.float32(answer["nearest"]), expected)
    assert any(answer["nearest"] != NOBODY for answer, _ in found)


def test_a_lidar_that_is_mounted_backwards_sees_the_same():
    def turned(scan):  # the same beams, in the same order, from a LiDAR whose zero is behind
        return scan._replace(first=math.pi), Pose(-0.032, 0.0, -math.pi)

    for other, expected in drive(turned):
        np.testing.assert_allclose(other["nearest"], expected, atol=2e-3)


def test_odometry_that_begins_elsewhere_moves_nobody():
    block, scan = PeopleTracker(PeopleTracker.Params()), Scan(np.full(360, 2.0, np.float32), 0.0, math.tau / 360, 0.1, 3.5)
    for step in range(60):
        pose = Pose(5.0 * (step > 30), 0.0, 0.0)
        scan = scan._replace(ranges=np.full(360, 2.0 - 1.5 * (step > 30), np.float32))
        answer = block.step(0.1, Odometry(pose, STOP, True), Stamped(scan, 0.0))
        assert answer["nearest"] == NOBODY
        assert (block.notice is not None) == (step == 31)


def test_tracks_keep_every_bit_as_points():
    rng = np.random.default_rng(0)
    tracks = Tracks(tuple(rng.random(40, np.float32).tolist()))
    to = conversion(Tracks)
    message = to.write(tracks, Header())
    assert [field.name for field in message.fields][:4] == ["x", "y", "vx", "vy"]
    assert to.read(message) == tracks
    names, offsets = zip(*((field.name, field.offset) for field in message.fields), strict=True)
    layout = {"names": names, "formats": ["<f4"] * len(names), "offsets": offsets, "itemsize": message.point_step}
    points = np.frombuffer(message.data, np.dtype(layout))
    assert points["vy"].tolist() == list(tracks[3::8])
    assert message.height == 1
    assert len(message.data) == message.row_step == message.width * message.point_step
    message.fields[0].name = "X"
    with pytest.raises(ValueError, match="tracks must be 5 points of the fields x, y, vx"):
        to.read(message)
    with pytest.raises(ValueError, match="must be 40 finite numbers"):
        to.read(to.write(Tracks((math.nan,) * 40), Header()))
