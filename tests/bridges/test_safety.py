"""The state machine that decides whether a robot may move, told the time by the test."""

from itertools import pairwise

import pytest

from turtlebot_gym_ros.node.safety import Safety


def active(now=0.0):
    """Return one that moves the robot."""
    safety = Safety(enabled=True, blocked=0.5)
    assert safety.activate(safety.begin(now=now))
    safety.end()
    return safety


def stops(safety, start, end, step=0.01):
    """Return the times at which stops are to be sent."""
    times = [start + k * step for k in range(round((end - start) / step) + 1)]
    return [now for now in times if safety.tick(now=now)]


@pytest.mark.parametrize("disable", [True, False])
def test_a_stop_overtakes_a_step_and_it_goes_on_unless_it_was_disabled_which_no_plain_stop_ends(disable):
    safety = active(now=5.0)
    ticket = safety.begin(now=5.0)
    safety.stop("a fault", now=5.1, disable=disable)
    assert not safety.activate(ticket)
    safety.stop("old input", now=5.2)
    assert safety.enabled is not disable
    assert safety.activate(safety.begin(now=5.3)) is not disable


@pytest.mark.parametrize("disable", [True, False])
def test_a_stop_is_one_second_of_zeros_every_50_ms_and_then_silence(disable):
    safety = active(now=9.9)
    safety.stop("because", now=10.0, disable=disable)
    assert safety.state == "stopping: because"
    times = stops(safety, 10.0, 13.0)
    assert times[0] == 10.0  # at once
    assert 10.93 < times[-1] < 11.0
    assert 16 <= len(times) <= 20
    assert min(b - a for a, b in pairwise(times)) > 0.049
    assert max(b - a for a, b in pairwise(times)) < 0.061
    assert safety.state == "silent: because"
    assert safety.enabled is not disable


def test_a_blocked_step_is_a_fault():
    safety = active(now=20.0)
    safety.begin(now=20.0)
    assert stops(safety, 20.0, 20.499) == []
    assert safety.enabled
    assert safety.tick(now=20.501)
    assert safety.state == "stopping: fault: a step takes longer than 0.5 s"
    assert not safety.enabled
    stops(safety, 20.51, 23.0)
    assert safety.enable(now=23.0, buttons=0) == "the last step is still blocked"
    safety.end()
    assert safety.enable(now=23.1, buttons=0) is None


@pytest.mark.parametrize("pressed", [False, True])
def test_what_may_have_hidden_a_press_disables_as_a_press_does(pressed):
    safety = active(now=7.0)
    safety.hear_emergency(False, now=7.0, number=1)
    for now in (7.3, 7.6):
        safety.tick(now=now)
    safety.hear_emergency(pressed, now=7.7, number=2 if pressed else 3)
    assert safety.tick(now=7.7)
    assert not safety.enabled
    assert safety.enable(now=7.8, buttons=0) == (
        "the emergency stop is pressed" if pressed else "messages of the emergency stop were lost"
    )
