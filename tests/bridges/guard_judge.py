"""The judge of the commands to the wheels: it reads the log of what was truly sent, pressed and allowed, and holds the law."""

import math
from dataclasses import dataclass, field
from itertools import pairwise

EPSILON = 1e-6


@dataclass
class Log:
    """The true history."""

    # made, latest time at which it may move the robot, when it may first be obeyed, is motion
    commands: list = field(default_factory=list)
    told: list = field(default_factory=list)  # to the wheels: time, v, omega
    held: list = field(default_factory=list)  # by the wheels after each cycle of a running guard: time, v, omega
    presses: list = field(default_factory=list)  # when a true message was there for the guard to see
    spoken: dict = field(default_factory=dict)  # by button: when there, made, pressed of each message
    enabled: list = field(default_factory=list)  # time, on of each call that was accepted


def judge(log):
    """Return the clauses of the law that were broken, with the time."""
    return [
        *(f"{t:.3f} s: {why}" for t, v, omega in log.held if (v, omega) != (0.0, 0.0) for why in moving(log, t)),
        *limits(log.told),
        *rate(log.told),
        *releases(log),
    ]


def moving(log, t):
    """Return why the wheels must not turn at a time."""
    since, on = max(((at, on) for at, on in log.enabled if at <= t), default=(-math.inf, True))
    if not on:
        yield "motion while disabled"
    if not any(
        motion and since <= made + 1e-4 and first <= t <= until + EPSILON for made, until, first, motion in log.commands
    ):
        yield "motion without a command of the last 0.4 s"
    released = max((at for at, on in log.enabled if on and at <= t), default=-math.inf)
    if any(released < at <= t for at in log.presses):
        yield "motion after a press"
    for which in silent(log, t):
        yield f"motion although button {which} is silent"
    for which in back(log, t):
        yield f"motion although button {which} was silent until just now"


def there(log, t):
    """Return what was heard of each button until a time, but for those that spoke less than twice after the newest began.

    A button that begins after another has ended cannot be told from the same one started again.
    """
    heard = {which: [message for message in spoken if message[0] <= t] for which, spoken in log.spoken.items()}
    began = [known[0][1] for known in heard.values() if known]
    return {which: known for which, known in heard.items() if known and max(began) <= known[-min(2, len(known))][1]}


def silent(log, t):
    """Return which buttons have said nothing for 0.5 s, of those that were heard six times in time."""
    for which, known in there(log, t).items():
        if sum(at - made < 0.3 for at, made, _ in known) >= 6 and known[-1][1] < t - 0.5 - EPSILON:
            yield which


def back(log, t):
    """Return which buttons were silent for much longer than 0.5 s until less than 0.5 s ago."""
    for which, known in there(log, t).items():
        for before, after in pairwise(known[-9:]):
            if after[1] - before[1] > 0.8 and t - after[0] < 0.5 - EPSILON:
                yield which


def limits(told):
    """The burger's limits, and the acceleration of a start: 2.5 m/s^2 for 0.04 s at most."""
    before = (-math.inf, 0.0, 0.0)
    for t, v, omega in told:
        if abs(v) > 0.2108001 or abs(omega) > 2.6350001 or abs(v) + abs(omega) * 0.08 > 0.2097001:
            yield f"{t:.3f} s: above the limits: {v}, {omega}"
        change = abs(v - before[1]) + abs(omega - before[2]) * 0.08
        if (v, omega) != (0.0, 0.0) and change > 2.5 * min(t - before[0], 0.04) + EPSILON:
            yield f"{t:.3f} s: a wheel changes by {change} m/s in {t - before[0]} s"
        before = t, v, omega


def rate(told):
    """50 Hz: in one second not more than 50, one at either end, and a stop that must not wait."""
    for (first, *_), (last, *_) in zip(told, told[53:], strict=False):
        if last - first < 1.0:
            yield f"{last:.3f} s: 54 messages in {last - first} s"


def releases(log):
    """No button was pressed, or silent, when the guard was enabled."""
    for t, on in log.enabled:
        if on:
            yield from (f"{t:.3f} s: enabled while button {which} was silent" for which in silent(log, t))
            for which, known in there(log, t).items():
                if known[-1][2]:
                    yield f"{t:.3f} s: enabled while button {which} was pressed"
            if any(t - 0.5 + EPSILON < at < t for at in log.presses):
                yield f"{t:.3f} s: enabled within 0.5 s of a press"
