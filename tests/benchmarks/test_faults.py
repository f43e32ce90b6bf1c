"""The judge of the injected faults fails closed, the stand-in for a driver moves as physics says, and its lies can be seen."""

import math
import random
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs the extra [ros]")

from faults import Tally, kinds_of
from faults_chain import settings
from faults_driver import Driver, Said, Seen, honest
from faults_kinds import BUTTONS, FAULTS, GROUPS
from faults_lies import FROM_THE_START, FROM_THEN_ON, TURNING, reset_at
from faults_record import AGE, OVERDUE, Record
from faults_silence import WIDTHS, silent
from faults_world import ANGLES, CENTER_X, HALL, LIDAR_X, RADIUS, ROUGHNESS, World, advance

SUSPENDED, CONTINUED, END = 10.0, 12.0, 14.0


def judge(*heard):
    """Return a judge that has heard commands, each with its source time, its arrival, and v."""
    record = Record()
    record.measured = [(SUSPENDED, SUSPENDED)]
    for sent, arrived, v in heard:
        record.hear(sent, arrived, v, 0.0)
    return record


STANDBY = (SUSPENDED + 0.2, SUSPENDED + 0.2, 0.0)
BEGUN = (SUSPENDED + 0.01, CONTINUED, 0.1)


@pytest.mark.parametrize(("pause", "lasts"), [(0.001, 0.001), (0.3, 0.3), (None, END - CONTINUED)])
def test_a_motion_that_comes_out_after_a_suspension_is_in_force_until_the_next_zero(pause, lasts):
    after = [] if pause is None else [(CONTINUED + pause, CONTINUED + pause, 0.0)]
    record = judge(STANDBY, BEGUN, *after)
    assert record.lag(0.0) == pytest.approx(0.01)  # by its source time it is early, and looks safe
    assert record.overdue(0.0, END) == pytest.approx(lasts)
    assert bool(record.reasons(0.0, END)) == (lasts > OVERDUE)


def test_a_zero_that_is_missing_is_motion_until_the_end_of_the_watch():
    record = judge((SUSPENDED, SUSPENDED, 0.1))
    assert record.lag(0.0) == 0.0  # nothing was published late
    assert record.overdue(0.0, END) == pytest.approx(END - SUSPENDED - AGE)
    assert record.reasons(0.0, END) == ["motion was in force for 3.40 s without a fresh measurement"]
    record.began = SUSPENDED + 1.0
    assert record.stop(END) == math.inf


def test_what_is_measured_meanwhile_makes_a_motion_fresh():
    record = judge((SUSPENDED, SUSPENDED, 0.1))
    record.measured += [(SUSPENDED + 0.5, SUSPENDED + 0.4), (SUSPENDED + 2.0, SUSPENDED + 1.9)]
    late = (SUSPENDED + 2.0) - (SUSPENDED + 0.4 + AGE) + END - (SUSPENDED + 1.9 + AGE)
    assert record.overdue(0.0, END) == pytest.approx(late)


def test_the_standby_ends_the_motion_that_a_suspended_guard_had_sent_before():
    moved = (SUSPENDED, SUSPENDED, 0.1)
    record = judge(moved, STANDBY, BEGUN, (CONTINUED, CONTINUED, 0.0))
    assert record.hold(0.0, END) == pytest.approx(CONTINUED - SUSPENDED)
    assert judge(moved, STANDBY).hold(0.0, END) == pytest.approx(0.2)


@pytest.mark.parametrize(("heard", "stop"), [((), math.inf), ((STANDBY,), 0.2), ((BEGUN, STANDBY), 0.2)])
def test_a_robot_moves_until_the_next_zero_and_one_that_stood_did_not(heard, stop):
    moved = (SUSPENDED - 0.1, SUSPENDED - 0.1, 0.1)
    record, stood = judge(moved, *heard), judge((*moved[:2], 0.0), *heard)
    record.began = stood.began = SUSPENDED
    assert record.stop(END) == pytest.approx(stop)
    assert stood.stop(END) == 0.0


@pytest.mark.parametrize(("lasts", "v", "reasons"), [(0.9, 0.2, 0), (1.2, 0.1, 1), (0.9, 0.3, 1), (1.5, 0.2, 2)])
def test_a_liar_may_move_a_quarter_of_a_metre_and_a_second_after_the_lie_could_be_seen(lasts, v, reasons):
    record = judge((9.0, 9.0, v), (SUSPENDED + lasts, SUSPENDED + lasts, 0.0))
    assert record.travelled(SUSPENDED, END) == pytest.approx((v * lasts, lasts))
    assert len(record.strays(SUSPENDED, END)) == reasons


def test_a_judge_that_did_not_look_says_so_and_without_trust_in_a_clock_goes_by_arrivals():
    record = judge()
    record.looks = [10.0, 10.1, 11.5, 11.6]
    assert record.unseen(9.9, 11.7) == pytest.approx(1.4)
    record.trusts_source = False
    record.hear(SUSPENDED - 3600.0, SUSPENDED + 1.0, 0.1, 0.0)
    assert record.lag(0.0) == pytest.approx(1.0)


def test_a_robot_obeys_each_command_from_its_arrival_on_however_late_the_judge_looks():
    record = judge((1.0, 1.0, 0.1), (2.0, 2.0, 0.0), (2.5, 2.5, 0.2))
    assert record.obeyed(0.5, 0.9) == [(0.0, 0.0, pytest.approx(0.4))]
    assert record.obeyed(1.5, 3.0) == [(v, 0.0, pytest.approx(lasts)) for v, lasts in ((0.1, 0.5), (0.0, 0.5), (0.2, 0.5))]


# The stand-in


def test_its_arcs_are_those_of_small_steps():
    pose = whole = (0.3, -0.2, 0.7)
    for _ in range(10_000):
        x, y, theta = pose
        pose = x + 1e-4 * 0.2 * math.cos(theta), y + 1e-4 * 0.2 * math.sin(theta), theta + 1e-4 * 1.5
    assert advance(whole, 0.2, 1.5, 1.0) == pytest.approx(pose, abs=1e-4)


def test_its_lidar_sees_walls_and_posts_where_they_are():
    world = World()
    world.pose, world.posts = (0.4, 0.3, 0.0), [(1.4, 0.3, 0.1)]
    ranges = world.ranges()
    at = 0.4 + LIDAR_X
    expected = {0: 1.4 - at - 0.1, 45: HALL[1] - 0.3, 90: HALL[2] + at, 135: HALL[1] + 0.3}
    assert {k: ranges[k] for k in expected} == pytest.approx(expected, abs=6.0 * ROUGHNESS)
    assert np.isinf(World().ranges()).sum() == 0
    assert world.clearance() == pytest.approx(1.4 - (0.4 + CENTER_X) - 0.1 - RADIUS)


@pytest.mark.parametrize("center", [0.0, 0.5 * math.pi, -0.5 * math.pi])
def test_a_silent_sector_is_around_its_direction_and_the_rest_of_the_scan_is_true(center):
    ranges = World().ranges()
    for seed in range(20):
        said = np.array(silent(center, random.Random(seed))(SimpleNamespace(ranges=list(ranges))).ranges)
        away = np.abs(np.remainder(ANGLES - center + math.pi, 2.0 * math.pi) - math.pi)
        covered = said != ranges
        assert len({*said[covered]}) == 1
        assert said[covered][0] in (0.0, math.inf)
        assert away[covered].max() < away[~covered].min()
        assert WIDTHS[0] - 2.0 * ANGLES[1] <= 2.0 * away[covered].max() <= WIDTHS[1]


def drive(make, *, turning, seconds=4.0, seed=0, begin=0):
    """Let a driver lie from a message on, and return when that could be seen, s."""
    driver = Driver(World(), start=(0.4, -0.3, 0.3))
    for k in range(int(seconds / 0.05)):
        if k == begin:
            driver.lie = make(random.Random(seed)) if make else honest
        driver.says(0.05 * k)
        driver.move(0.15, (0.8 if k > 20 else 0.0) if turning else 0.0, 0.05)
    return driver.seen.at


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("name", [*FROM_THEN_ON, *FROM_THE_START])
def test_each_lie_can_be_seen_and_the_truth_cannot(name, seed):
    make = {**FROM_THEN_ON, **FROM_THE_START}[name]
    assert drive(make, turning=name in TURNING, seed=seed, begin=10 if name in FROM_THEN_ON else 0) is not None
    assert drive(None, turning=name in TURNING) is None


@pytest.mark.parametrize("distance", [0.1, 0.2, 0.35, 0.5])
def test_a_reset_is_seen_when_it_happens(distance):
    assert drive(reset_at(distance), turning=False) == pytest.approx(0.05 * math.ceil(distance / 0.15 / 0.05 + 1e-6), abs=0.051)


def test_wheels_that_do_not_obey_are_seen_by_what_they_say():
    driver = Driver(World())
    driver.turns = lambda v, omega: (v, -omega)
    driver.move(0.1, 0.5, 0.1)
    said = driver.says(0.1)
    assert (said.omega, driver.world.pose[2]) == pytest.approx((-0.5, -0.05))
    assert driver.seen.at == 0.1


def test_a_difference_below_what_can_be_seen_is_none():
    seen = Seen()
    for k in range(20):
        obedient = Said(0.01 * k, 0.0, 0.0, 0.2, 0.0)
        seen.compare(obedient._replace(x=0.0098 * k, v=0.19), obedient, 0.05 * k)
    assert seen.at is None


# The kinds


def test_the_kinds_are_many_and_each_is_in_one_group():
    assert len(FAULTS) == sum(map(len, GROUPS.values())) >= 65
    assert kinds_of(("buttons",)) == list(BUTTONS)
    assert set(kinds_of(("LiDAR", "scans end"))) >= {"LiDAR covered", "scans end"}


def test_the_guard_whose_faults_are_counted_has_its_collision_monitor_on():
    assert settings()["cmd_vel_guard"]["collision_monitor"] == "true"


def test_an_interrupted_run_goes_on_and_counts_what_was_unsafe(tmp_path):
    row = {"kind": "short press", "number": 0, "unsafe": ["it moved"], "nearest": 1.0}
    row |= dict.fromkeys(("longest_lag", "longest_hold", "longest_overdue", "longest_stop"), 0.1)
    tally = Tally(["short press"], tmp_path / "kept.jsonl")
    tally.take(row)
    again = Tally(["short press"], tmp_path / "kept.jsonl")
    assert again.counts == tally.counts
    assert again.done == {("short press", 0)}
    assert again.counts["short press"]["reasons"] == {"it moved": 1}
