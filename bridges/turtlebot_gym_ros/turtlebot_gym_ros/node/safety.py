"""State machine that decides whether a node may move the robot; it does not depend on ROS and takes the time as an argument.

    silent --step--> active --stop--> stopping (one second of zeros) --> silent
                       ^                  |
                       +------step--------+

Steps count only while it is enabled. A fault and an emergency stop disable it; so it starts, unless told otherwise. Whatever
stops it makes a new ``ticket``, so that the result of a step that began before can be told and dropped. The rule of the
emergency stop, for any number of buttons, is the guard's: `turtlebot_gym_ros.robot.emergency`.
"""

from __future__ import annotations

from threading import RLock

from turtlebot_gym_ros.robot.emergency import EmergencyStop

STOP_FOR = 1.0
"""So long are zeros sent before the topic is left to others, s ..."""
STOP_PERIOD = 0.05
"""... with this period, s."""


class Safety:
    """The state, with a lock for the threads that step, watch and serve.

    Args:
        enabled: Whether it starts enabled.
        blocked: A step that takes longer is a fault, s; infinite where no step can take too long.
    """

    def __init__(self, *, enabled: bool, blocked: float) -> None:
        self.lock = RLock()
        self.enabled = enabled
        self.phase = "silent"
        self.reason = "no step yet" if enabled else "not enabled"
        self.ticket = object()
        self._blocked = blocked
        self._buttons = EmergencyStop()
        self._began: float | None = None

    @property
    def state(self) -> str:
        """The phase, and in words what keeps it from being active."""
        return self.phase if self.phase == "active" else f"{self.phase}: {self.reason}"

    def enable(self, *, now: float, buttons: int) -> str | None:
        """Let it move the robot again, or return why not.

        Args:
            now: The present, a steady time, s.
            buttons: How many publishers the emergency stop has.
        """
        with self.lock:
            if why := self._buttons.refusal(now, buttons):
                return why
            if self._began is not None and now - self._began > self._blocked:
                return "the last step is still blocked"
            if not self.enabled:
                self.enabled, self.reason = True, "no step yet"
            return None

    def stop(self, reason: str, *, now: float, disable: bool = False) -> None:
        """Stop, until the next step or, where disabled, until enabled again."""
        with self.lock:
            if self.enabled:
                self.reason = reason
            self.enabled = self.enabled and not disable
            self.ticket = object()
            if self.phase == "active":
                self.phase, self._stop_until, self._next_stop = "stopping", now + STOP_FOR, now

    def begin(self, *, now: float) -> object:
        """Note that a step begins, and return its ticket."""
        with self.lock:
            self._began = now
            return self.ticket

    def end(self) -> None:
        """Note that the step has ended."""
        with self.lock:
            self._began = None

    def activate(self, ticket: object) -> bool:
        """Return whether the result of a step may be sent: nothing has stopped it since it began."""
        with self.lock:
            if not self.enabled or ticket is not self.ticket:
                return False
            self.phase = "active"
            return True

    def hear_emergency(self, pressed: bool, *, now: float, sent: float | None = None, number: int | None = None) -> None:
        """Note what a button of the emergency stop says; the arguments are those of `EmergencyStop.hear`."""
        with self.lock:
            self._buttons.hear(pressed, now=now, sent=sent, number=number)
            if pressed:
                self.stop("emergency stop", now=now, disable=True)

    def tick(self, *, now: float) -> bool:
        """Watch over blocked steps and the emergency stop, and return whether a stop is to be sent now."""
        with self.lock:
            if self._began is not None and now - self._began > self._blocked and self.enabled:
                self.stop(f"fault: a step takes longer than {self._blocked} s", now=now, disable=True)
            why = self._buttons.trouble(now)
            if why and self.enabled:
                self.stop(why, now=now, disable=True)
            if self.phase != "stopping" or now < self._next_stop:
                return False
            if now >= self._stop_until:
                self.phase = "silent"
                return False
            self._next_stop = now + STOP_PERIOD
            return True
