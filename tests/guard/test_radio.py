"""A button on a radio that loses messages: half an hour without a press, presses, outages; Fast DDS as measured.

A reliable reader gets each message in order. One that is lost is sent again when the publisher's history is full, by its depth,
or with the next heartbeat, every 3 s; a history of one message keeps none, and a gap in the numbers remains. A reader at best
effort gets at once whatever is not lost.
"""

import math
import random

import pytest

from cmd_vel_guard.emergency import EmergencyStop

HEARTBEAT, AIR, TICK = 3.0, 0.002, 0.02


def messages(hz, depth, duration, *, loss, pressed, outages=(), draw=0):
    """Yield what is heard: (when, sent, number, prompt, pressed), sorted."""
    chance, arrived, heard = random.Random(draw), 0.0, []
    for number in range(1, round(duration * hz) + 1):
        sent = number / hz
        value = pressed(sent)
        cut = next((end for start, end in outages if start <= sent < end), None)
        lost = cut is not None or chance.random() < loss
        if not lost:
            heard.append((sent + AIR, sent, number, True, value))
        elif depth == 1:
            continue
        again = sent
        while lost:  # each time it is sent again it may be lost again
            again = min(again + (depth / hz if again == sent else HEARTBEAT), HEARTBEAT * math.ceil(again / HEARTBEAT + 1e-9))
            if cut is not None and number <= round(cut * hz) - depth:
                break
            lost = again < (cut or 0.0) or chance.random() < loss
        if not lost:  # otherwise it is overwritten
            arrived = max(arrived + 1e-9, again + AIR)
            heard.append((arrived, sent, number, False, value))
    return sorted(heard)


def drive(heard, duration):
    """Return when the robot began to stand, and from when to when it was stopped until enabled, which is done at once."""
    stop, stands, stops, latched, at = EmergencyStop(), [], [], False, 0
    stood = False
    for k in range(round(duration / TICK)):
        now = k * TICK
        pressed = False
        while at < len(heard) and heard[at][0] <= now:
            when, sent, number, prompt, value = heard[at]
            stop.hear(value, now=when, sent=sent, number=number, prompt=prompt)
            pressed, at = pressed or value, at + 1
        trouble = stop.trouble(now)
        if trouble and not stood:
            stands.append(now)
        stood = bool(trouble)
        if not latched and (pressed or stop.lost(now)):
            stops.append((now, math.inf))
            latched = True
        elif latched and not stop.refusal(now, 1):
            stops[-1] = stops[-1][0], now
            latched = False
    return stands, stops


def stopped(stops, press):
    """Return after which time a press was a stop, s; infinity if it stopped nothing."""
    return min((max(start - press, 0.0) for start, end in stops if end >= press), default=math.inf)


RADIOS = [(10, 10), (10, 1), (20, 10), (20, 1000), (5, 10)]


@pytest.mark.sample(2)
@pytest.mark.parametrize(("hz", "depth"), RADIOS)
def test_no_press_of_half_a_second_is_lost_in_200(hz, depth):
    pressed = lambda sent: sent % 5.0 < 0.5  # noqa: E731
    _, stops = drive(messages(hz, depth, 1000.0, loss=0.01, pressed=pressed), 1000.0)
    assert max(stopped(stops, 5.0 * k) for k in range(1, 200)) < 0.5


def test_no_press_of_one_message_is_lost_if_the_publisher_keeps_it():
    pressed = lambda sent: round(sent * 10.0) % 80 == 0  # noqa: E731
    _, stops = drive(messages(10, 10, 4000.0, loss=0.01, pressed=pressed), 4000.0)
    late = [stopped(stops, 8.0 * k) for k in range(1, 500)]
    assert max(late) < 7.0
    assert sum(at > 0.1 for at in late) < 15  # one in a hundred was lost at first


@pytest.mark.parametrize("depth", [1, 10])
@pytest.mark.parametrize("outage", [0.2, 0.35, 0.6, 0.9, 3.0])
def test_after_a_short_outage_it_goes_on_by_itself(outage, depth):
    heard = messages(10, depth, 20.0, loss=0.0, pressed=lambda sent: False, outages=[(8.0, 8.0 + outage)])
    stands, stops = drive(heard, 20.0)
    assert len(stands) == (outage > 0.4)
    assert bool(stops) == (outage > 0.4 and (depth == 1 or outage > 1.0))  # messages are lost for good


def test_a_press_in_an_outage_is_a_stop_when_it_is_heard():
    for depth in (1, 10):
        pressed = lambda sent: 8.3 < sent < 8.5  # noqa: E731
        _, stops = drive(messages(10, depth, 20.0, loss=0.0, pressed=pressed, outages=[(8.0, 8.8)]), 20.0)
        assert len(stops) == 1
