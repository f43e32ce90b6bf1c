"""What protects a robot from a node that moves it: on real DDS, with a clock that the test sets."""

import math
import time
from dataclasses import replace
from itertools import pairwise
from threading import Event

import pytest
from bench import Mover
from nav_msgs.msg import Odometry
from std_msgs.msg import Bool

from turtlebot_gym.values import Command
from turtlebot_gym_ros.node.safety import Safety


def driving(make_bench, **options):
    bench = make_bench(**options)
    bench.drive()
    return bench


def test_starts_disabled(make_bench):
    bench = make_bench(enabled=None)
    bench.wait_for(lambda: bench.send() or (bench.advance(0.01) and bench.shell.inputs.feeds["odometry"]._received > 5))
    assert bench.state == "silent: not enabled"
    assert not bench.commands
    assert not bench.steps


def test_disabled_it_stops(make_bench):
    bench = driving(make_bench)
    bench.enable(False)
    for _ in range(5):
        bench.send()
    bench.stops("not enabled")


def test_at_rest_it_stops_and_then_needs_fresh_inputs(make_bench):
    bench = driving(make_bench)
    with bench.shell.at_rest():  # as before the process is suspended
        bench.wait_for(lambda: bench.speeds[-1] == 0.0)
        bench.now.at += 10.0
    bench.wait_for(lambda: bench.advance(0.02) and bench.state.startswith("silent"))
    del bench.commands[:]
    bench.drive()


def test_old_inputs_stop(make_bench):
    bench = driving(make_bench)
    bench.now.at += 0.49
    time.sleep(0.1)  # some turns of the watch
    assert bench.state == "active"
    bench.now.at += 0.02
    bench.stops("/odom is older than 0.5 s")


@pytest.mark.parametrize(
    ("act", "said"),
    [
        (lambda: 1 / 0, "ZeroDivisionError"),
        (lambda: {"command": Command(math.nan, 0.0)}, "must be finite"),
    ],
)
def test_a_step_that_fails_stops(make_bench, act, said):
    bench = driving(make_bench)
    bench.block.act = act
    bench.send()
    bench.wait_for(lambda: bench.state.startswith("stopping: fault"))
    assert said in bench.state
    fault = bench.state.removeprefix("stopping: ")
    bench.block.go_on()
    for _ in range(5):
        bench.send()
    assert said in bench.report(said).message
    bench.stops(fault)
    assert bench.enable().success
    bench.drive()


def test_blocked_steps_stop(make_bench):
    bench = driving(make_bench)
    release = Event()
    steps = bench.steps

    def block():
        release.wait(30.0)
        return {"command": Command(0.1, 0.0)}

    bench.block.act = block
    try:
        bench.send()
        bench.wait_for(lambda: bench.steps > steps)
        bench.now.at += 0.45
        time.sleep(0.1)
        assert 0.0 not in bench.speeds
        bench.now.at += 0.1  # the odometry is also older than its limit now
        bench.wait_for(lambda: 0.0 in bench.speeds)
    finally:
        release.set()
    bench.wait_for(lambda: bench.shell._dropped == 1)
    assert bench.shell.switch.safety.state.startswith(("stopping", "silent"))
    assert set(bench.speeds[bench.speeds.index(0.0) :]) == {0.0}


def test_a_press_counts_however_short_and_every_button_must_be_released(make_bench):
    bench = make_bench()
    buttons = [bench.peer.speak("emergency_stop", Bool, 1) for _ in range(2)]
    for button in buttons:
        bench.wait_for(button.get_subscription_count)

    def say(*pressed):
        for button, state in zip(buttons, pressed, strict=True):
            button.publish(Bool(data=state))
        time.sleep(0.05)
        bench.advance(0.1)

    for _ in range(3):
        say(False, False)
    bench.drive()
    buttons[0].publish(Bool(data=True))
    buttons[0].publish(Bool(data=False))
    bench.wait_for(lambda: bench.state == "stopping: emergency stop")
    for _ in range(8):
        say(False, True)
    assert bench.enable().message == "the emergency stop is pressed"
    assert bench.speeds[-1] == 0.0
    bench.wait_for(lambda: say(False, False) or bench.enable().success)
    bench.now.at += 0.01
    bench.drive()


@pytest.mark.parametrize(
    ("said", "broken"),
    [
        ("the pose must be finite", {"x": math.nan}),
        ("stamp", {"dt": -0.05}),
        pytest.param("its frame is 'map' instead of 'odom'", {"frame": "map"}, marks=pytest.mark.slow),
    ],
)
def test_odometry_that_is_none_is_refused_and_counts_as_missing(make_bench, said, broken):
    bench = driving(make_bench)
    steps = bench.steps
    bench.send(**broken)
    assert bench.report(said).level == b"\x01"
    assert bench.steps == steps
    bench.now.at += 0.6
    bench.stops("/odom is older than 0.5 s")


def test_the_end_of_the_node_stops(make_bench):
    bench = driving(make_bench)
    bench.shell.close()
    bench.wait_for(lambda: 0.0 in bench.speeds)
    assert set(bench.speeds[bench.speeds.index(0.0) :]) == {0.0}


class SoleMover(Mover):
    """A mover whose odometry one node may publish."""

    inputs = {"odometry": replace(Mover.inputs["odometry"], sole=True)}


@pytest.mark.parametrize("beside", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_a_source_that_takes_anothers_place_moves_nothing_until_a_person_enables(make_bench, beside):
    """Whatever its name, before or after the end of the other."""
    bench = driving(make_bench, make=SoleMover)
    right, count = bench.odometry, bench.shell.inputs.feeds["odometry"]._subscription.get_publisher_count
    for number in (2, 1) if beside else (0, 1):
        if number > count():
            bench.odometry = bench.peer.speak("odom", Odometry)
        else:
            bench.peer.node.destroy_publisher(right)
        bench.wait_for(lambda number=number: count() == number)
    bench.wait_for(lambda: bench.send() or (bench.advance(0.02) and "/odom has another source, /peer:" in bench.state))
    bench.settle()
    del bench.commands[:]
    for _ in range(20):
        bench.send()
        bench.advance(0.1)
    assert not any(bench.speeds)
    assert bench.enable().success
    bench.drive()


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
