"""State machine that decides whether a node may move the robot; it does not depend on ROS and takes the time as an argument.

    silent --step--> active --stop--> stopping (one second of zeros) --> silent
                       ^                  |
                       +------step--------+

Steps count only while it is enabled. A fault or an emergency stop disables it, and by default it starts disabled. Every stop
issues a new ``ticket``, so that the result of a step that began earlier is recognized and dropped. The rule of the emergency
stop, for any number of buttons, is the guard's: `cmd_vel_guard.emergency`.
"""

from __future__ import annotations

from threading import RLock
from typing import Any

from cmd_vel_guard.emergency import EmergencyStop

STOP_FOR = 1.0
"""Time for which zeros are sent before the topic is released, s ..."""
STOP_PERIOD = 0.05
"""... and their period, s."""


class Safety:
    """The state, with a lock for the threads of steps, watchdog and services; a step longer than ``blocked``, s, is a fault."""

    def __init__(self, *, enabled: bool, blocked: float) -> None:
        self.lock = RLock()
        self.enabled = enabled
        self.phase = "silent"
        self.reason = "no step yet" if enabled else "not enabled"
        self.ticket = object()
        self._blocked = blocked
        self._buttons = EmergencyStop()
        self._stands = ""
        self._began: float | None = None
        self._awake: float | None = None

    @property
    def state(self) -> str:
        """The phase, with the reason why it is not active."""
        return self.phase if self.phase == "active" else f"{self.phase}: {self.reason}"

    def enable(self, *, now: float, buttons: int) -> str | None:
        """Allow motion again, or return why not, by the number of publishers of the emergency stop."""
        with self.lock:
            self._wake(now)
            if why := self._buttons.refusal(now, buttons):
                return why
            if self._began is not None and now - self._began > self._blocked:
                return "the last step is still blocked"
            if not self.enabled:
                self.enabled, self.reason = True, "no step yet"
            return None

    def stop(self, reason: str, *, now: float, disable: bool = False) -> None:
        """Stop until the next step or, if disabled, until enabled again."""
        with self.lock:
            if self.enabled:
                self.reason = reason
            self.enabled = self.enabled and not disable
            self.ticket = object()
            if self.phase == "active":
                self.phase, self._stop_until, self._next_stop = "stopping", now + STOP_FOR, now

    def begin(self, *, now: float) -> object:
        """Record that a step begins, and return its ticket."""
        with self.lock:
            self._began = now
            return self.ticket

    def end(self) -> None:
        """Record that the step has ended."""
        with self.lock:
            self._began = None

    def activate(self, ticket: object) -> bool:
        """Return whether the result of a step may be sent, because no stop occurred since it began."""
        with self.lock:
            if not self.enabled or self._stands or ticket is not self.ticket:
                return False
            self.phase = "active"
            return True

    def hear_emergency(self, pressed: bool, *, now: float, **message: Any) -> None:
        """Process a message of an emergency-stop button; the arguments are those of `EmergencyStop.hear`."""
        with self.lock:
            self._wake(now)
            self._buttons.hear(pressed, now=now, **message)
            if pressed:
                self.stop("emergency stop", now=now, disable=True)

    def count_buttons(self, publishers: int, *, now: float) -> None:
        """Take the current number of publishers of the emergency stop."""
        with self.lock:
            self._buttons.count(publishers, now)

    def _wake(self, now: float) -> None:
        self._buttons.wake(0.0 if self._awake is None else now - self._awake, now)
        self._awake = now

    def tick(self, *, now: float) -> bool:
        """Check for blocked steps and the emergency stop, and return whether a stop must be sent now."""
        with self.lock:
            self._wake(now)
            if self._began is not None and now - self._began > self._blocked and self.enabled:
                self.stop(f"fault: a step takes longer than {self._blocked} s", now=now, disable=True)
            self._stands = self._buttons.trouble(now)
            if self._stands and self.enabled:
                self.stop(self._stands, now=now, disable=bool(self._buttons.lost(now)))
            if self.phase != "stopping" or now < self._next_stop:
                return False
            if now >= self._stop_until:
                self.phase = "silent"
                return False
            self._next_stop = now + STOP_PERIOD
            return True
