"""A LiDAR that is frozen, covered or mounted otherwise is refused with the reason; one at work is not."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from turtlebot_gym.beams import Beams
from turtlebot_gym.compiled.batch import Batch
from turtlebot_gym.motion import Motion
from turtlebot_gym.rewards import IN_ROOMS, default_weights
from turtlebot_gym.robots import ROBOTS
from turtlebot_gym.rooms.lidar import LIDARS
from turtlebot_gym.rooms.rules import ROOMS
from turtlebot_gym.scan_watch import ScanWatch
from turtlebot_gym.systems import make_parameters, make_room
from turtlebot_gym.tasks import ROOM
from turtlebot_gym.values import STOP, Command, Pose

BURGER = ROBOTS["burger"]
T, DT = 100.0, 0.1
AROUND = 2.0 * math.pi / 360 * np.arange(360)
BOX = np.float32(1.5) / np.maximum(np.abs(np.cos(AROUND)), np.abs(np.sin(AROUND))).astype(np.float32)
AHEAD, TURN = Command(0.2, 0.0), Command(0.0, 0.5)


def beams(ranges, directions=AROUND):
    """A scan: what is 0 or not finite returned nothing."""
    ranges = np.array(ranges, np.float32)
    ranges[ranges == 0.0] = np.inf
    return Beams(directions, ranges, float(abs(directions[1] - directions[0])))


def watch(returns=0.02):
    return ScanWatch(lag=0.4, returns=returns, narrow=0.56, now=T)


def reasons(command, scans, *, watch=None, rate=0.1):
    """Return what is said at each of some scans, while a command is in force."""
    watch, said = watch or ScanWatch(lag=0.4, returns=0.02, narrow=0.56, now=T), []
    watch.track.add(command, T)
    for k, ranges in enumerate(scans):
        try:
            watch.hear(beams(ranges), T + rate * k)
            said.append(watch.trouble())
        except ValueError as why:
            said.append(str(why))
    return said


def changing(ranges, number):
    rng = np.random.default_rng(1)
    return [ranges + np.round(rng.normal(0.0, 0.005, len(ranges)), 3).astype(np.float32) for _ in range(number)]


def only(*directions):
    """The box, with returns near some directions only, deg."""
    off = np.abs((np.degrees(AROUND)[:, None] - directions + 180.0) % 360.0 - 180.0).min(axis=1)
    return np.where(off < 8.0, BOX, np.inf)


@pytest.mark.parametrize("command", [AHEAD, TURN, Command(-0.05, 0.0), Command(0.2, -1.0)])
@pytest.mark.parametrize("missing", [0.0, 0.3])
def test_equal_scans_while_the_robot_moves_are_a_frozen_lidar_until_they_change(command, missing):
    """Refused within 0.7 s of a drive at 0.2 m/s: 0.4 s of delays, one scan, and 0.02 m."""
    lost = np.random.default_rng(2).random(360) < missing
    frozen = np.where(lost, np.nan, BOX)
    w = watch()
    said = reasons(command, [*changing(BOX, 5), *[frozen] * 20], watch=w)
    assert not any(said[:9])
    assert said[-1] == "the scans have not changed by a bit although the robot moves: the LiDAR is frozen"
    if abs(command.v) >= 0.2:
        assert said[5 + 7]
    w.hear(beams(changing(BOX, 1)[0]), T + 2.5)
    assert w.trouble() == ""


@pytest.mark.parametrize(
    ("command", "ranges"),
    [
        (STOP, BOX),
        (AHEAD, np.full(360, np.inf)),
        (Command(0.2 / 3.5, 0.0), only(90.0, 270.0)),  # along a corridor without noise, 0.2 m
    ],
    ids=["at rest", "without returns", "along a corridor"],
)
def test_equal_scans_that_a_lidar_without_noise_can_give_are_no_fault(command, ranges):
    assert not any(reasons(command, [ranges] * 40, watch=watch(returns=0.0)))


def test_few_returns_are_a_cover_after_half_a_second_unless_halls_are_allowed():
    covered = np.full(360, np.inf)
    for dark in (covered, np.zeros(360), np.full(360, np.nan), np.where(np.arange(360) < 7, 1.0, np.inf)):
        said = reasons(AHEAD, [dark] * 8)
        assert [bool(why) for why in said] == [False] * 6 + [True] * 2
        assert said[-1].startswith("fewer than 2% of the beams return anything: the LiDAR is covered")
        assert not any(reasons(AHEAD, [*changing(BOX, 5), *[dark] * 8, *changing(BOX, 2)])[-2:])  # uncovered
    assert not any(reasons(AHEAD, [covered] * 30, watch=watch(returns=0.0)))


class Drives:
    """Robots that wander in rooms of their own, with a LiDAR that is mounted turned by some quarters of a turn."""

    def __init__(self, lidar, number, *, seed, noise="clean"):
        self.lidar, self.rng, rooms = (
            LIDARS[lidar],
            np.random.default_rng(seed),
            ["dense", "clutter", "corridor", "office", "crowd"],
        )
        base = make_parameters(ROOM, robot="burger", integrator="midpoint", dt=DT, delay=1, noise=noise)
        kinds = [
            base._replace(reward=default_weights(IN_ROOMS), room=make_room(ROOMS[rooms[k % 5]], self.lidar, DT))
            for k in range(number)
        ]
        self.batch, self.number = Batch(number, kinds, (Pose(0.0, 0.0, 0.0),)), number
        self.batch.seeds[:] = 1000 * seed + np.arange(number)
        self.batch.reset(np.ones(number, np.bool_), *self.batch.empty())

    def refused(self, seconds, faults, *, measured=False):
        """Return when each robot's scans are refused, s, by fault; infinite for never.

        Faults are the quarters by which its mount is wrong, "mirrored", "still" (those of a robot that stands) and the delay of
        scans, s, as a float.
        """
        n, angles = self.number, self.lidar.yaw + 2.0 * math.pi / self.lidar.beams * np.arange(self.lidar.beams)
        watches = {quarter: [watch() for _ in range(n)] for quarter in faults}
        times = {quarter: np.full(n, math.inf) for quarter in faults}
        history, noise = [], np.random.default_rng(9)
        commands, until = np.zeros((n, 2)), np.zeros(n, int)
        for tick in range(round(seconds / DT)):
            due, now = until <= tick, T + tick * DT
            v = self.rng.choice([0.2, 0.2, 0.2, 0.1, -0.2, 0.0], due.sum())
            commands[due] = np.stack(
                (v, self.rng.choice([0.0, 0.0, 0.3, 1.0, 2.0], due.sum()) * self.rng.uniform(-1, 1, due.sum())), 1
            )
            until[due] = tick + self.rng.integers(5, 40, due.sum())
            scans = self.batch.scenes.lidar.ranges[:, 1].copy()
            history.append(scans)
            blocked = (scans[:, np.abs(np.angle(np.exp(1j * angles))) < 0.5].min(axis=1) < 0.35) & (commands[:, 0] > 0.0)
            commands[blocked], until[blocked] = (0.0, 1.5), np.maximum(until[blocked], tick + 3)
            touched, twists = self.batch.numbers("room.least").reshape(n) < 0.0, self.batch.numbers("body.true_state")
            for quarter, robots in watches.items():
                for k in np.flatnonzero(~touched & np.isinf(times[quarter])):
                    if tick % max(1, round(1.0 / (self.lidar.rate * DT))) == 0:
                        seen, directions = scans[k], angles
                        if quarter == "mirrored":
                            directions = -angles
                        elif quarter == "still":
                            seen = (history[0][k] + noise.normal(0.0, 0.01, len(angles))).astype(np.float32)
                        elif isinstance(quarter, float):
                            late = history[max(0, tick - round(quarter / DT))][k]
                            blur = noise.normal(0.0, 0.005, len(angles)) * (late > 0.0)
                            seen = (late + blur).astype(np.float32)
                        else:
                            directions = angles + 0.5 * math.pi * quarter
                        robots[k].hear(beams(seen, directions), now, range_max=self.lidar.range_max)
                        times[quarter][k] = now - T if robots[k].trouble() else math.inf
                    robots[k].track.add(Command(*commands[k]), now)
                    if measured:
                        robots[k].move(Command(*twists[k, 3:].tolist()), now)
            self.batch.step((commands / (BURGER.max_linear, BURGER.max_angular)).astype(np.float32))
        return times


@pytest.mark.sample(2)
@pytest.mark.parametrize("number", [10, pytest.param(25, marks=pytest.mark.nightly)])
@pytest.mark.parametrize("lidar", LIDARS)
def test_a_mount_that_contradicts_the_motion_is_refused_and_a_right_one_is_not(lidar, number):
    times = Drives(lidar, number, seed=3).refused(20.0, [*range(4), "mirrored", "still"])
    alone = np.arange(number) % 5 != 4  # somebody who walks beside the robot looks like a part that stands still
    assert np.isinf(times[0][alone]).all()
    for fault in ("mirrored", "still"):
        assert np.isfinite(times[fault]).mean() > 0.7
        assert np.median(times[fault][np.isfinite(times[fault])]) < 5.0
    for quarter in (1, 2, 3):
        caught = np.isfinite(times[quarter])
        assert caught.mean() > 0.8  # the others touched something before, or stood
        assert np.median(times[quarter][caught]) < 3.0


@pytest.mark.sample(2)
@pytest.mark.parametrize(
    ("number", "refused"), [(10, {1.6: 0.7}), pytest.param(25, {0.8: 0.2, 1.2: 0.7, 1.6: 0.9}, marks=pytest.mark.nightly)]
)
@pytest.mark.parametrize("lidar", LIDARS)
def test_scans_that_are_late_are_refused_where_the_robot_measures_its_motion_and_slow_ones_are_not(lidar, number, refused):
    """By delay, s: the least share of robots whose scans are refused."""
    times = Drives(lidar, number, seed=4).refused(20.0, [0, 0.2, *refused], measured=True)
    assert all(np.isinf(times[late]).all() for late in (0, 0.2))
    assert all(np.isfinite(times[late]).mean() > share for late, share in refused.items())


def test_a_wrong_mount_stays_refused_until_a_person_enables_the_robot():
    w = watch()
    room = 1.5 / np.maximum(np.abs(np.cos(AROUND + 0.3)), np.abs(np.sin(AROUND + 0.3)))
    x, y = room * np.cos(AROUND), room * np.sin(AROUND)
    w.track.add(AHEAD, T)
    for k in range(20):  # the points come nearer from behind
        px, py = x + 0.02 * k, y
        angle, far = np.arctan2(py, px), np.hypot(px, py)
        order = np.argsort(angle % (2 * math.pi))
        w.hear(beams(np.interp(AROUND, angle[order] % (2 * math.pi), far[order])), T + 0.1 * k)
    said = "the scans move as if the LiDAR were mounted turned by 180 degrees: correct its mount, and enable the robot again"
    assert w.trouble() == said
    for k in range(4):  # scans in which no mount fits better than another
        w.hear(beams(np.full(360, 5.0 + k)), T + 2.0 + 0.4 * k)
        assert w.trouble() == said
    w.forget()
    assert w.trouble() == ""


def test_a_scan_is_compared_by_where_the_robot_was_in_the_middle_of_its_age():
    watched, asked = watch(), []
    watched.track = SimpleNamespace(at=lambda time: asked.append(time) or Motion((0.0, 0.0, 0.0), 0.0, 0.0))
    watched.hear(beams(BOX), T + 1.0)
    assert any(time == pytest.approx(T + 0.8) for time in asked)
