"""The age of a message: the oldest that is credible, and none the younger for a clock that is set."""

import time
from types import SimpleNamespace

import pytest

from turtlebot_gym_ros.robot.sent import SystemClock, read_clocks

EPOCH = 1.7e9
"""The system clock when the steady one says 0, s."""


def clock(*looks):
    """Return a clock that has seen pairs of (steady time, offset from the usual)."""
    seen = SystemClock()
    for steady, offset in looks or [(100.0, 0.0)]:
        seen.look(system=EPOCH + offset + steady, steady=steady)
    return seen


def age(seen, steady=100.0, **times):
    unknown = {"source": 0.0, "arrival": 0.0, "header": 0.0}
    return seen.age(steady=steady, **unknown | {name: EPOCH + time for name, time in times.items()})


@pytest.mark.parametrize(
    ("times", "seconds", "dated", "by"),
    [
        ({"source": 99.7, "arrival": 99.9}, 0.3, True, "DDS's source time"),
        ({"source": 99.7, "arrival": 99.9, "header": 40.0}, 60.0, True, "its header's stamp"),
        ({"source": 99.7, "arrival": 99.6}, 0.4, True, "its arrival"),
        ({"source": 100.09, "arrival": 99.9}, 0.1, True, "its arrival"),  # within what two clocks differ by
        ({"source": 100.11, "arrival": 99.9}, 0.1, False, "its arrival"),
        ({"source": 105.0, "arrival": 100.0}, 0.0, False, "its arrival"),
        ({"source": 100.0 - 3599.0, "arrival": 100.0}, 3599.0, True, "DDS's source time"),
        ({"source": 100.0 - 3600.0, "arrival": 100.0}, 3600.0, True, "DDS's source time"),
        ({"source": 100.0 - 3601.0, "arrival": 100.0}, 0.0, False, "its arrival"),
        ({"arrival": 100.0 - 3600.0}, 3600.0, False, "its arrival"),
        ({"arrival": 100.0 - 3601.0}, 0.0, False, "its arrival"),
        ({"arrival": 99.8}, 0.2, False, "its arrival"),
        ({}, 0.0, False, "its arrival"),
    ],
)
def test_the_oldest_credible_age_counts(times, seconds, dated, by):
    found = age(clock(), **times)
    assert found[:3] == (pytest.approx(seconds, abs=1e-5), dated, by)


def test_stamps_near_zero_are_no_stamps():
    found = clock().age(steady=100.0, source=EPOCH + 99.9, arrival=EPOCH + 99.9, header=12.3)
    assert found[:2] == (pytest.approx(0.1, abs=1e-5), True)


def test_a_clock_that_is_ahead_is_reported():
    assert age(clock(), source=105.0).ahead == pytest.approx(5.0, abs=1e-5)
    assert age(clock(), source=105.0, header=99.0).ahead == 0.0
    assert age(clock(), source=99.9).ahead == 0.0
    assert age(clock(), arrival=99.9).ahead == 0.0  # nothing is known of the sender's clock
    set_ahead = clock((100.0, 0.0), (101.0, 30.0))
    assert age(set_ahead, 101.0, source=136.0).ahead == pytest.approx(5.0, abs=1e-5)  # of what the clock is now


def test_a_tenth_of_a_second_ahead_is_credible():
    seen = SystemClock()
    seen.look(system=0.0, steady=0.0)  # near zero 0.1 is exact
    assert seen.age(steady=0.0, source=0.1, arrival=0.0, header=5.0).dated
    assert not seen.age(steady=0.0, source=0.101, arrival=0.0, header=5.0).dated


@pytest.mark.parametrize(
    ("change", "is_step"), [(0.0008, False), (0.001, False), (0.0015, True), (-0.0008, False), (-0.0015, True)]
)
def test_a_change_of_more_than_a_millisecond_is_a_step(change, is_step):
    seen = SystemClock()
    seen.look(system=0.0, steady=0.0)
    seen.look(system=change, steady=0.0)
    assert seen.age(steady=0.0, source=-1.0, arrival=0.0, header=0.0).seconds == 1.0 + (max(change, 0.0) if is_step else change)


@pytest.mark.parametrize("step", [-7200.0, -30.0, -1.0, -0.3])
def test_a_clock_that_is_set_back_makes_nothing_younger(step):
    seen = clock((100.0, 0.0), (101.0, step))
    assert age(seen, 101.0, source=100.2, arrival=101.0 + step).seconds >= 0.8 - 1e-5
    seen.look(system=EPOCH + step + 110.9, steady=110.9)
    assert age(seen, 110.9, source=100.2).seconds >= 10.7 - 1e-5
    seen.look(system=EPOCH + step + 111.0, steady=111.0)  # 10 s later the old offset is gone
    assert age(seen, 111.0, source=110.9 + step).seconds == pytest.approx(0.1, abs=1e-5)


@pytest.mark.parametrize("step", [0.3, 30.0, 7200.0])
def test_a_clock_that_is_set_ahead_makes_nothing_younger(step):
    seen = clock((100.0, 0.0), (101.0, step))
    assert age(seen, 101.0, source=100.2).seconds >= 0.8 - 1e-5
    assert age(seen, 101.0, source=100.9 + step).seconds == pytest.approx(0.1, abs=1e-5)


def test_a_gap_does_not_make_it_forget_the_clock_before():
    seen = clock((100.0, 0.0), (130.0, -29.0))  # set back by 29 s in 30 s of sleep
    assert age(seen, 130.0, source=100.9).seconds == pytest.approx(29.1, abs=1e-5)


def test_a_slewed_clock_is_followed():
    seen = clock(*((100.0 + 0.02 * k, -1e-5 * k) for k in range(5000)))  # 500 ppm for 100 s
    assert len(seen._offsets) == 1
    assert age(seen, 200.0, source=199.9 - 0.05).seconds == pytest.approx(0.1, abs=1e-4)


def test_the_steady_clock_goes_on_while_the_machine_sleeps():
    system, steady = read_clocks()
    assert system == pytest.approx(time.time(), abs=1.0)
    assert steady == pytest.approx(time.clock_gettime(time.CLOCK_BOOTTIME), abs=1.0)


def test_the_times_of_a_message_are_read():
    info = {"source_timestamp": int((EPOCH + 99.75) * 1e9), "received_timestamp": int((EPOCH + 99.875) * 1e9)}
    header = SimpleNamespace(stamp=SimpleNamespace(sec=int(EPOCH) + 99, nanosec=500_000_000))
    assert clock().age_of(info, None, 100.0).seconds == pytest.approx(0.25, abs=1e-5)
    assert clock().age_of(info, header, 100.0).seconds == pytest.approx(0.5, abs=1e-5)
    info["source_timestamp"] = 0
    assert clock().age_of(info, None, 100.0)[:2] == (pytest.approx(0.125, abs=1e-5), False)
