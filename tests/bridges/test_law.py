"""The guard's law, in schedules that hypothesis draws: senders, buttons, gaps, delays, floods and clocks, in any order.

**No motion later than 0.4 s after the newest command that was sent, nor than 0.5 s after the newest measurement on which it
rests, none after a press until enabled again, none while a known
button is silent, none while disabled, none above the limits, no more than 50 messages a second.**
"""

import pytest
from guard_judge import judge
from guard_world import World
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st

COMMANDS = ["send", "teleop", "drive", "drive", "flood", "silence", "enable", "disable", "lose", "backlog"]
KINDS = [*COMMANDS, "button", "button", "end", "press", "release", "suspend", "surprise", "jump", "swallow"]
BUTTONS = ["drive", "button", "end", "press", "release", "enable", "suspend", "surprise", "swallow", "radio", "radio"]
"""What happens to buttons, which hardly any schedule of all kinds has at the right moments."""


def schedules(kinds):
    events = st.tuples(st.sampled_from(kinds), st.integers(0, 7), st.integers(0, 9))
    return st.lists(events, min_size=4, max_size=16)


def search(check, number, *, draw, kinds):
    """Let hypothesis draw so many schedules, the same for the same draw."""
    how = {"database": None, "deadline": None, "suppress_health_check": list(HealthCheck)}
    options = settings(max_examples=number, phases=[Phase.generate, Phase.shrink], **how)
    seed(draw)(options(given(schedules(kinds))(check)))()


DAILY = 300
"""Schedules of a day's search."""


NIGHTLY = [pytest.param(KINDS, 1000, share, marks=pytest.mark.slow) for share in range(10)]
"""1,000 schedules in each share: 10,000 in all."""


@pytest.mark.parametrize(
    ("kinds", "number", "share"),
    [(KINDS, DAILY, 0), *NIGHTLY, (BUTTONS, DAILY, 0), pytest.param(BUTTONS, 1000, 0, marks=pytest.mark.slow)],
)
def test_the_law_holds(kinds, number, share):
    moved = []

    def check(schedule):
        scale = 0.5 if share in (6, 7) else 1.0
        world = World(schedule, start=1234.5 + 77.7 * share, start_enabled=share < 8, speed_scale=scale)
        moved.append(any((v, omega) != (0.0, 0.0) for _, v, omega in world.log.told))
        assert not judge(world.log)

    search(check, number, draw=share, kinds=kinds)
    assert len(moved) >= number
    assert sum(moved) > 0.1 * len(moved)  # a guard that lets nothing pass would keep the law too
