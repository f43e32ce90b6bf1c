"""The age of a message: the oldest of its times, none the younger for a clock that is ahead, or that is set."""

import math
import time
from types import SimpleNamespace

import pytest

from cmd_vel_guard.sent import Ages, SystemClock, read_clocks

EPOCH = 1.7e9
"""The system clock when the steady one says 0, s."""
HEADER, SOURCE, ARRIVAL = "its header's stamp", "DDS's source time", "its arrival"


def clock(*looks):
    """Return a clock that has seen pairs of (steady time, offset from the usual)."""
    seen = SystemClock()
    for steady, offset in looks or [(100.0, 0.0)]:
        seen.look(system=EPOCH + offset + steady, steady=steady)
    return seen


def age(ages, steady=100.0, **times):
    unknown = {"source": 0.0, "arrival": 0.0, "header": 0.0}
    return ages.age(steady=steady, **unknown | {name: EPOCH + time for name, time in times.items()})


@pytest.mark.parametrize(
    ("times", "sent", "measured", "dated", "by"),
    [
        ({"source": 99.7, "arrival": 99.9}, 0.3, 0.3, True, SOURCE),
        ({"source": 99.7, "arrival": 99.9, "header": 40.0}, 0.3, 60.0, True, HEADER),
        ({"source": 99.7, "arrival": 99.6}, 0.4, 0.4, True, ARRIVAL),
        ({"source": 99.0, "arrival": 99.9, "header": 99.8}, 0.2, 0.2, True, HEADER),  # sent by a clock that is behind
        ({"source": 99.0, "arrival": 99.7, "header": 99.8}, 0.3, 0.3, True, HEADER),
        ({"source": 100.05, "arrival": 99.9}, 0.1, 0.1, True, ARRIVAL),
        ({"source": 100.0 - 1e5, "arrival": 100.0}, 1e5, 1e5, True, SOURCE),  # what looks old is old, however old
        ({"arrival": 99.8}, 0.2, 0.2, False, ARRIVAL),
        ({"arrival": 100.2}, 0.0, 0.0, False, ARRIVAL),
        ({"source": 12.3 - EPOCH, "arrival": 99.8, "header": 34.5 - EPOCH}, 0.2, 0.2, False, ARRIVAL),  # of another epoch
        ({}, 0.0, 0.0, False, ARRIVAL),
    ],
)
def test_the_oldest_time_counts_and_nothing_is_sent_before_it_was_measured(times, sent, measured, dated, by):
    assert age(Ages(clock()), **times) == (pytest.approx(sent, abs=1e-5), pytest.approx(measured, abs=1e-5), dated, by, "")


def test_before_its_clock_was_ever_set_a_machine_knows_ages_all_the_same():
    seen = SystemClock()
    seen.look(system=50.0, steady=10.0)
    assert Ages(seen).age(steady=10.0, source=49.75, arrival=49.875, header=49.5)[:2] == (0.25, 0.5)


def stream(ages, lead, delays, *, start=100.0, name="header"):
    """Let messages arrive at 10 Hz from a clock with a lead, each with its delay; return what is known of each."""
    return [age(ages, start + 0.1 * k, **{name: start + 0.1 * k + lead - delay}) for k, delay in enumerate(delays)]


@pytest.mark.parametrize("name", ["header", "source"])
@pytest.mark.parametrize("lead", [0.09, 0.13, 0.775, 1.9])
def test_a_clock_that_is_ahead_hides_no_late_message(name, lead):
    ages = stream(Ages(clock()), lead, [0.02, 0.0, *[0.03] * 10, 0.0, 0.4, 1.5, 30.0], name=name)
    assert all(aged.measured == math.inf for aged in ages[:10]) is (lead > 0.1)  # until the lead is settled
    for aged, delay in zip(ages[12:], (0.0, 0.4, 1.5, 30.0), strict=True):
        assert aged.measured == pytest.approx(delay, abs=2e-3)
    assert age(Ages(clock()), **{name: 100.0 + lead}).sent == (math.inf if lead > 0.1 else pytest.approx(0.0, abs=1e-6))


def test_a_clock_that_is_ahead_by_more_than_the_bound_is_refused():
    (last,) = {aged.refusal for aged in stream(Ages(clock()), 2.1, [0.0] * 30)}
    assert last == "by its header's stamp its clock is 2.10 s ahead, more than 2 s: synchronize both clocks (chrony)"
    assert stream(Ages(clock()), 5.0, [0.0])[0].complaint(0.5) != ""


def test_a_header_by_another_clock_does_not_bound_the_time_since_sending():
    ages = Ages(clock())
    stream(ages, 0.775, [0.0] * 20)
    assert age(ages, 102.0, header=102.775, source=101.0).sent == pytest.approx(1.0, abs=1e-5)


def test_a_sender_whose_clock_jumps_ahead_counts_again_a_second_later_and_one_set_back_after_a_new_start():
    ages = Ages(clock())
    stream(ages, 0.0, [0.0] * 10)
    after = stream(ages, 1.0, [0.0] * 20, start=101.0)
    assert [aged.measured == math.inf for aged in after] == [True] * 10 + [False] * 10
    assert "ahead, which is new: it counts in 1 s" in after[0].refusal
    back = stream(ages, 0.0, [0.0] * 600, start=103.0)
    assert min(aged.measured for aged in back) > 0.96  # it is forgotten by 0.03 s a minute
    ages.begin()
    assert stream(ages, 0.0, [0.0], start=163.0)[0].measured == pytest.approx(0.0, abs=1e-5)


def test_a_lead_follows_two_clocks_that_drift_apart():
    ages = Ages(clock())
    stream(ages, 0.05, [0.0])
    for drift in (4e-4, -4e-4):
        for k in range(1000):
            at = 100.0 + 0.1 * k
            assert age(ages, at, header=at + 0.05 + drift * 0.1 * k).measured < 0.01
        ages.begin()


def test_a_complaint_says_what_to_do():
    ages = Ages(clock())
    old = age(ages, header=99.0, source=99.5)
    assert old.complaint(0.5).startswith(
        "1.00 s old by its header's stamp, more than 0.5 s: it is late, or its clock is behind"
    )
    assert old.complaint(0.5, lasts=0.5) == ""
    assert old.complaint(0.4, lasts=5.0).startswith("1.00 s old")  # a long revolution does not excuse a late message
    assert old.complaint(1.0, sent=0.4).startswith("sent 0.50 s ago, more than 0.4 s: it is late")
    assert old.complaint(1.0, sent=0.5) == ""
    assert ages.figures() == ", clock -1.00 s"
    assert Ages(clock()).figures() == ""


@pytest.mark.parametrize(
    ("change", "is_step"), [(0.0008, False), (0.001, False), (0.0015, True), (-0.0008, False), (-0.0015, True)]
)
def test_a_change_of_more_than_a_millisecond_is_a_step(change, is_step):
    seen = SystemClock()
    seen.look(system=0.0, steady=0.0)
    seen.look(system=change, steady=0.0)
    measured = Ages(seen).age(steady=0.0, source=-1.0, arrival=0.0, header=0.0).measured
    assert measured == 1.0 + (max(change, 0.0) if is_step else change)


@pytest.mark.parametrize("heard", [False, True])
@pytest.mark.parametrize("step", [-7200.0, -30.0, -1.0, -0.3, 0.3, 30.0, 7200.0])
def test_a_clock_that_is_set_makes_nothing_younger(step, heard):
    seen = clock((100.0, 0.0))
    ages = Ages(seen)
    if heard:
        stream(ages, 0.0, [0.0] * 10)
    seen.look(system=EPOCH + 101.0 + step, steady=101.0)
    assert age(ages, 101.0, source=100.2, arrival=101.0 + step).sent >= 0.8 - 1e-3
    assert (age(ages, 101.0, source=101.0 + step).sent < 0.1) is (step > 0.0)
    seen.look(system=EPOCH + step + 110.9, steady=110.9)
    assert age(ages, 110.9, source=100.2).sent >= 10.7 - 1e-2
    seen.look(system=EPOCH + step + 111.0, steady=111.0)  # 10 s later the old offset is gone
    assert age(ages, 111.0, source=110.9 + step).sent == pytest.approx(0.1, abs=1e-5)


def test_the_steady_clock_goes_on_while_the_machine_sleeps():
    system, steady = read_clocks()
    assert system == pytest.approx(time.time(), abs=1.0)
    assert steady == pytest.approx(time.clock_gettime(time.CLOCK_BOOTTIME), abs=1.0)


def test_the_times_of_a_message_are_read():
    info = {"source_timestamp": int((EPOCH + 99.75) * 1e9), "received_timestamp": int((EPOCH + 99.875) * 1e9)}
    header = SimpleNamespace(stamp=SimpleNamespace(sec=int(EPOCH) + 99, nanosec=500_000_000))
    assert Ages(clock()).age_of(info, None, 100.0)[:2] == (pytest.approx(0.25, abs=1e-5),) * 2
    assert Ages(clock()).age_of(info, header, 100.0)[:2] == (pytest.approx(0.25, abs=1e-5), pytest.approx(0.5, abs=1e-5))
    info["source_timestamp"] = 0
    assert Ages(clock()).age_of(info, None, 100.0).dated is False


def test_a_gap_does_not_make_it_forget_the_clock_before():
    ages = Ages(clock((100.0, 0.0), (130.0, -29.0)))  # set back by 29 s in 30 s of sleep
    assert age(ages, 130.0, source=100.9).sent == pytest.approx(29.1, abs=1e-5)


def test_a_slewed_clock_is_followed():
    seen = clock(*((100.0 + 0.02 * k, -1e-5 * k) for k in range(5000)))  # 500 ppm for 100 s
    assert (len(seen.offsets), seen.steps) == (1, 0)
    assert age(Ages(seen), 200.0, source=199.9 - 0.05).sent == pytest.approx(0.1, abs=1e-4)
