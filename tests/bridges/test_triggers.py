"""When a block runs, on integer nanoseconds."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from turtlebot_gym_ros.node.block import Every, On
from turtlebot_gym_ros.node.triggers import SECOND, Messages, StampGrid

MS = SECOND // 1000


def steps(rule, stamps):
    """Return the stamps at which a rule lets a block run."""
    return [stamp for stamp in stamps if rule.due(stamp)[0]]


def test_a_grid_is_exact_whatever_the_timer_does():
    grid = StampGrid(Every(0.1))
    late = np.random.default_rng(0).integers(0, 90 * MS, 100)
    stamps = [stamp for k in range(100) for stamp in grid.due_until(7 + k * 100 * MS + int(late[k]))]
    assert np.all(np.diff(stamps) == 100 * MS)


GRIDS = {
    "steps that are late are made up for": (StampGrid, Every(0.1), {0: [0], 350 * MS: [100 * MS, 200 * MS, 300 * MS]}),
    "due from 3/4 of a period before the stamp, another from 1/4": (
        StampGrid,
        Every(0.1),
        {0: [0], 25 * MS: [], 25 * MS + 1: [100 * MS], 275 * MS: [200 * MS], 375 * MS + 1: [300 * MS, 400 * MS]},
    ),
    # The next step is due 0.1 s later: a second ahead of that, or two periods back, is a leap; these are a nanosecond less.
    "less than a second ahead is no leap, nor are two periods back": (
        StampGrid,
        Every(0.1),
        {10 * SECOND: [10 * SECOND], 9900 * MS + 1: [], 11100 * MS - 1: [10 * SECOND + k * 100 * MS for k in range(1, 12)]},
    ),
    **{
        f"a leap by {leap} ms makes one step": (
            StampGrid,
            Every(0.1),
            {at: [at] for at in (10 * SECOND, 10 * SECOND + leap * MS)},
        )
        for leap in (5000, 1100, -100, -900, -5000)
    },
}


@pytest.mark.parametrize(("kind", "trigger", "due"), GRIDS.values(), ids=GRIDS)
def test_a_grid_lets_a_block_run_at_these_stamps(kind, trigger, due):
    grid = kind(trigger)
    assert {now: list(grid.due_until(now)) for now in due} == due


@given(first=st.integers(0, 19_999_999), late=st.lists(st.integers(0, 4_999_999), min_size=60, max_size=60))
@example(first=10_000_000, late=[0, 1] * 30)
@example(first=15_000_000, late=[0, 1] * 30)
def test_calls_at_regular_times_make_one_step_each_wherever_in_its_period_the_first_call_was(first, late):
    grid = StampGrid(Every(0.02))
    list(grid.due_until(first))
    counts = [len(list(grid.due_until(k * 20_000_000 + delay))) for k, delay in enumerate(late, 1)]
    assert counts in [[1] * k + [0] * (k < 60) + [1] * (59 - k) for k in range(61)]


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
    for stamp in (10_000_000_000, 10_100_000_000):
        rule.check(stamp)
        assert rule.due(stamp) == (True, None)
    for stamp, before in ((10_100_000_000, "0.000"), (10_050_000_000, "0.050"), (9_100_000_000, "1.000")):
        with pytest.raises(ValueError, match=f"its stamp is {before} s before the last one's, or the same"):
            rule.check(stamp)
    rule.check(10_100_000_001)
    rule.check(9_099_999_999)  # more than a second back: the clock was set


def test_the_first_step_after_a_pause_covers_no_time():
    rule = Messages(On("odometry"))
    assert [rule.interval(stamp) for stamp in (10_000_000_000, 10_100_000_000)] == [0.0, 0.1]
    rule.pause()
    assert [rule.interval(stamp) for stamp in (10_200_000_000, 10_300_000_000)] == [0.0, 0.1]


@pytest.mark.parametrize(("gap", "said"), [(1_500_000_000, "1.50"), (-1_500_000_000, "-1.50")])
def test_after_a_gap_in_time_it_starts_again(gap, said):
    rule = Messages(On("odometry", period=0.1, max_gap=1.0))
    start = 10 * SECOND
    for k in range(3):
        assert rule.due(start + k * 100 * MS)[0]
        rule.interval(start + k * 100 * MS)
    stamp = start + 200 * MS + gap
    rule.check(stamp)
    due, why = rule.due(stamp)
    assert due
    assert why == f"{said} s between two messages"
    assert rule.interval(stamp) == 0.0
