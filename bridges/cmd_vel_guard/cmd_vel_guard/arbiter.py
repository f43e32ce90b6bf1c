"""The guard's decisions: which command reaches the wheels. Does not depend on ROS and takes steady times as arguments.

The law: **no motion later than** ``max_age`` **after the newest command that was sent, nor than** ``measured_age`` **after the
newest measurement on which it rests, none while any emergency stop is pressed or silent, none while disabled, none above
the limits** (axis, wheel, acceleration of a start), and no more messages than ``rate``; a stop is never delayed, neither by the
ramp nor by the rate. If the collision monitor is switched on, see `monitor`, it has the last word on every command, whoever
sent it: it can slow a command down but never speed it up.

The ages of commands are those of `sent`. The rule of the emergency stop is in `emergency`. The arbiter builds only on
these and on the robot's limits; the node around it is in `guard`.
"""

from __future__ import annotations

from collections.abc import Callable
from math import hypot, inf, isfinite
from typing import Any, NamedTuple

from cmd_vel_guard.collision import RawScan
from cmd_vel_guard.emergency import EmergencyStop
from cmd_vel_guard.moved import Moved
from cmd_vel_guard.parameters import Parameters, monitor_of
from cmd_vel_guard.values import STOP, Command, Pose, limit

POSE_AGE = 0.5
"""Age at which a pose no longer proves that the robot is inside the geofence, s."""
ZEROS = 1.0
"""Time for which zeros are sent before silence, s."""
GAP = 0.1
"""Time between two calls above which the guard counts as having been suspended or starved, s."""
REPEAT = 0.05
"""Time after which a motion in force is published again, s: the guard's sign of life for the standby."""
STANDBY_AGE = 0.5
"""Age of the standby's last sign of life at which it no longer counts, s."""
JOINING = 5.0
"""Time after the start in which a new listener may be a robot that holds a command of an earlier guard, s."""
HOLD = 1.0
"""Time for which such a listener gets zeros before any motion, s."""
BLIND = 0.5
"""Time after such a gap in which a backlog may arrive, s: undated messages are refused, and silence is not yet a press."""


class _Heard(NamedTuple):
    """A command, with the steady times of sending and of the measurement on which it rests, s."""

    sent: float
    measured: float
    command: Command


class Arbiter:
    """Decide at every moment which command the wheels receive.

    ``now`` is a steady time, s. Messages also have a time ``sent``, when they were sent at the earliest, ``now`` at most, and a
    flag ``dated``, whether that time is the sender's or only that of their arrival here; commands also a time ``measured``, of
    the measurement on which they rest, ``sent`` at most. ``mount_of`` returns a frame's pose on the robot, see `Monitor`.
    """

    def __init__(self, parameters: Parameters, now: float, mount_of: Callable[[str], Pose | None] = lambda frame: None) -> None:
        self._p = parameters
        self.buttons = EmergencyStop()
        self.monitor = monitor_of(parameters, now, mount_of)
        self.moved = Moved(parameters.wheel_separation)
        self.rivals = ""
        """Which input has more than one source, or an empty text: then it is unknown which one counts, and the robot stands."""
        self._heard: dict[str, _Heard] = {}
        self._news: set[str] = set()
        self._distance = (now, inf)
        self.lost = ""
        """Why the last pose for the geofence does not count, or an empty text."""
        self._awake, self._since, self._blind_until = now, now, now
        self._zeros_until = now + ZEROS
        self._began, self._hold_until, self._standby = now, -inf, -inf
        self._last, self._last_at, self._due, self._halt = STOP, now, now, False
        self.enabled = parameters.start_enabled and not parameters.require_emergency_stop
        self.emergency, self.why = False, ""
        self.state = "stopped"
        self.refused = {"not finite": 0, "too old": 0, "undated after a gap": 0}

    def _wake(self, now: float) -> None:
        """Detect a gap in the guard's own calls, whichever method is called first."""
        gap, self._awake = now - self._awake, now
        self.buttons.wake(gap, now)
        if gap > GAP:
            self._blind_until = now + BLIND
        if gap > self._p.max_age:
            # The ages of messages, and the motion of the wheels meanwhile, are unknown: stop first.
            self._heard.clear()
            self._halt, self._zeros_until = True, now + ZEROS

    def hear(
        self, source: str, command: Command, now: float, *, sent: float = inf, measured: float = inf, dated: bool = True
    ) -> None:
        """Take a command from ``teleop`` or ``program``; one that is not finite counts as a stop."""
        self._wake(now)
        sent = min(sent, now)
        heard = _Heard(sent, min(measured, sent), command)
        if not isfinite(command.v + command.omega):
            heard = heard._replace(command=STOP)
            self.refused["not finite"] += 1
        if not dated and now < self._blind_until:
            self.refused["undated after a gap"] += 1
        elif not self._is_fresh(heard, now):
            self.refused["too old"] += 1
        elif sent >= self._since and (source not in self._heard or sent >= self._heard[source].sent):
            self._heard[source] = heard
            self._news.add(source)

    def _is_fresh(self, heard: _Heard, now: float) -> bool:
        return now - heard.sent <= self._p.max_age and now - heard.measured <= self._p.measured_age

    def hear_emergency(self, pressed: bool, now: float, *, sent: float = inf, dated: bool = True, **message: Any) -> None:
        """Take a button's message. A press always counts; only a message that was certainly sent lately shows that it lives."""
        self._wake(now)
        if pressed:
            self.emergency, self.why = True, "the emergency stop was pressed"
        unproved = not dated and now < self._blind_until
        self.buttons.hear(pressed, now=now, sent=-inf if unproved else sent, **message)

    def halt(self, why: str) -> None:
        """Stop a robot that may move until a person enables it, like an emergency stop."""
        if self.enabled and not self.emergency:
            self.emergency, self.why = True, why

    def hear_odometry(self, pose: Pose, twist: Command, now: float, *, measured: float) -> None:
        """Take odometry, and stop the robot if it does not move as commanded."""
        self._wake(now)
        at = min(measured, now)
        if self.monitor:
            self.monitor.watch.move(twist, at)
        if why := self.moved.hear(pose, twist, at):
            self.halt(why)

    def count_buttons(self, publishers: int, now: float) -> None:
        """Take the current number of publishers of the emergency stop."""
        self._wake(now)
        self.buttons.count(publishers, now)

    def locate(self, x: float, y: float, now: float, *, sent: float = inf, frame: str | None = None) -> None:
        """Take the robot's position, m, in a frame (None: the right one)."""
        self._wake(now)
        wanted = self._p.frame_prefix + self._p.geofence_frame
        self.lost = ""
        if frame not in (None, wanted):
            self.lost = f"its frame is {frame!r}, not {wanted!r}"
        elif not isfinite(x + y):
            self.lost = f"it is at ({x:g}, {y:g})"
        self._distance = min(sent, now), inf if self.lost else hypot(x, y)

    def hear_scan(self, scan: RawScan, now: float, *, sent: float = inf, dated: bool = True) -> None:
        """Take a scan of the collision monitor."""
        self._wake(now)
        if not dated and now < self._blind_until:
            self.refused["undated after a gap"] += 1
        elif self.monitor:
            self.monitor.hear(scan, sent=min(sent, now))

    def hear_standby(self, now: float, *, sent: float) -> None:
        """Take a sign of life of the standby."""
        self._wake(now)
        self._standby = max(self._standby, min(sent, now))

    def lacks_standby(self, now: float) -> bool:
        """Return whether the standby is required and not alive."""
        return self._p.require_standby and now - self._standby > STANDBY_AGE

    def greet(self, now: float) -> None:
        """Send zeros to a robot that has just connected, since it may hold an older command.

        Later than `JOINING` after the start it can only have started itself, and a command in force reaches it at once.
        """
        self._zeros_until = now + ZEROS
        if now - self._began <= JOINING:
            self._hold_until = now + HOLD

    def enable(self, on: bool, now: float, *, buttons: int = 0) -> str:
        """Let commands sent from now on pass, or stop; return why not, by the number of the buttons' publishers."""
        self._wake(now)
        if on and (why := self.buttons.refusal(now, buttons, required=self._p.require_emergency_stop)):
            return why
        if on:
            self.emergency = False
            self.moved.forget()
            if self.monitor:
                self.monitor.watch.forget()
        self.enabled, self._since = on, now
        self._heard.clear()
        self._zeros_until = now + ZEROS
        return ""

    def step(self, now: float) -> Command | None:
        """Return what to publish now; None if there is no command, nothing has changed, or the rate is used up."""
        self._wake(now)
        target = self._target(now)
        if self.monitor:
            self.monitor.state = ""
        if self._halt:
            self._halt, target = False, None
        if target is None:
            if self.emergency:
                self.state = "emergency"
            elif now >= self._zeros_until and self._last == STOP:
                self.state = "silent" if self.enabled else "disabled"
                return None
            return self._paced(STOP, now)
        self._zeros_until = now + ZEROS
        command = self._ramp(target, min(now - self._last_at, 2.0 / self._p.rate))
        if self.monitor:
            command = self.monitor.limit(command, now)
        repeats = command != STOP and now - self._last_at >= REPEAT
        if command == self._last and self.state not in self._news and not repeats:
            return None
        return self._paced(command, now)

    def _paced(self, command: Command, now: float) -> Command | None:
        """Return the command if the rate allows it, or if it stops the wheels."""
        period = 1.0 / self._p.rate
        stops = command == STOP and self._last != STOP
        if now < self._due - 0.5 * period and not stops:
            return None
        self._due = max(self._due, now) + period
        self._last, self._last_at = command, now
        self._news.clear()
        self.moved.tell(command, now)
        if self.monitor:
            self.monitor.track.add(command, now)
        return command

    def _target(self, now: float) -> Command | None:
        """Return the command in force within the limits; sets the state."""
        self.state = "stopped"
        trouble = self.buttons.trouble(now)
        # After a gap of its own the guard stops until it has heard each button again, and with that the whole backlog.
        blind = now < self._blind_until
        if not self.emergency and (why := self.buttons.lost(now)):
            self.emergency, self.why = True, why
        if (
            trouble
            or self.emergency
            or not self.enabled
            or now < self._hold_until
            or self.lacks_standby(now)
            or self.rivals
            or self.moved.lacks(now)
            or (blind and not self.buttons.spoken_since(self._blind_until - BLIND))
        ):
            return None
        for source in ("teleop", "program"):
            heard = self._heard.get(source)
            if heard is None or not self._is_fresh(heard, now):
                continue
            self.state = source
            if source == "program" and self.outside(now):
                return STOP
            v, omega = limit(heard.command, self._p)
            return Command(v * self._p.speed_scale, omega * self._p.speed_scale)
        return None

    def outside(self, now: float) -> bool:
        """Return whether there is a geofence and the robot is not known to be inside it."""
        measured, distance = self._distance
        return self._p.geofence > 0.0 and not (now - measured <= POSE_AGE and distance <= self._p.geofence)

    def _ramp(self, target: Command, dt: float) -> Command:
        """Move from the last command straight towards the target, which keeps the curvature of a start and of braking."""
        dv, domega = target.v - self._last.v, target.omega - self._last.omega
        wheel = abs(dv) + abs(domega) * self._p.wheel_separation * 0.5
        if target == STOP or wheel <= self._p.max_acceleration * dt:
            return target
        share = self._p.max_acceleration * dt / wheel
        return Command(self._last.v + share * dv, self._last.omega + share * domega)
