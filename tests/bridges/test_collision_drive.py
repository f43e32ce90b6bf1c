"""The guard's collision monitor in simulated rooms: whoever drives pushes on, and the true clearance is the judge.

The guard's own parts are called as its node calls them, at 50 Hz. The robots and their LiDARs are the rooms' own: an LDS-01
with its noise, its error and its turning beams, wheels that obey 0.08 s late, and scans that arrive 0.04 s after their last
beam.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from burger import Parameters

from cmd_vel_guard.arbiter import Arbiter
from cmd_vel_guard.collision import RawScan
from turtlebot_gym.compiled.batch import Batch
from turtlebot_gym.rewards import IN_ROOMS, default_weights
from turtlebot_gym.robots import ROBOTS
from turtlebot_gym.rooms.lidar import LIDARS
from turtlebot_gym.rooms.rules import ROOMS
from turtlebot_gym.systems import make_parameters, make_room
from turtlebot_gym.tasks import ROOM
from turtlebot_gym.values import Command, Pose

DT = 0.02
T = 100.0
BURGER = ROBOTS["burger"]


class Drive:
    """Robots in rooms of their own, each behind a guard of its own."""

    def __init__(self, number, worlds, *, seed=0, x=-0.032, range_min=0.12, **parameters):
        lidar, self.rng = replace(LIDARS["lds01"], x=x, range_min=range_min), np.random.default_rng(seed)
        base = make_parameters(ROOM, robot="burger", integrator="midpoint", dt=DT, delay=3)
        rules = [ROOMS[worlds[k % len(worlds)]] for k in range(number)]
        self.batch = Batch(
            number,
            [base._replace(reward=default_weights(IN_ROOMS), room=make_room(reward, lidar, DT)) for reward in rules],
            (Pose(0.0, 0.0, 0.0),),
        )
        self.batch.seeds[:] = 1000 * seed + np.arange(number)
        self.batch.reset(np.ones(number, np.bool_), *self.batch.empty())
        options = {"collision_monitor": True, "scan_mount": "given", "scan_x": x, **parameters}
        self.center_x = options.get("footprint_x", 0.0)
        self.guards = [Arbiter(Parameters(**options), T) for _ in range(number)]
        self.range_min = range_min
        self.number, self.tick, self.told = number, 0, np.zeros((number, 2))
        self.asked = np.zeros((number, 2))
        self.turn_at, self.hunts = np.zeros(number, np.int64), np.zeros(number, np.bool_)
        self.least = self.clearance()
        self.cut_at = np.full(number, 10**9)
        self.told_at, self.moved_at = np.zeros(number, np.int64), np.zeros(number, np.int64)
        self.path, self.turned = np.zeros(number), np.zeros(number)

    def pose(self):
        return self.batch.numbers("body.true_state")[:, :3].T

    def clearance(self):
        """Distance between footprints and what is nearest, by numpy: an oracle of its own."""
        scenes, (x, y, theta) = self.batch.scenes, self.pose()
        x, y = x + self.center_x * np.cos(theta), y + self.center_x * np.sin(theta)
        walls, circles, boxes, counts = scenes.room.walls, scenes.room.circles, scenes.room.boxes, scenes.room.counts
        near = np.minimum(walls[:, 2] - abs(x - walls[:, 0]), walls[:, 3] - abs(y - walls[:, 1]))
        is_there = np.arange(circles.shape[1]) < counts[:, :1]
        gaps = np.hypot(circles[..., 0] - x[:, None], circles[..., 1] - y[:, None]) - circles[..., 2]
        near = np.minimum(near, np.where(is_there, gaps, np.inf).min(axis=1))
        is_there = np.arange(boxes.shape[1]) < counts[:, 1:]
        dx, dy, cosine, sine = boxes[..., 0] - x[:, None], boxes[..., 1] - y[:, None], boxes[..., 4], boxes[..., 5]
        out_x, out_y = abs(dx * cosine + dy * sine) - boxes[..., 2], abs(dy * cosine - dx * sine) - boxes[..., 3]
        gaps = np.hypot(np.maximum(out_x, 0.0), np.maximum(out_y, 0.0)) + np.minimum(np.maximum(out_x, out_y), 0.0)
        return np.minimum(near, np.where(is_there, gaps, np.inf).min(axis=1)) - BURGER.radius

    def ask(self):
        """Ask for full speed: towards what is nearest, ahead or backwards, or anywhere, or turn on the spot."""
        (due,) = np.nonzero(self.turn_at <= self.tick)
        rng, n = self.rng, len(due)
        v = rng.choice([0.22, 0.22, 0.22, -0.22, 0.0], n)
        omega = rng.choice([0.0, 0.3, 1.0, 2.8], n) * rng.uniform(-1.0, 1.0, n)
        self.asked[due] = np.stack((v, omega), axis=1)
        self.turn_at[due] = self.tick + rng.integers(25, 150, n)
        self.hunts[due] = rng.random(n) < 0.6
        towards = np.argmin(self.newest, axis=1) * (2.0 * np.pi / 360)
        back = np.cos(towards) < 0.0
        turn = np.arctan2(np.sin(towards), np.cos(towards)) - np.where(back, np.copysign(np.pi, np.sin(towards)), 0.0)
        hunt = np.stack((np.where(back, -0.22, 0.22), np.clip(3.0 * turn, -1.0, 1.0)), axis=1)
        self.asked[self.hunts] = hunt[self.hunts]

    def run(self, seconds):
        for _ in range(round(seconds / DT)):
            now = T + self.tick * DT
            if self.tick % 10 == 0:
                self.newest = newest = self.batch.scenes.lidar.ranges[:, 1].copy()
            self.ask()
            for k, guard in enumerate(self.guards):
                if self.tick % 10 == 2 and self.tick - 2 <= self.cut_at[k]:
                    guard.hear_scan(
                        RawScan(newest[k], 0.0, 2.0 * np.pi / 360, self.range_min, 3.5, "base_scan"), now, sent=now - 2 * DT
                    )
                if self.tick % 5 == k % 5:
                    guard.hear("teleop", Command(*self.asked[k]), now)
                command = guard.step(now)
                if command is not None:
                    self.told[k] = command
            actions = self.told / (BURGER.max_linear, BURGER.max_angular)
            self.batch.step(actions.astype(np.float32))
            self.tick += 1
            twist = abs(self.batch.numbers("body.true_state")[:, 3:])
            self.path += twist[:, 0] * DT
            self.turned += twist[:, 1] * DT
            self.told_at[(self.told != 0.0).any(axis=1)] = self.tick
            self.moved_at[(twist > 0.0).any(axis=1)] = self.tick
            self.least = np.minimum(self.least, self.clearance())
        return self


WORLDS = ["dense", "clutter", "corridor", "office"]


@pytest.fixture(scope="module", params=[100, pytest.param(1000, marks=pytest.mark.nightly)])
def driven(request):
    """100 or 1,000 robots after 4 s of pushing on."""
    return Drive(request.param, WORLDS, seed=1).run(4.0)


def test_robots_driven_at_full_speed_touch_nothing(driven):
    assert driven.least.min() > 0.02  # of a margin of 0.05 m; and they came near, and drove, and turned
    assert (driven.least < 0.12).sum() > 0.3 * driven.number
    assert driven.path.mean() > 0.3
    assert driven.turned.mean() > 1.0
    np.testing.assert_allclose(driven.batch.numbers("room.least"), driven.least, atol=1e-12)  # the room's own judge agrees


def test_without_the_monitor_many_of_them_do():
    assert (Drive(100, WORLDS, seed=1, collision_monitor=False).run(4.0).least < 0.0).sum() > 30


def test_a_scan_that_is_cut_stops_every_robot_within_600_ms(driven):
    """Cut at a random moment; of the wheels' own delay, 0.08 s, nothing is left out."""
    start = driven.tick
    driven.cut_at = start + np.random.default_rng(2).integers(0, 50, driven.number)
    driven.run(1.0 + 0.7)
    assert (driven.told_at - driven.cut_at).max() * DT <= 0.5
    assert (driven.moved_at - driven.cut_at).max() * DT <= 0.6
    assert (driven.moved_at > driven.cut_at + 0.15 / DT).sum() > 0.15 * driven.number  # they did not stand before
    assert driven.least.min() > 0.02


@pytest.mark.nightly
@pytest.mark.parametrize("footprint_x", [-0.032, -0.1])
def test_a_footprint_behind_the_axle_touches_nothing_by_turning(footprint_x):
    drive = Drive(100, ["dense", "corridor"], seed=3, footprint_x=footprint_x, x=footprint_x)
    is_there = drive.least > 0.02  # rooms are drawn for a footprint around the axle
    drive.run(4.0)
    assert drive.least[is_there].min() > 0.0
    assert drive.turned[is_there].mean() > 0.5


@pytest.mark.nightly
def test_a_monitor_that_takes_old_scans_for_new_ones_is_noticed():
    """The partner: with no account of the robot's motion since the scan, and no margin, robots touch something."""
    careless = {"collision_margin": 0.0, "collision_time": 0.5, "reaction": 0.0, "scan_period": 0.0, "scan_error": 0.0}
    drive = Drive(100, WORLDS, seed=1, range_min=0.01, **careless)
    assert drive.run(4.0).least.min() < 0.0


@pytest.mark.nightly
@pytest.mark.parametrize("world", ["cellular", "crowd"])
def test_narrow_gaps_and_people_who_wait_are_not_touched_either(world):
    """Between cylinders of a cellular automaton, and among those who walk, and wait where a robot is in their way."""
    driven = Drive(100, [world], seed=3).run(4.0)
    least = driven.batch.numbers("room.least")
    assert least.min() > 0.02
    assert (least < 0.12).mean() > 0.2  # they came near, and drove
    assert driven.path.mean() > 0.2
    assert (Drive(100, [world], seed=3, collision_monitor=False).run(4.0).batch.numbers("room.least") < 0.0).mean() > 0.25


@pytest.mark.sample(4)
@pytest.mark.parametrize("beams", [1, 2, 4, 6, 8, 10])
@pytest.mark.parametrize("off", [0.25, 0.5])
def test_what_hides_between_beams_that_are_wider_apart_than_the_robot_is_not_hit(beams, off):
    """Whatever stands on the line of travel, between two beams, which all look far: unknown ground is entered for 5 cm."""
    arbiter = Arbiter(Parameters(collision_monitor=True), 100.0)
    arbiter.monitor.watch.trouble = lambda: ""  # its few returns are the same
    x, v, spacing = 0.0, 0.0, 2.0 * math.pi / beams
    for k in range(round(20.0 / 0.02)):
        now = 100.0 + 0.02 * k
        if k % 5 == 0:
            arbiter.hear("teleop", Command(0.2, 0.0), now)
            arbiter.hear_scan(RawScan([3.0] * beams, off * spacing, spacing, 0.12, 3.5, "base_scan"), now)
        command = arbiter.step(now)
        v = v if command is None else command.v
        x += 0.02 * v
    assert x <= 0.0501 + 0.01
