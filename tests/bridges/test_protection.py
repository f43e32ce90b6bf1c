"""What protects a robot from a node that moves it: each law is a protection."""

import math
import time
from dataclasses import replace
from threading import Event

import pytest
from bench import Mover
from nav_msgs.msg import Odometry
from std_msgs.msg import Bool

from turtlebot_gym.values import Command


def starts_disabled(make_bench):
    bench = make_bench(enabled=None)
    bench.wait_for(lambda: bench.send() or (bench.advance(0.01) and bench.shell.inputs.feeds["odometry"]._received > 5))
    assert bench.state == "silent: not enabled"
    assert not bench.commands
    assert not bench.steps


def disabled_it_stops(make_bench):
    bench = driving(make_bench)
    bench.enable(False)
    for _ in range(5):
        bench.send()
    bench.stops("not enabled")


def at_rest_it_stops_and_then_needs_fresh_inputs(make_bench):
    bench = driving(make_bench)
    with bench.shell.at_rest():  # as before the process is suspended
        bench.wait_for(lambda: bench.speeds[-1] == 0.0)
        bench.now.at += 10.0
    bench.wait_for(lambda: bench.advance(0.02) and bench.state.startswith("silent"))
    del bench.commands[:]
    bench.drive()


def old_inputs_stop(make_bench):
    bench = driving(make_bench)
    bench.now.at += 0.49
    time.sleep(0.1)  # some turns of the watch
    assert bench.state == "active"
    bench.now.at += 0.02
    bench.stops("/odom is older than 0.5 s")


def failing(act, said):
    def law(make_bench):
        bench = driving(make_bench)
        bench.block.act = act
        bench.send()
        bench.wait_for(lambda: bench.state.startswith("stopping: fault"))
        assert said in bench.state
        fault = bench.state.removeprefix("stopping: ")
        bench.block.go_on()
        for _ in range(5):
            bench.send()
        assert said in bench.report("fault" if said == "fault" else said).message
        bench.stops(fault)
        assert bench.enable().success
        bench.drive()

    return law


exceptions_stop = failing(lambda: 1 / 0, "ZeroDivisionError")
nan_stops = failing(lambda: {"command": Command(math.nan, 0.0)}, "must be finite")
infinity_stops = failing(lambda: {"command": Command(0.1, -math.inf)}, "must be finite")
nonsense_stops = failing(lambda: None, "AttributeError")


def blocked_steps_stop(make_bench):
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


def the_emergency_stop_stops(make_bench):
    bench = make_bench()
    emergency = bench.peer.speak("emergency_stop", Bool)
    bench.wait_for(emergency.get_subscription_count)
    bench.drive()
    emergency.publish(Bool(data=True))
    bench.stops("emergency stop")
    assert bench.enable().message == "the emergency stop is silent"  # pressed 2 s ago, and not heard since
    bench.wait_for(lambda: bench.advance(0.2) and (emergency.publish(Bool(data=False)) or bench.enable().success))
    bench.now.at += 0.01
    bench.drive()


def a_press_counts_however_short_and_every_button_must_be_released(make_bench):
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
    bench.wait_for(lambda: say(False, False) or bench.enable().success)


def refused(said, **broken):
    """Return the law that a kind of odometry is refused with a message, and counts as missing."""

    def law(make_bench):
        bench = driving(make_bench)
        steps = bench.steps
        bench.send(**broken)
        status = bench.report(said)
        assert status.level == b"\x01"
        assert bench.steps == steps
        bench.now.at += 0.6
        bench.stops("/odom is older than 0.5 s")

    return law


another_frame = refused("its frame is 'map' instead of 'odom'", frame="map")
no_rotation = refused("the quaternion (0.0, 0.0, 0.0, 0.0) has norm 0", norm=0.0)
nan_odometry = refused("the pose must be finite", x=math.nan)
repeated = refused("stamp", dt=0.0)
out_of_order = refused("stamp", dt=-0.05)


def the_end_of_the_node_stops(make_bench):
    bench = driving(make_bench)
    bench.shell.close()
    bench.wait_for(lambda: 0.0 in bench.speeds)
    assert set(bench.speeds[bench.speeds.index(0.0) :]) == {0.0}


class SoleMover(Mover):
    """A mover whose odometry one node may publish."""

    inputs = {"odometry": replace(Mover.inputs["odometry"], sole=True)}


def speak_beside(bench):
    """Let another publisher of odometry come, with the name of the first one's node, and return it when it is heard of."""
    count = bench.shell.inputs.feeds["odometry"]._subscription.get_publisher_count
    before = count()
    other = bench.peer.speak("odom", Odometry)
    bench.wait_for(lambda: count() == before + 1 and other.get_subscription_count())
    return other


def silence(bench, publisher):
    """End a publisher of odometry, and wait until it is known."""
    count = bench.shell.inputs.feeds["odometry"]._subscription.get_publisher_count
    before = count()
    bench.peer.node.destroy_publisher(publisher)
    bench.wait_for(lambda: count() == before - 1)


def a_second_source_stops_while_it_is_there(make_bench):
    bench = driving(make_bench, make=SoleMover)
    other = speak_beside(bench)
    for _ in range(5):
        bench.send()
    bench.stops(several := "2 nodes publish /odom, where one may; a killed one counts for 20 s")
    assert bench.enable().message == several
    silence(bench, other)
    bench.drive()  # the first one is there as before


def another_source_stops(*, beside):
    """Return the law that a source which takes another's place moves nothing until a person enables, whatever its name."""

    def law(make_bench):
        bench = driving(make_bench, make=SoleMover)
        right, bench.odometry = bench.odometry, speak_beside(bench) if beside else None
        silence(bench, right)
        bench.odometry = bench.odometry or speak_beside(bench)
        bench.wait_for(lambda: bench.send() or (bench.advance(0.02) and "/odom has another source, /peer:" in bench.state))
        bench.settle()
        del bench.commands[:]
        for _ in range(20):
            bench.send()
            bench.advance(0.1)
        assert not any(bench.speeds)
        assert bench.enable().success
        bench.drive()

    return law


a_source_after_another_stops, a_source_that_outlasts_another_stops = (another_source_stops(beside=beside) for beside in (0, 1))


def driving(make_bench, **options):
    bench = make_bench(**options)
    bench.drive()
    return bench


PROTECTIONS = [
    starts_disabled,
    disabled_it_stops,
    at_rest_it_stops_and_then_needs_fresh_inputs,
    old_inputs_stop,
    exceptions_stop,
    nan_stops,
    infinity_stops,
    nonsense_stops,
    blocked_steps_stop,
    the_emergency_stop_stops,
    a_press_counts_however_short_and_every_button_must_be_released,
    another_frame,
    no_rotation,
    nan_odometry,
    repeated,
    out_of_order,
    the_end_of_the_node_stops,
    a_second_source_stops_while_it_is_there,
    a_source_after_another_stops,
    a_source_that_outlasts_another_stops,
]


@pytest.mark.sample(6)
@pytest.mark.parametrize("law", PROTECTIONS)
def test_protection(make_bench, law):
    law(make_bench)
