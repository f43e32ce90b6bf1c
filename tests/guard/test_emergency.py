"""The rule of the emergency stop: presses however short, buttons however many, told apart by the numbers that DDS gives."""

import math

import pytest

from cmd_vel_guard.emergency import EmergencyStop


def play(*events):
    """Let buttons speak: (time, number) or (time, number, pressed)."""
    stop = EmergencyStop()
    for at, number, *pressed in sorted(events):
        stop.hear(bool(pressed and pressed[0]), now=at, number=number)
    return stop


def button(start, end, first=1, pressed=()):
    """One that speaks every 0.2 s."""
    count = round((end - start) / 0.2)
    return [(start + 0.2 * k, first + k, k in pressed) for k in range(count)]


PRESSED, SILENT = (f"the emergency stop is {state}" for state in ("pressed", "silent"))
LOST, ENDED = "messages of the emergency stop were lost", "an emergency stop has ended"
BACK, MISSING = (
    f"{words} s"
    for words in (
        "the emergency stop was silent, and must be heard for 0.5",
        "messages of the emergency stop are missing for more than 10",
    )
)
SILENT_OF_2, SILENT_OF_3 = "1 of 2 emergency stops are silent", "1 of 3 emergency stops are silent"
TROUBLES = {
    "without a button": ((), {0.0: "", 50.0: ""}),
    "a press that was released at 51.3": ([*button(50.0, 52.0), *button(50.1, 52.0, 300, pressed=(5,))], {51.9: ""}),
    "a press lasts half a second": ([*button(50.0, 51.4), *button(50.1, 51.5, 300, pressed=(5,))], {51.59: PRESSED, 51.61: ""}),
    "and with its end": ([(50.0, 1, True), (50.25, 2)], {50.5: PRESSED, 50.5625: "", 50.75: "", 50.8125: SILENT}),
    "a button that is held": ([(50.0, 1, True), (50.2, 2, True), (50.3, 700)], {50.3: PRESSED}),
    "one that was pressed, and is not heard": (
        [(50.0, 1, True), (50.4, 700), (50.45, 2, True), (50.9, 701)],
        {50.94: PRESSED, 50.96: SILENT_OF_2},
    ),
    "one that falls silent": (button(50.0, 51.0), {51.29: "", 51.31: SILENT}),
    "and is heard again": (
        [*button(50.0, 51.0), (52.0, 6), (52.2, 7), (52.4, 8), (52.6, 9)],
        {52.0: BACK, 52.49: BACK, 52.51: ""},
    ),
    "and is silent again": ([(50.0, 1), (50.625, 2), (51.25, 3)], {51.25: BACK, 51.74: BACK, 51.76: SILENT}),
    "and is silent for long": (button(50.0, 51.0), {60.79: SILENT, 60.81: MISSING}),
    "one of three": ([*button(50.0, 53.0, 9000), *button(50.07, 53.0, 5000), *button(50.13, 52.0, 7000)], {52.95: SILENT_OF_3}),
    "one of two comes back": ([*button(50.0, 55.0), *button(50.07, 52.0, 400), *button(53.0, 55.0)], {54.9: ""}),
    "many messages": ([(50.0 + 0.001 * k, k + 1) for k in range(50)], {50.1: ""}),
    "a number too far ahead is another button's": ([(50.0, 1), (50.2, 201), (50.3, 2), (50.4, 202)], {50.45: ""}),
    "a loss of as many as a button can have sent": ([(50.0, 1), (50.7, 351)], {50.7: LOST}),
    "the end of one, and another with a number too far ahead": ([(50.0, 1), (50.7, 361)], {50.7: ENDED}),
    "a loss in half a second": ([(50.0, 7), (50.5, 9)], {50.5: "", 50.9: ""}),
    "a loss in more": ([(50.0, 7), (50.51, 9)], {50.51: LOST, 51.0: LOST}),
    "a loss in more lasts half a second": ([(50.0, 7), (50.625, 9), (51.0, 10)], {51.125: LOST, 51.135: ""}),
}


@pytest.mark.parametrize(("events", "troubles"), TROUBLES.values(), ids=TROUBLES)
def test_the_trouble_with_buttons_is_said_as_long_as_it_lasts(events, troubles):
    stop = play(*events)
    assert {at: stop.trouble(at) for at in troubles} == troubles


@pytest.mark.parametrize("offset", [0, 7])
def test_two_that_go_on(offset):
    stop = play(*button(50.0, 53.0), *button(50.07, 53.0, 1 + offset))
    assert stop.trouble(53.0) == ""
    assert stop.refusal(53.0, publishers=2) == ""
    assert stop.refusal(53.0, publishers=3) == "1 of 3 publishers of the emergency stop are not heard"


@pytest.mark.parametrize("others", [(), (700, 90)])
@pytest.mark.parametrize("lost", [1, 10])
def test_a_long_gap_in_the_numbers_of_a_button_may_hide_a_press_and_makes_no_second_button(lost, others):
    stop = play(*button(50.0, 50.6, 50), *(message for first in others for message in button(50.03, 51.1, first)))
    assert stop.lost(51.0) == ""  # whatever their first numbers
    stop.hear(False, now=51.0, number=53 + lost)
    assert stop.lost(51.0) == LOST
    assert len(stop._every.buttons) == 1 + len(others)


# On a radio: each message is heard reliably, in order and perhaps late, and promptly, unless it is lost.


def radio(*events):
    """Let a button speak: (when it is heard, number, how, pressed), sent at 50 s plus 0.1 s a number."""
    stop = EmergencyStop()
    for now, number, how, *pressed in events:
        stop.hear(bool(pressed), now=now, sent=50.0 + 0.1 * number, number=number, prompt=how == "prompt")
    return stop


def both(first, last):
    return [(50.0 + 0.1 * k, k, how) for k in range(first, last + 1) for how in ("prompt", "reliable")]


LATE = [(51.9, k, "reliable") for k in range(4, 20)]  # what waited for the fourth message
ALONE = [(50.0 + 0.1 * k, k, "prompt") for k in range(5, 20)]


def test_a_lost_message_that_holds_up_the_others_stops_nothing():
    stop = radio(*both(1, 3), *ALONE)
    for now in (51.5, 51.9, 52.3):
        assert stop.trouble(now) == ""
    assert not stop.spoken_since(50.5)  # nobody knows yet what it said
    for now, number, _ in LATE:
        stop.hear(False, now=now, sent=50.0 + 0.1 * number, number=number)
    assert stop.trouble(52.3) == ""
    assert stop.spoken_since(51.9)


@pytest.mark.parametrize("how", ["prompt", "reliable"])
def test_a_press_counts_whichever_way_it_comes_and_however_late(how):
    stop = radio(*both(1, 3), *ALONE)
    stop.hear(True, now=51.9, sent=50.4, number=4, prompt=how == "prompt")
    assert stop.trouble(52.3) == PRESSED


def test_after_an_outage_it_goes_on_when_all_that_was_sent_meanwhile_has_arrived():
    stop = radio(*both(1, 5), *((50.0 + 0.1 * k, k, "prompt") for k in range(15, 22)))
    assert {now: stop.trouble(now) for now in (51.5, 52.01, 52.5)} == dict.fromkeys((51.5, 52.01, 52.5), BACK)
    for number in range(6, 22):
        stop.hear(False, now=52.5, sent=50.0 + 0.1 * number, number=number)
    assert stop.trouble(52.5) == ""
    assert stop.trouble(52.65) == SILENT
    assert stop.lost(52.65) == ""


def test_after_an_outage_in_which_messages_are_lost_for_good_somebody_must_look():
    stop = radio(*both(1, 5), *both(15, 15))
    assert stop.lost(51.6) == stop.trouble(51.6) == LOST


def test_a_clock_that_was_set_back_does_not_shorten_a_loss():
    stop = play(*button(50.0, 50.6, 50))
    stop.hear(False, now=51.0, sent=50.7, number=57)
    assert stop.lost(51.0) == LOST


@pytest.mark.parametrize("how", ["prompt", "reliable"])
def test_one_way_alone_does_not_count_for_ever(how):
    """A radio that carries nothing back, so that nothing is sent again; or a network that drops what is not."""
    stop = radio(*both(1, 3))
    for k in range(4, 120):
        stop.hear(False, now=50.0 + 0.1 * k, number=k, prompt=how == "prompt")
        assert stop.lost(50.05 + 0.1 * k) == (MISSING if k > 102 else "")


def test_two_buttons_are_told_apart_in_either_way():
    stop = EmergencyStop()
    for k in range(1, 30):
        for which in (0, 300):
            for prompt in (True, False):
                if not (which and k > 20) and (k % 7 or not prompt):
                    stop.hear(False, now=50.0 + 0.1 * k, number=k + which, prompt=prompt)
        assert stop.trouble(50.0 + 0.1 * k) == ("" if k <= 25 else SILENT_OF_2)


def test_the_end_of_a_button_is_noticed_by_its_count_and_a_loss_needs_a_button():
    stop = EmergencyStop()
    assert stop.refusal(50.0, publishers=2) == ""
    stop.hear(False, now=50.6, number=10)
    for publishers in (1, 1, 2):
        stop.count(publishers, 50.8)
        assert stop.trouble(50.8) == ""
    stop.count(1, 50.9)
    assert stop.trouble(51.0) == ENDED
    for gap, why in ((0.5, ""), (0.6, "the emergency stop was not listened to for 0.6 s")):
        stop = play((50.0, 7))
        stop.wake(gap, 50.1)
        assert stop.trouble(50.1) == why
        assert stop.trouble(50.59) == (why or SILENT)  # the process, not the button, was silent
    for why in (lambda stop: stop.wake(9.0, 50.0), lambda stop: stop.count(1, 50.0) or stop.count(0, 50.0)):
        stop = EmergencyStop()
        why(stop)
        assert stop.trouble(50.0) == ""


def test_age_is_that_of_what_was_sent():
    stop = EmergencyStop()
    stop.hear(False, now=60.0, sent=50.0, number=1)
    assert stop.trouble(60.0) == SILENT
    for number, at in enumerate((60.1, 60.4, 60.7), 2):
        stop.hear(False, now=at, sent=99.0, number=number)  # not in the future
    assert stop.trouble(61.19) == ""
    assert stop.trouble(61.21) == SILENT


def test_a_message_of_unknown_age_proves_no_more_than_that_there_is_a_button():
    stop = EmergencyStop()
    stop.hear(False, now=60.0, sent=-math.inf, number=1)
    assert stop.trouble(60.0) == SILENT
    stop.hear(False, now=60.1, number=2)
    assert stop.trouble(60.1) == BACK
    stop.hear(False, now=60.6, number=3)
    assert stop.trouble(60.625) == ""


def test_all_that_was_sent_before_has_been_heard_once_every_button_spoke_since():
    stop = play((50.0, 1), (50.1, 700), (50.3, 2))
    assert stop.spoken_since(50.1)
    assert not stop.spoken_since(50.2)  # the second one's press may still be on its way
    stop.hear(False, now=50.4, number=701)
    assert stop.spoken_since(50.2)


def test_a_button_that_is_started_again_however_soon_may_hide_a_press():
    stop = play((50.0, 1), (50.3, 1), (50.6, 1))
    assert stop.trouble(50.6) == ENDED
    assert stop.spoken_since(50.2)
    for at in (50.8, 51.0, 51.2, 51.4):
        stop.hear(False, now=at, number=round(5 * at) - 252)
    assert stop.refusal(51.55, publishers=1) == ""


@pytest.mark.parametrize("number", [None, 2**64 - 1])  # the middleware's "not supported"
def test_without_numbers_all_are_one(number):
    stop = EmergencyStop()
    for k in range(10):
        stop.hear(False, now=50.0 + 0.1 * k, number=number)
    assert stop.refusal(51.0, publishers=1) == ""
    assert stop.refusal(51.0, publishers=2) == "1 of 2 publishers of the emergency stop are not heard"
    assert stop.trouble(51.41) == SILENT
