"""The state machine that decides whether a robot may move, told the time by the test."""

from itertools import pairwise

import pytest

from turtlebot_gym_ros.node.safety import BLOCKED, SILENCE, STOP_FOR, STOP_PERIOD, Safety


def active(now=0.0):
    """Return one that moves the robot."""
    safety = Safety(enabled=True)
    assert safety.activate(safety.begin(now=now))
    safety.end()
    return safety


def stops(safety, start, end, step=0.01):
    """Return the times at which stops are to be sent."""
    times = [start + k * step for k in range(round((end - start) / step) + 1)]
    return [now for now in times if safety.tick(now=now)]


def test_it_starts_silent_and_disabled():
    safety = Safety(enabled=False)
    assert safety.state == "silent: not enabled"
    assert not safety.activate(safety.begin(now=0.0))
    assert stops(safety, 0.0, 2.0) == []


def test_enabled_it_is_active_with_the_first_step():
    safety = Safety(enabled=False)
    assert safety.enable(now=0.0) is None
    assert safety.state == "silent: no step yet"
    assert safety.activate(safety.begin(now=0.0))
    assert safety.state == "active"


@pytest.mark.parametrize("disable", [True, False])
def test_a_stop_is_one_second_of_zeros_and_then_silence(disable):
    safety = active()
    safety.stop("because", now=10.0, disable=disable)
    assert safety.state == "stopping: because"
    times = stops(safety, 10.0, 13.0)
    assert times[0] == 10.0  # at once
    assert 10.0 + STOP_FOR - 2 * STOP_PERIOD < times[-1] < 10.0 + STOP_FOR
    assert max(b - a for a, b in pairwise(times)) < STOP_PERIOD + 0.011
    assert safety.state == "silent: because"


def test_a_stop_of_what_does_not_move_is_silent():
    safety = Safety(enabled=True)
    safety.stop("waits for /odom", now=0.0)
    assert safety.state == "silent: waits for /odom"
    assert stops(safety, 0.0, 2.0) == []


def test_it_goes_on_after_a_stop_only_if_it_was_not_disabled():
    for disable in (True, False):
        safety = active()
        safety.stop("because", now=0.0, disable=disable)
        assert safety.activate(safety.begin(now=0.1)) is not disable


def test_the_result_of_a_step_that_was_overtaken_by_a_stop_is_dropped():
    safety = active()
    ticket = safety.begin(now=0.0)
    safety.stop("because", now=0.1)
    assert not safety.activate(ticket)
    assert safety.activate(safety.begin(now=0.2))


def test_a_blocked_step_is_a_fault():
    safety = active()
    safety.begin(now=0.0)
    assert stops(safety, 0.0, BLOCKED - 0.01) == []
    assert stops(safety, BLOCKED + 0.01, 3.0)
    assert not safety.enabled
    assert safety.enable(now=3.0) == "the last step is still blocked"
    safety.end()
    assert safety.enable(now=3.1) is None


def test_an_emergency_stop_needs_enabling_again():
    safety = active()
    safety.hear_emergency(False, now=0.0)
    assert safety.phase == "active"
    safety.hear_emergency(True, now=0.1)
    assert safety.state == "stopping: emergency stop"
    assert safety.enable(now=0.2) is not None
    safety.hear_emergency(False, now=0.3)
    assert not safety.enabled
    assert safety.enable(now=0.3) is None
    assert safety.enabled


def test_an_emergency_stop_that_falls_silent_is_a_stop():
    safety = active()
    safety.hear_emergency(False, now=0.0)
    assert stops(safety, 0.0, SILENCE - 0.01) == []
    assert stops(safety, SILENCE + 0.01, 3.0)
    assert safety.state == "silent: the emergency stop is silent"
    assert safety.enable(now=3.0) is not None


def test_an_emergency_stop_that_was_never_heard_is_not_needed():
    assert stops(active(), 0.0, 100.0, step=0.5) == []
