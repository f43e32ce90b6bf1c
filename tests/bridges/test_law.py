"""The guard's law, in schedules that hypothesis draws: senders, buttons, gaps, delays, floods and clocks, in any order.

**No motion later than 0.4 s after the newest command that was sent, nor than 0.5 s after the newest measurement on which it
rests, none after a press until enabled again, none while a known
button is silent, none while disabled, none above the limits, no more than 50 messages a second.** For each clause there is a
planted defect that the same search finds.
"""

import math
from functools import partialmethod
from types import SimpleNamespace

import pytest
from guard_judge import judge
from guard_world import World
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st

from cmd_vel_guard import arbiter, sent
from cmd_vel_guard.arbiter import Arbiter
from cmd_vel_guard.emergency import EmergencyStop, _Stream
from cmd_vel_guard.parameters import Parameters
from cmd_vel_guard.sent import Age, Ages, SystemClock, _Sender
from turtlebot_gym.values import STOP
from turtlebot_gym_ros.node import feed

KINDS = [
    "send",
    "teleop",
    "drive",
    "drive",
    "flood",
    "silence",
    "button",
    "end",
    "press",
    "release",
    "enable",
    "disable",
    "suspend",
    "backlog",
    "surprise",
    "jump",
    "button",
    "swallow",
    "set_laptop",
    "lose",
    "odometry",
    "odometry",
    "stall",
    "hang",
    "hang",
    "repeat",
    "person",
]
BUTTONS = ["drive", "button", "end", "press", "release", "enable", "suspend", "surprise", "swallow", "radio", "radio"]
"""What happens to buttons, which hardly any schedule of all kinds has at the right moments."""


def schedules(kinds):
    events = st.tuples(st.sampled_from(kinds), st.integers(0, 7), st.integers(0, 9))
    return st.lists(events, min_size=4, max_size=16)


def search(check, number, *, draw=0, shrink=True, kinds=KINDS):
    """Let hypothesis draw so many schedules, the same for the same draw."""
    options = settings(
        max_examples=number,
        database=None,
        deadline=None,
        phases=[Phase.generate, Phase.shrink] if shrink else [Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    seed(draw)(options(given(schedules(kinds))(check)))()


DAILY = 300
"""Schedules of a day's search: enough to find the planted defects, but for a few."""


@pytest.mark.parametrize(
    ("share", "number"), [(0, DAILY), *(pytest.param(k, 1000, marks=pytest.mark.nightly) for k in range(10))]
)
def test_the_law_holds(share, number):
    """1,000 schedules in each share: 10,000 in all. The partner of this test is the last one."""
    moved = []

    def check(schedule):
        world = World(
            schedule, start=1234.5 + 77.7 * share, start_enabled=share < 8, speed_scale=0.5 if share in (6, 7) else 1.0
        )
        moved.append(any((v, omega) != (0.0, 0.0) for _, v, omega in world.log.told))
        assert not judge(world.log)

    search(check, number, draw=share)
    assert len(moved) >= number
    assert sum(moved) > 0.1 * len(moved)  # a guard that lets nothing pass would keep the law too


@pytest.mark.parametrize("number", [DAILY, pytest.param(1000, marks=pytest.mark.nightly)])
def test_the_law_of_the_buttons_holds(number):
    """Schedules of what happens to buttons, on a radio too."""
    moved = []

    def check(schedule):
        world = World(schedule, start_enabled=True)
        moved.append(any((v, omega) != (0.0, 0.0) for _, v, omega in world.log.told))
        assert not judge(world.log)

    search(check, number, kinds=BUTTONS)
    assert sum(moved) > 0.1 * len(moved)


def age_of_arrival(self, *, steady, source=0.0, arrival=0.0, header=0.0):
    came = max(0.0, steady + self._clock.offsets[-1][0] - arrival)
    return Age(came, came, True, "its arrival")


def age_of_source(original):
    def age(self, *, steady, source=0.0, arrival=0.0, header=0.0):
        return original(self, steady=steady, source=source, arrival=arrival, header=0.0)

    return age


def age_of_sending(original):
    def age(self, **times):
        known = original(self, **times)
        return known._replace(measured=known.sent)

    return age


def present_offset_only(original):
    def look(self, *, system, steady):
        original(self, system=system, steady=steady)
        del self.offsets[:-1]

    return look


def all_dated(original):
    def hear(self, source, command, now, *, dated=True, **times):
        original(self, source, command, now, **times)

    return hear


class LastButton:
    """The rule of the first release: the last message counts, whoever sent it."""

    def __init__(self):
        self.at, self.pressed = math.inf, False

    def hear(self, pressed, *, now, sent=None, number=None, prompt=False):
        self.at, self.pressed = now, pressed

    def trouble(self, now):
        return "pressed" if self.pressed else "silent" if now - self.at > 0.5 else ""

    def refusal(self, now, publishers=0, *, required=False):
        return self.trouble(now)

    def spoken_since(self, time):
        return True

    def wake(self, gap, now):
        pass

    def lost(self, now):
        return ""


def one_button(original):
    def hear(self, pressed, *, now, sent=None, number=None, prompt=False):
        original(self, pressed, now=now, sent=sent, prompt=prompt)

    return hear


def a_lost_message_is_none(original):
    return lambda self, why, now: original(self, why, now) if "lost" not in why else None


def a_late_press_is_none(original):
    def hear(self, pressed, now, *, sent=None, **message):
        late = sent is not None and now - sent > 0.5
        original(self, pressed and not late, now, sent=sent, **message)

    return hear


def a_silence_that_is_over_is_forgotten(original):
    def hear(self, pressed, **message):
        original(self, pressed, **message)
        self._back_at = self._back_sent = -math.inf

    return hear


def a_press_that_does_not_latch(original):
    def hear(self, pressed, now, **options):
        before = self.emergency
        original(self, pressed, now, **options)
        self.emergency = before

    return hear


def enable_without_asking(self, on, now, *, buttons=0):
    self.enabled, self.emergency, self._since = on, False, now
    self._heard.clear()
    return ""


def enable_without_forgetting(original):
    def enable(self, on, now, *, buttons=0):
        since, heard = self._since, dict(self._heard)
        why = original(self, on, now, buttons=buttons)
        self._since = since
        self._heard.update(heard)
        return why

    return enable


def disable_nothing(original):
    def enable(self, on, now, *, buttons=0):
        return original(self, on, now, buttons=buttons) if on else ""

    return enable


def no_pace(self, command, now):
    self._last, self._last_at = command, now
    self._news.clear()
    return command


def stops_wait(self, command, now):
    if now < self._due - 0.01:
        return None
    self._due, self._last, self._last_at = max(self._due, now) + 0.02, command, now
    self._news.clear()
    return command


def forget_the_old_speed(original):
    """The defect by which a ramp restarts from the speed before a stop."""

    def step(self, now):
        before = self._last
        command = original(self, now)
        if command == STOP:
            self._last = before
        return command

    return step


def lazy(original):
    """Of a gap only the first callback takes notice, and arrival tells the age: the defect of the first release."""

    def age(self, *, steady, source=0.0, arrival=0.0, header=0.0):
        return Age(0.0, 0.0, True, "its arrival")

    return age


def stamped_now(original):
    """A chain whose commands say when they were made, not when what they rest on was measured: the second release's defect."""
    return lambda feeds, present: present


def at_once(self, original, target, dt):
    return original(self, target, 0.3)


blind = {"isfinite": lambda value: True}

DEFECTS = {
    "old: the age of arrival": (Ages, "age", lambda original: age_of_arrival),
    "old: no age at all": (Ages, "age", lazy),
    "old: the header does not count": (Ages, "age", age_of_source),
    "old: the measurement does not count": (Ages, "age", age_of_sending),
    "old: a lead hides it": (_Sender, "lead", lambda original: lambda self, now, offset: -1e9),
    "old: a lead that has jumped counts at once": (_Sender, "is_unsettled", lambda original: lambda self, now: False),
    "old: a lead is forgotten too soon": (sent, "DRIFT", lambda original: 0.5),
    "old: a command is stamped when it is sent": (feed, "resting_on", stamped_now),
    "old: the clock set back": (SystemClock, "look", present_offset_only),
    "old: undated after a gap": (Arbiter, "hear", all_dated),
    "old: max_age": (Arbiter, "__init__", None),
    "press: only the last button counts": (arbiter, "EmergencyStop", lambda original: LastButton),
    "press: it does not latch": (Arbiter, "hear_emergency", a_press_that_does_not_latch),
    "press: a late one is none": (Arbiter, "hear_emergency", a_late_press_is_none),
    "press: enabled without asking": (Arbiter, "enable", lambda original: enable_without_asking),
    "press: what has waited is not waited for": (EmergencyStop, "spoken_since", lambda original: lambda self, time: True),
    "press: silence is none": (_Stream, "alive", lambda original: lambda self, now: list(self.buttons)),
    "press: a silence that is over is forgotten": (EmergencyStop, "hear", a_silence_that_is_over_is_forgotten),
    "press: lost": (EmergencyStop, "_lose", a_lost_message_is_none),
    "press: all buttons are one": (EmergencyStop, "hear", one_button),
    "disabled: not at all": (Arbiter, "enable", disable_nothing),
    "disabled: what was said before counts": (Arbiter, "enable", enable_without_forgetting),
    "limits: none": (arbiter, "limit", lambda original: lambda command, robot: command),
    "limits: no wheel": (Parameters, "numbers", lambda original: property(lambda self: wheelless(original.fget(self)))),
    "limits: no ramp": (Arbiter, "_ramp", lambda original: lambda self, target, dt: target),
    "limits: a gap of the guard is made up for": (Arbiter, "_ramp", lambda original: partialmethod(at_once, original)),
    "old: what is not finite counts": (arbiter, "math", lambda original: SimpleNamespace(**vars(original) | blind)),
    "limits: the ramp goes on where it was": (Arbiter, "step", forget_the_old_speed),
    "rate: none": (Arbiter, "_paced", lambda original: no_pace),
    "rate: stops wait for it": (Arbiter, "_paced", lambda original: stops_wait),
}


def wheelless(robot):
    return robot._replace(wheel_separation=0.16, max_wheel=math.inf)


def twice_as_old(original):
    def init(self, parameters, now):
        object.__setattr__(parameters, "max_age", 0.8)
        original(self, parameters, now)

    return init


ON_A_RADIO = ("press: a silence that is over is forgotten", "press: a late one is none", "press: lost")
"""Defects that schedules of all kinds find too late."""
LATE = ("old: a lead that has jumped counts at once", "old: the clock set back", "press: lost")
"""Defects that are found after so many schedules that a night finds them."""
DRAWS = {"press: a silence that is over is forgotten": 4}
"""Draws in which a defect is found by day."""
CLAUSES = {
    "old": "motion without a command of the last 0.4 s",
    "press": "press|silent",
    "disabled": "while disabled|without a command",
    "limits": "above the limits|a wheel changes|messages in",
    "rate": "messages in|motion",
}


@pytest.mark.sample(6)
@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.nightly] * (name in LATE)) for name in DEFECTS])
def test_a_planted_defect_is_found(monkeypatch, name):
    owner, attribute, defect = DEFECTS[name]
    monkeypatch.setattr(owner, attribute, (defect or twice_as_old)(getattr(owner, attribute)))

    def check(schedule):
        assert not judge(World(schedule).log)

    with pytest.raises(AssertionError, match=CLAUSES[name.partition(":")[0]]):
        search(
            check,
            2000 if name in LATE else DAILY,
            draw=DRAWS.get(name, 0),
            shrink=False,
            kinds=BUTTONS if name in ON_A_RADIO else KINDS,
        )
