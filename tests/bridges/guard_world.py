"""A world around the guard's decisions, whose log a judge reads who knows nothing of them.

The world is a schedule played in true time: senders, buttons, a network that delays, loses and holds back, a guard that is
suspended while messages wait, a system clock that is set. It calls the guard's parts as its node does.
"""

import math
from dataclasses import dataclass

from burger import Parameters
from guard_judge import EPSILON, Log

from cmd_vel_guard import arbiter, sent
from turtlebot_gym.values import Command

TICK = 0.02
COMMANDS = [(0.1, 0.2), (0.15, 0.0), (-0.1, 0.0), (0.0, 1.0), (9.0, -3.0), (0.0, 0.0), (math.nan, 0.1), (0.0, 1e9)]
STAMPS = ["none", "set", "simulated", "minute", "old", "behind", "unset"]
"""What the sender's times say: no header, that of a fresh measurement, one of a simulation, measurements of a minute and of
0.2 s ago; a computer whose clock is 0.2 s behind; no source time at all."""
JUMPS = [-7200.0, -30.0, -1.0, -0.3, 0.05, 0.3, 1.0, 30.0, 7200.0]


@dataclass
class Message:
    """A message in transit."""

    at: float  # of arrival
    topic: str
    value: object
    stamp: str
    made: float  # true time of sending ...
    measured: float  # ... and of the measurement on which it rests
    source: float
    header: float
    number: int = 0
    button: int = -1
    pressed: float = -math.inf  # when a press by a button that is known counts: as soon as the guard runs
    prompt: bool = False  # whether it is not awaited: a button's messages are heard twice


class World:
    """Plays a schedule: a list of (kind, a, b), where ``a`` is 0 to 7 and ``b`` 0 to 9."""

    def __init__(self, schedule, start=1234.5, **parameters):
        self.t, self.offset, self.jumped = start, 1.7e9, False
        self.log, self.flying, self.waiting = Log(), [], []
        self.suspended_until = self.held_until = -math.inf
        self.seen = {}
        """Buttons: [number of the last message, pressed, time of the next message, alive, which of all lives]."""
        # All buttons, how many of their next messages are lost, and by lost press its number, and when the one before was sent.
        self.lives, self.swallowing, self.swallowed = 0, 0, {}
        # Until when a lost message holds up the next ones, how many prompt ones are lost, when the last of either kind came.
        self.radio_until, self.in_the_air, self.came = -math.inf, 0, {True: -math.inf, False: -math.inf}
        parameters = Parameters(**parameters)
        self.clock = sent.SystemClock()
        self.look()
        self.losing = 0
        self.ages = {topic: sent.Ages(self.clock) for topic in ("program", "teleop", "button")}
        self.guard = arbiter.Arbiter(parameters, self.t)
        if not parameters.start_enabled:
            self.log.enabled.append((self.t, False))
        self.last = (0.0, 0.0)
        self.next_tick = self.t
        for kind, a, b in schedule:
            getattr(self, kind)(a, b)
        self.wait(0.6)

    # What happens: a schedule's kinds.

    def send(self, a, b, topic="program", delays=(0.0, 0.001, 0.005, 0.3, 0.9)):
        stamp = STAMPS[(a + b) % 7]
        delay = delays[b % len(delays)] if stamp != "unset" else 0.005  # of which it cannot be seen
        self.command(topic, COMMANDS[a], stamp, delay)
        self.wait(0.01)

    def teleop(self, a, b):
        self.send(a, b, "teleop")

    def drive(self, a, b):
        for _ in range(2 + b):
            self.command("program", COMMANDS[a], "set", 0.001)
            self.wait(0.1)

    def flood(self, a, b):
        for k in range(40):
            self.command("program", COMMANDS[(a + k % (1 + b % 3)) % 8], "set", 0.0)
            self.wait(0.0007)

    def silence(self, a, b):
        self.wait((0.03, 0.2, 0.39, 0.41, 0.55, 1.3)[(a + b) % 6])

    def button(self, a, b):
        which = a % 3
        if which not in self.seen or not self.seen[which][3]:
            number = (0, 5, 700)[b % 3] if which not in self.seen else 0
            self.lives += 1
            self.seen[which] = [number, False, self.t + 0.011 * which, True, self.lives]
        self.wait(0.08 * b)

    def end(self, a, b):
        alive = [button for button in self.seen.values() if button[3]]
        if alive:
            alive[a % len(alive)][3] = False
            self.drive(1, b)

    def press(self, a, b):
        alive = [which for which, button in self.seen.items() if button[3]]
        if alive:
            which = alive[a % len(alive)]
            self.speak(which, True)
            if b < 7:
                self.wait((0.0, 0.0004, 0.003, 0.01, 0.05, 0.2, 0.4)[b])
                self.speak(which, False)

    def swallow(self, a, b):
        self.swallowing = 1 + a
        self.press(a, b)
        self.drive(1, 3)

    def radio(self, a, b):
        self.in_the_air, self.radio_until = (2, 2, 3, 4, 7, 11, 16, 60)[a], self.t + (0.1, 0.3, 0.6, 1.2, 3.0)[b % 5]
        if b > 4:
            self.press(a, a % 4)
        self.drive(1, b)

    def release(self, a, b):
        for which, button in self.seen.items():
            if button[3]:
                self.speak(which, False)
        self.wait(0.06 * b)

    def enable(self, a, b, on=True):
        if self.t < self.suspended_until:
            return
        if on:
            self.begin()
        answer = self.guard.enable(on, self.look(), buttons=sum(button[3] for button in self.seen.values()))
        if not answer:
            self.log.enabled.append((self.t, on))
        self.step()
        self.wait(0.02 * b)

    def disable(self, a, b):
        self.enable(a, b, on=False)

    def suspend(self, a, b):
        self.suspended_until = max(self.suspended_until, self.t) + (0.03, 0.09, 0.15, 0.35, 0.45, 0.7, 1.2, 3.0)[a]
        if a > 1:  # what the buttons said comes a little after the guard is back
            self.held_until = self.suspended_until + (0.0, 0.03, 0.09)[b % 3]

    def backlog(self, a, b):
        self.command("program", COMMANDS[a], STAMPS[b % 7], 0.0)
        self.wait(0.03)
        self.suspend(a, b)
        for topic, stamp in (("program", a + b), ("teleop", b)):
            self.command(topic, COMMANDS[a], STAMPS[stamp % 7], 0.0)
        self.wait(1.0)

    def surprise(self, a, b):
        """Press a button while the guard is suspended and a program commands; the press may arrive after the command."""
        self.drive(1, 0)
        self.suspend(2 + a % 3, b)
        self.press(a, b % 4)
        self.drive(0, 4)

    def lose(self, a, b):
        self.losing = a + 1
        self.drive(1, b)

    def jump(self, a, b):
        """Set the system clock, but not twice between two checks of the guard, which could not detect the time in between."""
        if not self.jumped:
            self.jumped = True
            self.offset += JUMPS[(a + 8 * b) % 9]
        self.wait(0.03)

    # How it happens.

    def begin(self):
        for ages in self.ages.values():
            ages.begin()

    def lost(self):
        self.losing = max(0, self.losing - 1)
        return self.losing % 2 == 1

    def command(self, topic, value, stamp, delay):
        system, back = self.t + self.offset, {"minute": 60.0, "old": 0.2}.get(stamp, 0.0)
        system -= 0.2 if stamp == "behind" else 0.0
        header = {"simulated": self.t - 1200.0}.get(stamp, system - back if stamp in ("set", "minute", "old") else 0.0)
        source = 0.0 if stamp == "unset" else system
        if not self.lost():
            times = self.t, self.t - back, source, header
            self.flying.append(Message(self.t + delay, topic, Command(*value), stamp, *times))

    def speak(self, which, pressed):
        button = self.seen[which]
        button[0] += 1
        button[1], button[2] = pressed, self.t + 0.1
        if self.swallowing:
            self.swallowing -= 1
            if pressed and button[4] in self.log.spoken:
                self.swallowed.setdefault(button[4], (button[0], self.log.spoken[button[4]][-1][1]))
            return
        self.in_the_air = max(0, self.in_the_air - 1)
        for prompt in (True, False)[bool(self.in_the_air) :]:
            at = self.t + 0.0002 if prompt else max(self.t, self.radio_until) + 0.0003
            self.came[prompt] = at = max(at, self.came[prompt] + 1e-6)  # one after the other, each at a moment of its own
            message = Message(at, "button", pressed, "none", self.t, self.t, self.t + self.offset, 0.0)
            message.number, message.button, message.prompt = button[0], button[4], prompt
            if button[4] in self.log.spoken:
                message.pressed = max(message.at, self.suspended_until)
            self.flying.append(message)

    def wait(self, duration):
        end = self.t + duration
        while True:
            buttons = [(button[2], which) for which, button in self.seen.items() if button[3]]
            soonest = min(buttons, default=(math.inf, 0))
            message = min(self.flying, key=lambda each: each.at, default=None)
            arrives = math.inf if message is None else message.at
            event = min(end, soonest[0], arrives)
            while True:  # ticks, which add no events, until the next one; no two things happen at the same moment
                self.t = max(self.t + 1e-7, min(event, max(self.next_tick, self.suspended_until)))
                if self.t >= event:
                    break
                self.turn()
            if self.t >= end:
                return
            if soonest[0] <= self.t:
                self.speak(soonest[1], self.seen[soonest[1]][1])
            elif arrives <= self.t:
                self.flying.remove(message)
                self.arrive(message)

    def arrive(self, message):
        if message.topic != "button":  # depth 1: the latest is kept
            self.waiting = [waiting for waiting in self.waiting if waiting.topic != message.topic]
        self.waiting.append(message)
        if self.t >= self.suspended_until and (message.topic != "button" or self.t >= self.held_until):
            message.at = self.t
            self.take(message)
            self.step()

    def turn(self):
        """A tick; the first one after a suspension finds the backlog, in random order, but nothing older than 2 s."""
        self.next_tick = self.t + TICK
        for message in [waiting for waiting in self.waiting if waiting.topic == "button" and self.t - waiting.made > 2.0]:
            self.waiting.remove(message)
            if message.value and message.pressed > -math.inf:  # of a button that is known
                self.log.presses.append(self.t)
        order = round(self.t * 1e6) % 3
        commands = [waiting for waiting in self.waiting if waiting.topic != "button"]
        for message in commands[:: 1 if order else -1][: order or None]:
            message.at = self.t
            self.take(message)
            self.step()  # which looks at all that the buttons have said
        self.step()

    def look(self):
        self.jumped = False
        self.clock.look(system=self.t + self.offset, steady=self.t)
        return self.t

    def take(self, message):
        self.waiting.remove(message)
        now, log, seen = self.look(), self.log, self.t
        arrival = message.at + self.offset
        age = self.ages[message.topic].age(steady=now, source=message.source, arrival=arrival, header=message.header)
        if message.topic == "button":
            spoken = log.spoken.setdefault(message.button, [])
            if not spoken or message.made > spoken[-1][1]:
                spoken.append((seen, message.made, message.value))
            number, before = self.swallowed.get(message.button, (math.inf, 0.0))
            if message.number > number and not message.prompt:  # the gap in its numbers says so
                del self.swallowed[message.button]
                if message.made > before + 0.5 + EPSILON:
                    log.presses.append(seen)
            if message.value:
                log.presses.append(message.pressed if message.pressed > -math.inf else seen)
            times = {"sent": now - age.sent, "dated": age.dated}
            self.guard.hear_emergency(message.value, now, **times, number=message.number, prompt=message.prompt)
        else:
            # A message without its own time may be older than it seems: by its delay, and by a gap too short to be detected.
            until = min(message.made + 0.4, message.measured + 0.5) + (0.2 if message.stamp == "unset" else 0.0)
            v, omega = message.value
            log.commands.append((message.made, until, seen, math.isfinite(v + omega) and (v, omega) != (0.0, 0.0)))
            times = {"sent": now - age.sent, "measured": now - age.measured}
            self.guard.hear(message.topic, message.value, now, **times, dated=age.dated)

    def step(self):
        for message in [waiting for waiting in self.waiting if waiting.topic == "button" and self.t >= self.held_until]:
            message.at = self.t
            self.take(message)
        command = self.guard.step(self.look())
        if command is not None:
            self.last = tuple(command)
            self.log.told.append((self.t, *command))
        self.log.held.append((self.t, *self.last))
