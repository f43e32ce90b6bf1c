"""The switch of a node that moves a robot: what it makes of the buttons' messages."""

import math
import time

from std_msgs.msg import Bool


def speak(bench, *buttons):
    """Let buttons say at 10 Hz, by the bench's clock, what they say; return what tells them."""
    for button in buttons:
        bench.wait_for(button.get_subscription_count)

    def once(*pressed):
        for button, state in zip(buttons, pressed, strict=True):
            button.publish(Bool(data=state))
        time.sleep(0.05)
        bench.advance(0.1)

    return once


def test_a_press_counts_however_short_and_every_button_must_be_released(make_bench):
    bench = make_bench()
    buttons = [bench.peer.speak("emergency_stop", Bool, 1) for _ in range(2)]
    say = speak(bench, *buttons)
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


def test_one_of_two_buttons_that_falls_silent_stops(make_bench):
    bench = make_bench()
    buttons = [bench.peer.speak("emergency_stop", Bool, 1) for _ in range(2)]
    both = speak(bench, *buttons)
    for _ in range(4):
        both(False, False)
    one = speak(bench, buttons[0])
    for _ in range(8):
        one(False)
    bench.wait_for(lambda: one(False) or not bench.shell.switch.safety.enabled)
    assert bench.state == "silent: 1 of 2 emergency stops are silent"


def test_a_publisher_that_was_never_heard_refuses(make_bench):
    bench = make_bench(enabled=False)
    buttons = [bench.peer.speak("emergency_stop", Bool, 1) for _ in range(2)]
    for button in buttons:
        bench.wait_for(button.get_subscription_count)
    say = speak(bench, buttons[0])
    bench.wait_for(lambda: say(False) or "publishers of the emergency stop are not heard" in bench.enable().message)
    assert bench.enable().message == "1 of 2 publishers of the emergency stop are not heard"


def test_how_long_a_step_may_take_is_the_switchs(make_bench):
    safety = make_bench().shell.switch.safety
    assert safety._blocked == 0.5
    assert math.isfinite(safety._blocked)
