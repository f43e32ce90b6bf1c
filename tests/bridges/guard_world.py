"""A world around the guard's decisions, and a judge of the commands to the wheels.

The world is a schedule played in true time: senders, buttons, a network that delays, a process that is suspended while messages
wait, a system clock that is set. It calls the guard's parts as the node does. The judge knows nothing of them: it reads the log
of what was *truly* sent, pressed and allowed, and what the wheels received, and holds the law with literal numbers.
"""

import math
from dataclasses import dataclass, field

from turtlebot_gym.values import Command
from turtlebot_gym_ros.robot import arbiter, sent

TICK = 0.02
COMMANDS = [(0.1, 0.2), (0.15, 0.0), (-0.1, 0.0), (0.0, 1.0), (9.0, -3.0), (0.0, 0.0), (math.nan, 0.1), (0.0, 1e9)]
STAMPS = ["none", "set", "simulated", "minute", "ahead", "behind", "unset"]
"""What the sender's times say: no header, a good one, one of a simulation, one a minute old; a computer whose clock is 5 s
ahead (its times tell nothing) or 0.2 s behind; no source time at all."""
JUMPS = [-7200.0, -30.0, -1.0, -0.3, 0.05, 0.3, 1.0, 30.0, 7200.0]


@dataclass
class Message:
    """A message in transit."""

    at: float
    """Time of arrival."""
    topic: str
    value: object
    stamp: str
    made: float
    """True time of sending."""
    source: float
    header: float
    number: int = 0
    button: int = -1
    pressed: float = -math.inf
    """When a press by a button that is known counts: as soon as the guard runs."""


@dataclass
class Log:
    """The true history."""

    commands: list = field(default_factory=list)
    """(made, latest time at which it may move the robot, when it may first be obeyed, is motion)"""
    told: list = field(default_factory=list)
    """Commands sent to the wheels: (time, v, omega)."""
    held: list = field(default_factory=list)
    """Command held by the wheels after each cycle of a running guard: (time, v, omega)."""
    presses: list = field(default_factory=list)
    """When a true message was there for the guard to see."""
    spoken: dict = field(default_factory=dict)
    """By button: (when there, made, pressed) of each message."""
    enabled: list = field(default_factory=list)
    """(time, on) of each call that was accepted."""
    refused: list = field(default_factory=list)


class World:
    """Plays a schedule: a list of (kind, a, b), where ``a`` is 0 to 7 and ``b`` 0 to 9."""

    def __init__(self, schedule, start=1234.5, **parameters):
        self.t, self.offset, self.jumped = start, 1.7e9, False
        self.log, self.flying, self.waiting = Log(), [], []
        self.suspended_until = self.held_until = -math.inf
        self.seen = {}
        """Buttons: [number of the last message, pressed, time of the next message, alive, which of all lives]."""
        self.lives = 0
        parameters = arbiter.Parameters(**parameters)
        self.clock = sent.SystemClock()
        self.look()
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
        delay = delays[b % len(delays)] if stamp not in ("ahead", "unset") else 0.005  # of these it cannot be seen
        self.command(topic, COMMANDS[a], stamp, delay)
        self.wait(0.01)

    def teleop(self, a, b):
        self.send(a, b, "teleop")

    def drive(self, a, b):
        """Command at 10 Hz for a while."""
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
        """Start a button, unless it is there."""
        which = a % 3
        if which not in self.seen or not self.seen[which][3]:
            number = (0, 5, 700)[b % 3] if which not in self.seen else 0
            self.lives += 1
            self.seen[which] = [number, False, self.t + 0.011 * which, True, self.lives]
        self.wait(0.08 * b)

    def end(self, a, b):
        """End one of the buttons, while a program drives."""
        alive = [button for button in self.seen.values() if button[3]]
        if alive:
            alive[a % len(alive)][3] = False
            self.drive(1, b)

    def press(self, a, b):
        """Press a button that lives, for 0 to 400 ms, or until it is released."""
        alive = [which for which, button in self.seen.items() if button[3]]
        if alive:
            which = alive[a % len(alive)]
            self.speak(which, True)
            if b < 7:
                self.wait((0.0, 0.0004, 0.003, 0.01, 0.05, 0.2, 0.4)[b])
                self.speak(which, False)

    def release(self, a, b):
        for which, button in self.seen.items():
            if button[3]:
                self.speak(which, False)
        self.wait(0.06 * b)

    def enable(self, a, b, on=True):
        if self.t < self.suspended_until:
            return
        answer = self.guard.enable(on, self.look(), buttons=sum(button[3] for button in self.seen.values()))
        (self.log.refused if answer else self.log.enabled).append((self.t, on))
        self.step()
        self.wait(0.02 * b)

    def disable(self, a, b):
        self.enable(a, b, on=False)

    def suspend(self, a, b):
        """Stop the guard's process while all others go on."""
        self.suspended_until = max(self.suspended_until, self.t) + (0.03, 0.09, 0.15, 0.35, 0.45, 0.7, 1.2, 3.0)[a]
        if a > 1:  # what the buttons said comes a little after the guard is back
            self.held_until = self.suspended_until + (0.0, 0.03, 0.09)[b % 3]

    def backlog(self, a, b):
        """Let commands from two sources wait while the guard is suspended, and end."""
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

    def jump(self, a, b):
        """Set the system clock, but not twice between two checks of the guard, which could not detect the time in between."""
        if not self.jumped:
            self.jumped = True
            self.offset += JUMPS[(a + 8 * b) % 9]
        self.wait(0.03)

    # How it happens.

    def command(self, topic, value, stamp, delay):
        system = self.t + self.offset + {"ahead": 5.0, "behind": -0.2}.get(stamp, 0.0)
        header = {"set": system, "simulated": self.t - 1200.0, "minute": system - 60.0}.get(stamp, 0.0)
        source = 0.0 if stamp == "unset" else system
        self.flying.append(Message(self.t + delay, topic, Command(*value), stamp, self.t, source, header))

    def speak(self, which, pressed):
        button = self.seen[which]
        button[0] += 1
        button[1], button[2] = pressed, self.t + 0.1
        message = Message(self.t + 0.0002, "button", pressed, "none", self.t, self.t + self.offset, 0.0, button[0], button[4])
        if button[4] in self.log.spoken:
            message.pressed = max(message.at, self.suspended_until)
        self.flying.append(message)

    def wait(self, duration):
        """Advance true time, with all events in order."""
        end = self.t + duration
        while True:
            buttons = [(button[2], which) for which, button in self.seen.items() if button[3]]
            soonest = min(buttons, default=(math.inf, 0))
            message = min(self.flying, key=lambda each: each.at, default=None)
            arrives = math.inf if message is None else message.at
            tick = max(self.next_tick, self.suspended_until)
            self.t = max(self.t + 1e-7, min(end, soonest[0], arrives, tick))  # no two things at the same moment
            if self.t >= end:
                return
            if soonest[0] <= self.t:
                self.speak(soonest[1], self.seen[soonest[1]][1])
            elif arrives <= self.t:
                self.flying.remove(message)
                self.arrive(message)
            else:
                self.turn()

    def arrive(self, message):
        if message.topic != "button":  # depth 1: the latest is kept
            self.waiting = [each for each in self.waiting if each.topic != message.topic]
        self.waiting.append(message)
        if self.t >= self.suspended_until and (message.topic != "button" or self.t >= self.held_until):
            message.at = self.t
            self.take(message)
            self.step()

    def turn(self):
        """A tick; the first one after a suspension finds the backlog, in random order."""
        self.next_tick = self.t + TICK
        order = round(self.t * 1e6) % 3
        commands = [each for each in self.waiting if each.topic != "button"]
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
        """Hand a message to the guard, as the node does."""
        self.waiting.remove(message)
        now, log, seen = self.look(), self.log, self.t
        arrival = message.at + self.offset
        age = self.clock.age(steady=now, source=message.source, arrival=arrival, header=message.header)
        if message.topic == "button":
            log.spoken.setdefault(message.button, []).append((seen, message.made, message.value))
            if message.value:
                log.presses.append(message.pressed if message.pressed > -math.inf else seen)
            self.guard.hear_emergency(message.value, now, sent=now - age.seconds, dated=age.dated, number=message.number)
        else:
            made = message.made - (60.0 if message.stamp == "minute" else 0.0)
            # A message without its own time may be older than it seems: by its delay, and by a gap too short to be detected.
            lasts = 0.4 + (0.2 if message.stamp in ("ahead", "unset") else 0.0)
            v, omega = message.value
            log.commands.append((made, made + lasts, seen, math.isfinite(v + omega) and (v, omega) != (0.0, 0.0)))
            self.guard.hear(message.topic, message.value, now, sent=now - age.seconds, dated=age.dated)

    def step(self):
        for message in [each for each in self.waiting if each.topic == "button" and self.t >= self.held_until]:
            message.at = self.t
            self.take(message)
        command = self.guard.step(self.look())
        if command is not None:
            self.last = tuple(command)
            self.log.told.append((self.t, *command))
        self.log.held.append((self.t, *self.last))
