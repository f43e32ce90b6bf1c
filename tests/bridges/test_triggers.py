"""When a block runs, on integer nanoseconds."""

import math

import numpy as np
import pytest

from turtlebot_gym_ros.node.block import Every, On
from turtlebot_gym_ros.node.triggers import SECOND, SLOW_AFTER, Grid, Messages, SimulatedGrid

MS = SECOND // 1000


def steps(rule, stamps):
    """Return the stamps at which a rule lets a block run."""
    return [stamp for stamp in stamps if rule.due(stamp)[0]]


def test_a_grid_is_exact_whatever_the_timer_does():
    grid = Grid(Every(0.1))
    late = np.random.default_rng(0).integers(0, 90 * MS, 100)
    stamps = [stamp for k in range(100) for stamp in grid.due_until(7 + k * 100 * MS + int(late[k]))]
    assert np.all(np.diff(stamps) == 100 * MS)
    assert {grid.interval(stamp) for stamp in stamps} == {0.1}


def test_no_step_waits_for_the_next_call_where_the_first_call_was_the_latest():
    grid = Grid(Every(0.1))
    late = [40 * MS, *np.random.default_rng(0).integers(0, 40 * MS, 100)]
    assert [len(list(grid.due_until(k * 100 * MS + int(late[k])))) for k in range(100)] == [1] * 100


def test_steps_that_are_late_are_made_up_for():
    grid = Grid(Every(0.1))
    assert list(grid.due_until(0)) == [0]
    assert list(grid.due_until(350 * MS)) == [100 * MS, 200 * MS, 300 * MS]


@pytest.mark.parametrize("leap", [5 * SECOND, -5 * SECOND])
def test_a_clock_that_leaps_makes_one_step(leap):
    grid = Grid(Every(0.1))
    assert list(grid.due_until(10 * SECOND)) == [10 * SECOND]
    assert list(grid.due_until(10 * SECOND + leap)) == [10 * SECOND + leap]


def test_simulated_time_runs_faster():
    grid = SimulatedGrid(Every(0.1, speed=10.0))
    stamps = [stamp for k in range(3) for stamp in grid.due_until(3 * SECOND + k * 10 * MS)]
    assert stamps == [SECOND, SECOND + 100 * MS, SECOND + 200 * MS]
    assert grid.present == stamps[-1]


def test_simulated_time_slows_down_where_the_machine_cannot_keep_up():
    grid = SimulatedGrid(Every(0.1, speed=10.0))
    taken = [now for now in (0, 35, 36, 40, 45, 50, 55) if list(grid.due_until(now * MS))]
    assert taken == [0, 35, 45, 55]
    assert grid.present == SECOND + 300 * MS


def test_every_message_makes_a_step_and_its_interval_is_exact():
    rule = Messages(On("odometry"))
    stamps = [5, 5 + 100 * MS, 5 + 250 * MS]
    assert steps(rule, stamps) == stamps
    assert [rule.interval(stamp) for stamp in stamps] == [0.0, 0.1, 0.15]


@pytest.mark.parametrize("rate", [10, 20, 30, 50, 100])
@pytest.mark.parametrize("jitter", [0, 2])
def test_decimation_keeps_the_rate(rate, jitter):
    rule = Messages(On("odometry", period=0.1))
    noise = np.random.default_rng(rate).integers(-jitter * MS, jitter * MS + 1, 10 * rate)
    stamps = [SECOND + k * SECOND // rate + int(noise[k]) for k in range(10 * rate)]
    taken = np.array(steps(rule, stamps))
    assert len(taken) == 100
    assert np.abs(taken - SECOND - np.arange(100) * 100 * MS).max() <= SECOND // rate / 2 + jitter * MS


def test_what_comes_twice_or_late_is_refused():
    rule = Messages(On("odometry"))
    for stamp in (SECOND, SECOND + 100 * MS):
        rule.check(stamp)
        assert rule.due(stamp) == (True, None)
    for stamp in (SECOND + 100 * MS, SECOND + 50 * MS, SECOND):
        with pytest.raises(ValueError, match="stamp"):
            rule.check(stamp)


@pytest.mark.parametrize("gap", [1500 * MS, -1500 * MS])
def test_after_a_gap_in_time_it_starts_again(gap):
    rule = Messages(On("odometry", period=0.1, max_gap=1.0))
    start = 10 * SECOND
    for k in range(3):
        assert rule.due(start + k * 100 * MS)[0]
        rule.interval(start + k * 100 * MS)
    stamp = start + 200 * MS + gap
    rule.check(stamp)
    due, why = rule.due(stamp)
    assert due
    assert why is not None
    assert rule.interval(stamp) == 0.0


def test_messages_that_are_too_slow_for_the_period_are_told_from_drop_outs():
    rule = Messages(On("estimate", period=0.1))
    for k in range(20):  # every second one is lost, now and then
        if k % 4:
            rule.due(k * 100 * MS)
    assert rule.slow is None
    for k in range(SLOW_AFTER + 1):
        rule.due(3 * SECOND + k * 200 * MS)
    assert rule.slow == "estimate comes every 0.200 s, but a step is due every 0.1 s"
    for k in range(2):
        rule.due(5 * SECOND + k * 100 * MS)
    assert rule.slow is None


@pytest.mark.parametrize(("period", "speed"), [(0.0, None), (-0.1, None), (math.nan, None), (0.1, -1.0), (0.1, math.inf)])
def test_a_period_is_positive(period, speed):
    with pytest.raises(ValueError, match="positive"):
        Every(period, speed)
