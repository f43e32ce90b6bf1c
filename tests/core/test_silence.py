"""Beams that return nothing are believed where they agree with what was seen before, and unknown where they do not."""

import math

import numpy as np
import pytest

from turtlebot_gym.beams import beams_of
from turtlebot_gym.motion import Track, moved
from turtlebot_gym.scan_watch import ScanWatch
from turtlebot_gym.values import Command

T, PERIOD, RANGE_MAX = 100.0, 0.2, 3.5
STRAIGHT, ARC, SPOT = Command(0.2, 0.0), Command(0.2, 0.4), Command(0.0, 0.6)
ROOM = np.array([[2.6, 1.1], [-1.6, 1.1], [-1.6, -1.5], [2.6, -1.5]])
CORRIDOR = np.array([[40.0, 0.7], [-40.0, 0.7], [-40.0, -0.7], [40.0, -0.7]])
HALL = np.array([[2.8, 20.0], [-20.0, 20.0], [-20.0, -20.0], [2.8, -20.0]])
OPENING = np.array([[1.5, 0.6], [-1.5, 0.6], [-1.5, -0.6], [1.5, -0.6], [1.5, -20.0], [20.0, -20.0], [20.0, 20.0], [1.5, 20.0]])
NARROW = math.radians(32.0)


def ranges_in(corners, pose, count, rng):
    """Return the ranges of a LiDAR at a pose in a polygon of walls, m, as an LDS-01 sends them."""
    x, y, theta = pose
    angles = theta + 2.0 * math.pi / count * np.arange(count)
    along, a = np.stack((np.cos(angles), np.sin(angles))), corners - (x, y)
    edge = np.roll(a, -1, axis=0) - a
    cross = along[0] * edge[:, 1:] - along[1] * edge[:, :1]
    with np.errstate(all="ignore"):
        length = (a[:, :1] * edge[:, 1:] - a[:, 1:] * edge[:, :1]) / cross
        at = (a[:, :1] * along[1] - a[:, 1:] * along[0]) / cross
    length[~((length > 0.0) & (at >= 0.0) & (at <= 1.0))] = np.inf
    ranges = length.min(axis=0) + rng.normal(0.0, 0.008, count)
    return np.where(ranges < RANGE_MAX, np.round(ranges, 3), 0.0)


class Drive:
    """A robot that drives by a command, and what its watch makes of its scans."""

    def __init__(self, corners, command, *, seed=0, count=360, vary=0, begin=(0.0, 0.0, 0.0)):
        self.vary = vary
        self.corners, self.command, self.count, self.rng = corners, command, count, np.random.default_rng(seed)
        self.watch, self.pose, self.now, self.way = ScanWatch(lag=0.4, returns=0.02, narrow=NARROW, now=T), begin, T, 0.0

    def scan(self, change=lambda ranges: ranges):
        """Drive on until the next scan; return which beams are unknown, or None if scans are refused."""
        self.watch.track.add(self.command, self.now)
        self.watch.move(self.command, self.now)
        self.pose, self.now = moved(self.pose, self.command, PERIOD), self.now + PERIOD
        self.way += abs(self.command.v) * PERIOD
        count = self.count + int(self.rng.integers(-self.vary, self.vary, endpoint=True))
        ranges = change(ranges_in(self.corners, self.pose, count, self.rng))
        beams = beams_of(ranges, first=0.0, increment=2.0 * math.pi / count, range_min=0.12, range_max=RANGE_MAX)
        try:
            known = self.watch.hear(beams, self.now, range_max=RANGE_MAX)
        except ValueError:
            return None
        return None if self.watch.trouble() else np.isnan(known.ranges) & ~np.isnan(beams.ranges)


def covered(middle, width, value=0.0):
    """Return a change that covers a sector, deg: its beams have one value."""

    def change(ranges):
        off = (360.0 / len(ranges) * np.arange(len(ranges)) - middle + 180.0) % 360.0 - 180.0
        return np.where(np.abs(off) < 0.5 * width, value, ranges)

    return change


@pytest.mark.parametrize("command", [STRAIGHT, ARC, SPOT], ids=["straight", "arc", "spot"])
@pytest.mark.parametrize("corners", [ROOM, CORRIDOR, HALL, OPENING], ids=["room", "corridor", "hall", "opening"])
@pytest.mark.parametrize(("count", "vary"), [(90, 0), (360, 0), (230, 10), (720, 20)])
def test_a_healthy_lidar_is_believed(corners, command, count, vary):
    drive = Drive(corners, command, count=count, vary=vary)
    for _ in range(30):
        unknown = drive.scan()
        assert unknown is not None
        assert not unknown.any()


@pytest.mark.parametrize("command", [STRAIGHT, ARC], ids=["straight", "arc"])
@pytest.mark.parametrize("corners", [ROOM, CORRIDOR], ids=["room", "corridor"])
@pytest.mark.parametrize("value", [0.0, math.inf, 99.0, RANGE_MAX])
@pytest.mark.parametrize(("middle", "width"), [(0.0, 60.0), (0.0, 120.0), (0.0, 180.0), (50.0, 90.0), (-40.0, 120.0)])
@pytest.mark.parametrize("vary", [0, 10])
def test_a_sector_that_is_covered_from_the_start_is_unknown_before_the_robot_has_driven_far(
    corners, command, value, middle, width, vary
):
    drive = Drive(corners, command, vary=vary)
    while (unknown := drive.scan(covered(middle, width, value))) is not None and not unknown.any():
        assert drive.way < 0.9
    for _ in range(5):  # and stays so
        unknown = drive.scan(covered(middle, width, value))
        assert unknown is None or unknown.any()


@pytest.mark.parametrize("width", [60.0, 120.0, 180.0, 360.0])
def test_what_was_seen_near_and_is_gone_at_once_is_unknown_at_once(width):
    drive = Drive(ROOM, STRAIGHT)
    for k in range(20):
        on = k % 6 > 2
        unknown = drive.scan(covered(0.0, width) if on else lambda ranges: ranges)
        assert (unknown is None or unknown.any()) == on, k


def test_a_part_that_stands_still_is_found_in_noise_and_somebody_beside_the_robot_is_forgotten():
    drive, seen = Drive(ROOM, STRAIGHT), {}

    def frozen(ranges):
        then = seen.setdefault("ranges", ranges)
        front = np.cos(2.0 * math.pi / len(ranges) * np.arange(len(ranges))) > 0.5
        return np.where(front, then + drive.rng.normal(0.0, 0.02, len(ranges)), ranges)

    while drive.scan(frozen) is not None:
        assert drive.way < 0.9
    assert "does not move as the robot does: the LiDAR is frozen there" in drive.watch.trouble()
    drive.command = Command(0.0, 0.0)
    for _ in range(300):
        assert drive.scan(frozen) is None
    assert drive.scan() is not None


def test_a_track_of_no_motion_proves_nothing():
    """At rest, the edges of free space and of a cover look the same."""
    drive = Drive(OPENING, Command(0.0, 0.0))
    assert isinstance(drive.watch.track, Track)
    assert not any(drive.scan().any() for _ in range(30))
