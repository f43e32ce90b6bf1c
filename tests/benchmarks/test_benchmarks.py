"""Every benchmark can be imported; the judge of the injected faults fails closed, and its driver's lies can be seen."""

import math
import random
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs the extra [ros]")
pytest.importorskip("stable_baselines3", reason="needs the extra [agents]")

from faults import CHAIN, FAULTS, GROUPS, counts_of, kinds_of
from faults_lies import FROM_THE_START, FROM_THEN_ON, TURNING
from faults_record import AGE, OVERDUE, Record
from faults_walls import WIDTHS, silent
from faults_world import ANGLES, CENTER_X, HALL, LIDAR_X, RADIUS, ROUGHNESS, Driver, World, advance, away

SCRIPTS = sorted(path.stem for path in (Path(__file__).parents[2] / "benchmarks").glob("*.py"))
SUSPENDED, CONTINUED, END = 10.0, 12.0, 14.0


@pytest.mark.parametrize("name", SCRIPTS)
def test_a_benchmark_can_be_imported(name):
    import_module(name)


def judge(*heard):
    """Return a judge that has heard commands, each with its source time, its arrival, and v."""
    record = Record()
    record.measured = [(SUSPENDED, SUSPENDED)]
    for sent, arrived, v in heard:
        record.hear(sent, arrived, v, 0.0)
    return record


@pytest.mark.parametrize(("pause", "lasts"), [(0.001, 0.001), (0.3, 0.3), (None, END - CONTINUED)])
def test_a_motion_that_comes_out_after_a_suspension_is_in_force_until_the_next_zero(pause, lasts):
    after = [] if pause is None else [(CONTINUED + pause, CONTINUED + pause, 0.0)]
    record = judge((SUSPENDED + 0.2, SUSPENDED + 0.2, 0.0), (SUSPENDED + 0.01, CONTINUED, 0.1), *after)
    assert record.lag(0.0) == pytest.approx(0.01)  # by its source time it is early, and looks safe
    assert record.overdue(0.0, END) == pytest.approx(lasts)
    assert bool(record.reasons(0.0, END)) == (lasts > OVERDUE)


def test_a_zero_that_is_missing_is_motion_until_the_end_and_what_is_measured_meanwhile_makes_it_fresh():
    record = judge((SUSPENDED, SUSPENDED, 0.1))
    assert record.lag(0.0) == 0.0  # nothing was published late
    assert record.reasons(0.0, END) == ["motion was in force for 3.40 s without a fresh measurement"]
    record.measured += [(SUSPENDED + 0.5, SUSPENDED + 0.4), (SUSPENDED + 2.0, SUSPENDED + 1.9)]
    late = (SUSPENDED + 2.0) - (SUSPENDED + 0.4 + AGE) + END - (SUSPENDED + 1.9 + AGE)
    assert record.overdue(0.0, END) == pytest.approx(late)


@pytest.mark.parametrize(("lasts", "v", "reasons"), [(0.9, 0.2, 0), (1.2, 0.1, 1), (0.9, 0.3, 1), (1.5, 0.2, 2)])
def test_a_liar_may_move_a_quarter_of_a_metre_and_a_second_after_the_lie_could_be_seen(lasts, v, reasons):
    record = judge((9.0, 9.0, v), (SUSPENDED + lasts, SUSPENDED + lasts, 0.0))
    assert len(record.strays(SUSPENDED, END)) == reasons


def test_a_judge_that_did_not_look_says_so_and_without_trust_in_a_clock_goes_by_arrivals():
    record = judge()
    record.looks = [10.0, 10.1, 11.5, 11.6]
    assert record.unseen(9.9, 11.7) == pytest.approx(1.4)
    record.trusts_source = False
    record.hear(SUSPENDED - 3600.0, SUSPENDED + 1.0, 0.1, 0.0)
    assert record.lag(0.0) == pytest.approx(1.0)


def test_its_arcs_are_those_of_small_steps_and_its_lidar_sees_walls_and_posts_where_they_are():
    pose = whole = (0.3, -0.2, 0.7)
    for _ in range(10_000):
        pose = advance(pose, 0.2, 0.0, 1e-4)
        pose = advance(pose, 0.0, 1.5, 1e-4)
    assert advance(whole, 0.2, 1.5, 1.0) == pytest.approx(pose, abs=1e-4)
    world = World()
    world.pose, world.posts = (0.4, 0.3, 0.0), [(1.4, 0.3, 0.1)]
    ranges, at = world.ranges(), 0.4 + LIDAR_X
    expected = {0: 1.4 - at - 0.1, 45: HALL[1] - 0.3, 90: HALL[2] + at, 135: HALL[1] + 0.3}
    assert {k: ranges[k] for k in expected} == pytest.approx(expected, abs=6.0 * ROUGHNESS)
    assert world.clearance() == pytest.approx(1.4 - (0.4 + CENTER_X) - 0.1 - RADIUS)


@pytest.mark.parametrize("center", [0.0, 0.5 * math.pi])
def test_a_silent_sector_is_around_its_direction_and_the_rest_of_the_scan_is_true(center):
    ranges = World().ranges()
    for seed in range(20):
        said = np.array(silent(random.Random(seed), center)([SimpleNamespace(ranges=list(ranges))]).ranges)
        covered = said != ranges
        assert {*said[covered]} in ({0.0}, {math.inf})
        assert away(ANGLES, center)[covered].max() < away(ANGLES, center)[~covered].min()
        assert WIDTHS[0] - 2.0 * ANGLES[1] <= 2.0 * away(ANGLES, center)[covered].max() <= WIDTHS[1]


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("name", [None, *FROM_THEN_ON, *FROM_THE_START])
def test_each_lie_can_be_seen_and_the_truth_cannot(name, seed):
    driver, begins = Driver(World(), start=(0.4, -0.3, 0.3)), 10 if name in FROM_THEN_ON else 0
    for k in range(80):
        if name and k == begins:
            driver.tells({**FROM_THEN_ON, **FROM_THE_START}[name](random.Random(seed)))
        driver.says(0.05 * k)
        driver.move(0.15, (0.8 if k > 20 else 0.0) if name is None or name in TURNING else 0.0, 0.05)
    assert (driver.seen_at is not None) == (name is not None)


def test_there_are_127_kinds_the_collision_monitor_is_on_and_what_is_unsafe_is_counted():
    assert len(FAULTS) == sum(map(len, GROUPS.values())) == 127
    assert kinds_of(("buttons",)) == list(GROUPS["buttons"])
    assert CHAIN["cmd_vel_guard"]["collision_monitor"] == "true"
    rows = [{"kind": "short press", "unsafe": unsafe} for unsafe in ([], ["it moved"], ["it moved"])]
    assert counts_of(rows) == {"short press": {"injected": 3, "unsafe": 2, "reasons": {"it moved": 2}}}
