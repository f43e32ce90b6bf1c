"""A LiDAR that is frozen, covered or mounted otherwise is refused with the reason; one at work is not."""

import math

import numpy as np
import pytest

from turtlebot_gym.beams import Beams
from turtlebot_gym.compiled.batch import Batch
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


def reasons(command, scans, *, watch=None):
    """Return what is said at each of some scans, while a command is in force."""
    watch, said = watch or ScanWatch(lag=0.4, returns=0.02, narrow=0.56, now=T), []
    watch.track.add(command, T)
    for k, ranges in enumerate(scans):
        try:
            watch.hear(beams(ranges), T + DT * k)
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


KINDS = ["dense", "clutter", "corridor", "office", "crowd"]
DRIVEN = [name if name == "lds01" else pytest.param(name, marks=pytest.mark.slow) for name in LIDARS]


def refused(lidar, number, seconds, faults, *, seed, measured=False):
    """Let robots wander, each in a room of its own; return when the scans of each are refused, s, by fault, infinite for never.

    A fault is by how many quarters of a turn the mount is wrong, "mirrored", "still" (the scans of a robot that stands), or as
    a float the delay of scans, s.
    """
    lidar, rng, noise = LIDARS[lidar], np.random.default_rng(seed), np.random.default_rng(9)
    base = make_parameters(ROOM, robot="burger", integrator="midpoint", dt=DT, delay=1, noise="clean")
    base = base._replace(reward=default_weights(IN_ROOMS))
    rooms = [base._replace(room=make_room(ROOMS[KINDS[k % 5]], lidar, DT)) for k in range(number)]
    batch = Batch(number, rooms, (Pose(0.0, 0.0, 0.0),))
    batch.seeds[:] = 1000 * seed + np.arange(number)
    batch.reset(np.ones(number, np.bool_), *batch.empty())
    angles = lidar.yaw + 2.0 * math.pi / lidar.beams * np.arange(lidar.beams)
    watches = {fault: [watch() for _ in range(number)] for fault in faults}
    times = {fault: np.full(number, math.inf) for fault in faults}
    history, commands, until = [], np.zeros((number, 2)), np.zeros(number, int)

    def seen(fault, k, scan):
        """Return ranges and directions as a fault makes them."""
        if isinstance(fault, int):
            return scan, angles + 0.5 * math.pi * fault
        if fault == "mirrored":
            return scan, -angles
        then = history[0 if fault == "still" else max(0, len(history) - 1 - round(fault / DT))][k]
        return then + noise.normal(0.0, 0.005, len(angles)) * (then > 0.0), angles

    for tick in range(round(seconds / DT)):
        due, now, scans = until <= tick, T + tick * DT, batch.scenes.lidar.ranges[:, 1].copy()
        turns = rng.choice([0.0, 0.0, 0.3, 1.0, 2.0], due.sum()) * rng.uniform(-1.0, 1.0, due.sum())
        commands[due] = np.stack((rng.choice([0.2, 0.2, 0.2, 0.1, -0.2, 0.0], due.sum()), turns), 1)
        until[due] = tick + rng.integers(5, 40, due.sum())
        history.append(scans)
        blocked = (scans[:, np.abs(np.angle(np.exp(1j * angles))) < 0.5].min(axis=1) < 0.35) & (commands[:, 0] > 0.0)
        commands[blocked], until[blocked] = (0.0, 1.5), np.maximum(until[blocked], tick + 3)
        touched, twists = batch.numbers("room.least").reshape(number) < 0.0, batch.numbers("body.true_state")
        for fault, robots in watches.items():
            for k in np.flatnonzero(~touched & np.isinf(times[fault])):
                if tick % max(1, round(1.0 / (lidar.rate * DT))) == 0:
                    robots[k].hear(beams(*seen(fault, k, scans[k])), now, range_max=lidar.range_max)
                    times[fault][k] = now - T if robots[k].trouble() else math.inf
                robots[k].track.add(Command(*commands[k]), now)
                if measured:
                    robots[k].move(Command(*twists[k, 3:].tolist()), now)
        batch.step((commands / (BURGER.max_linear, BURGER.max_angular)).astype(np.float32))
    return times


@pytest.mark.parametrize("lidar", DRIVEN)
def test_a_mount_that_contradicts_the_motion_is_refused_and_a_right_one_is_not(lidar):
    times = refused(lidar, 10, 20.0, [*range(4), "mirrored", "still"], seed=3)
    alone = np.arange(10) % 5 != 4  # somebody who walks beside the robot looks like a part that stands still
    assert np.isinf(times[0][alone]).all()
    for fault, share, seconds in (("mirrored", 0.7, 5.0), ("still", 0.7, 5.0), (1, 0.8, 3.0), (2, 0.8, 3.0), (3, 0.8, 3.0)):
        caught = np.isfinite(times[fault])
        assert caught.mean() > share  # the others touched something before, or stood
        assert np.median(times[fault][caught]) < seconds


@pytest.mark.parametrize("lidar", DRIVEN)
def test_scans_that_are_late_are_refused_where_the_robot_measures_its_motion_and_slow_ones_are_not(lidar):
    times = refused(lidar, 10, 20.0, [0, 0.2, 1.6], seed=4, measured=True)
    assert all(np.isinf(times[late]).all() for late in (0, 0.2))
    assert np.isfinite(times[1.6]).mean() > 0.7


def test_a_wrong_mount_stays_refused_until_a_person_enables_the_robot():
    w = watch()
    room = 1.5 / np.maximum(np.abs(np.cos(AROUND + 0.3)), np.abs(np.sin(AROUND + 0.3)))
    w.track.add(AHEAD, T)
    for k in range(20):  # the points come nearer from behind
        points = room * np.exp(1j * AROUND) + 0.02 * k
        w.hear(beams(np.interp(AROUND, np.angle(points) % (2.0 * math.pi), np.abs(points), period=2.0 * math.pi)), T + 0.1 * k)
    said = "the scans move as if the LiDAR were mounted turned by 180 degrees: correct its mount, and enable the robot again"
    assert w.trouble() == said
    for k in range(4):  # scans in which no mount fits better than another
        w.hear(beams(np.full(360, 5.0 + k)), T + 2.0 + 0.4 * k)
        assert w.trouble() == said
    w.forget()
    assert w.trouble() == ""
