"""What the guard decides: who may tell the wheels what. Knows no ROS; steady times come in as arguments.

On the core's pure limits alone, and on nothing of the other nodes; the node around it is in `guard`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from turtlebot_gym.models.unicycle import limit
from turtlebot_gym.robots import ROBOTS
from turtlebot_gym.values import STOP, Command

EMERGENCY_SILENCE = 0.5
"""Silence of a publisher of ``/emergency_stop``, once seen, that is a stop, s."""
POSE_AGE = 0.5
"""Age from which a pose no longer proves that the robot is inside the geofence, s."""
ZEROS = 1.0
"""How long zeros are sent before the silence, s."""


@dataclass(frozen=True, kw_only=True)
class Parameters:
    """Parameters of ``cmd_vel_guard``; none changes while it runs."""

    robot: str = "burger"
    """Preset whose limits hold, per axis and per wheel."""
    enable_stamped_cmd_vel: bool = True
    """Whether velocities are TwistStamped, in and out, as on a Jazzy robot; else Twist."""
    start_enabled: bool = True
    """Whether commands pass from the start on; if not, ``~/enable`` is needed after every (re)start."""
    max_age: float = 0.4
    """Age from which a command no longer counts, s; at most 0.5."""
    rate: float = 50.0
    """How often ages are checked, Hz; 50 to 200."""
    max_acceleration: float = 2.5
    """Limit of each wheel's acceleration at the rim, m/s^2. A stop is never delayed by it."""
    speed_scale: float = 1.0
    """Factor on every command, in (0, 1]."""
    geofence: float = 0.0
    """Radius about the origin of the pose's frame beyond which only a person drives, m; 0 is no fence."""
    geofence_topic: str = "odom"
    """Where the pose for the geofence comes from: ``odom`` or ``estimate``."""

    def __post_init__(self) -> None:
        for name, holds, rule in (
            ("robot", self.robot in ROBOTS, f"one of {', '.join(ROBOTS)}"),
            ("max_age", 0.0 < self.max_age <= 0.5, "in (0, 0.5] s"),
            ("rate", 50.0 <= self.rate <= 200.0, "in [50, 200] Hz"),
            ("max_acceleration", self.max_acceleration > 0.0, "positive"),
            ("speed_scale", 0.0 < self.speed_scale <= 1.0, "in (0, 1]"),
            ("geofence", 0.0 <= self.geofence < math.inf, "a radius in m, or 0"),
            ("geofence_topic", self.geofence_topic in ("odom", "estimate"), "odom or estimate"),
        ):
            if not holds:
                raise ValueError(f"parameter {name!r} must be {rule}, got {getattr(self, name)!r}")


class Arbiter:
    """Decide at every moment what the wheels are told; ``now`` is a steady time, s."""

    def __init__(self, parameters: Parameters, now: float) -> None:
        self._p = parameters
        self._robot = ROBOTS[parameters.robot]
        self._heard: dict[str, tuple[float, Command]] = {}
        self._news = ""
        self._last, self._then = STOP, now
        self._zeros_until = now + ZEROS
        self._emergency: tuple[float, bool] | None = None
        self._distance = (-math.inf, math.inf)
        self.enabled = parameters.start_enabled
        self.emergency = False
        self.state = "stopped"
        self.refused = 0

    def hear(self, source: str, command: Command, now: float) -> None:
        """Take a command from ``teleop`` or ``program``; one that is not finite counts as a stop."""
        if not math.isfinite(command.v + command.omega):
            command, self.refused = STOP, self.refused + 1
        self._heard[source], self._news = (now, command), source

    def hear_emergency(self, pressed: bool, now: float) -> None:
        """Take the state of the emergency stop."""
        self._emergency = now, pressed
        self.emergency |= pressed

    def locate(self, x: float, y: float, now: float) -> None:
        """Take the robot's position, m."""
        self._distance = now, math.hypot(x, y)

    def greet(self, now: float) -> None:
        """Send zeros to a robot that has just connected, unless it is commanded: it may hold an older command."""
        self._zeros_until = now + ZEROS

    def enable(self, on: bool, now: float) -> str:
        """Let commands pass that come from now on, or stop; return why it is refused, or nothing."""
        if on and self._emergency is not None:
            heard, pressed = self._emergency
            if pressed or now - heard > EMERGENCY_SILENCE:
                return f"the emergency stop is {'pressed' if pressed else 'silent'}"
        if on:
            self.emergency = False
        self.enabled = on
        self._heard.clear()
        self._zeros_until = now + ZEROS
        return ""

    def step(self, now: float) -> Command | None:
        """Return what to publish now; nothing if nobody commands or nothing has changed."""
        # A process that was suspended knows neither how old is what it hears now, nor what the wheels have held meanwhile ...
        if now - self._then > self._p.max_age:
            self._heard.clear()
            self._zeros_until = now + ZEROS
        # ... and must not make up for it by one large step of the ramp.
        dt, self._then = min(now - self._then, 2.0 / self._p.rate), now
        if self._emergency is not None and now - self._emergency[0] > EMERGENCY_SILENCE:
            self.emergency = True
        target = self._target(now)
        news, self._news = self._news == self.state, ""
        if target is None:
            self._last = STOP
            if self.emergency:
                self.state = "emergency"
            elif now >= self._zeros_until:
                self.state = "silent" if self.enabled else "disabled"
                return None
            return STOP
        self._zeros_until = now + ZEROS
        command = self._ramp(target, dt)
        if command == self._last and not news:
            return None
        self._last = command
        return command

    def _target(self, now: float) -> Command | None:
        """Return the command in force, within the limits; sets the state."""
        self.state = "stopped"
        if self.emergency or not self.enabled:
            return None
        for source in ("teleop", "program"):
            heard, command = self._heard.get(source, (-math.inf, STOP))
            if now - heard > self._p.max_age:
                continue
            self.state = source
            if source == "program" and self.outside(now):
                return STOP
            v, omega = limit(command, self._robot)
            return Command(v * self._p.speed_scale, omega * self._p.speed_scale)
        return None

    def outside(self, now: float) -> bool:
        """Return whether there is a geofence that the robot is not known to be inside of."""
        measured, distance = self._distance
        return self._p.geofence > 0.0 and not (now - measured <= POSE_AGE and distance <= self._p.geofence)

    def _ramp(self, target: Command, dt: float) -> Command:
        """Move from the last command straight towards the target, which keeps the curvature of a start and of braking."""
        dv, domega = target.v - self._last.v, target.omega - self._last.omega
        wheel = abs(dv) + abs(domega) * self._robot.wheel_separation * 0.5
        if target == STOP or wheel <= self._p.max_acceleration * dt:
            return target
        share = self._p.max_acceleration * dt / wheel
        return Command(self._last.v + share * dv, self._last.omega + share * domega)
