"""Guard of a robot's wheels: the only publisher of ``/cmd_vel``, running on the robot itself.

It stands between whoever commands and the wheels, and shares no code with the shell of the other nodes, so that no fault is
common to both. It bounds what is commanded and stops the robot when nobody commands; it does NO OBSTACLE AVOIDANCE.
**Its own death is not covered**: a TurtleBot3 holds its last command for ever, so a guard that is killed leaves the robot
moving. The launch file respawns it, and a guard's first messages are zeros.

Inputs: ``/cmd_vel_teleop`` (a person; wins while fresh) and ``/cmd_vel_in`` (a program), Twist or TwistStamped;
``/emergency_stop`` (Bool, true is stop, at 5 Hz or more: once seen, 0.5 s of silence is a stop too); with a geofence the
Odometry on ``geofence_topic``. Outputs: ``/cmd_vel``, ``/diagnostics`` (1 Hz), ``~/enabled`` (Bool, latched). Service:
``~/enable`` (SetBool). After an emergency stop the guard sends zeros until it is enabled again, which it refuses while the
stop is pressed or its publisher silent::

    ros2 service call /cmd_vel_guard/enable std_srvs/srv/SetBool "{data: true}"

Parameters: see `Parameters`. All times are taken on the steady clock, so it works with ``use_sim_time`` and no ``/clock``.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import Odometry
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import Bool
from std_srvs.srv import SetBool

from turtlebot_gym.models.unicycle import limit
from turtlebot_gym.parameters import STOP, Command
from turtlebot_gym.robots import ROBOTS
from turtlebot_gym_ros.standalone import declare, run

EMERGENCY_SILENCE = 0.5
"""Silence of a publisher of ``/emergency_stop``, once seen, that is a stop, s."""
POSE_AGE = 0.5
"""Age from which a pose no longer proves that the robot is inside the geofence, s."""
ZEROS = 1.0
"""How long zeros are sent before the silence, s."""

LATEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


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


class Guard:
    """Decide at every moment what the wheels are told. Knows no ROS; ``now`` is a steady time, s."""

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
        # A process that was suspended must not make up for it by one large step of the ramp.
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


class CmdVelGuard(Node):
    """The guard as a node."""

    def __init__(self, context: Context) -> None:
        super().__init__("cmd_vel_guard", context=context, automatically_declare_parameters_from_overrides=True)
        p = declare(self, Parameters)
        self._p, self._guard = p, Guard(p, time.monotonic())
        self._type = TwistStamped if p.enable_stamped_cmd_vel else Twist
        self._velocity = self.create_publisher(self._type, "cmd_vel", QoSProfile(depth=1))
        self._diagnostics = self.create_publisher(DiagnosticArray, "diagnostics", 10)
        self._enabled = self.create_publisher(Bool, "~/enabled", LATCHED)
        self._robots, self._report = 0, ""
        self._hear("cmd_vel_teleop", "teleop")
        self._hear("cmd_vel_in", "program")
        self.create_subscription(Bool, "emergency_stop", self._hear_emergency, LATEST)
        if p.geofence > 0.0:
            self.create_subscription(Odometry, p.geofence_topic, self._locate, LATEST)
        self.create_service(SetBool, "~/enable", self._enable)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(1.0 / p.rate, self._tick, clock=steady)
        self.create_timer(1.0, self._diagnose, clock=steady)
        self._announced: bool | None = None
        self._publish(STOP)

    def _hear(self, topic: str, source: str) -> None:
        def hear(message: Any) -> None:
            twist, now = (message.twist if self._p.enable_stamped_cmd_vel else message), time.monotonic()
            self._guard.hear(source, Command(twist.linear.x, twist.angular.z), now)
            self._publish(self._guard.step(now))

        self.create_subscription(self._type, topic, hear, LATEST)

    def _hear_emergency(self, message: Bool) -> None:
        now = time.monotonic()
        self._guard.hear_emergency(message.data, now)
        self._publish(self._guard.step(now))

    def _locate(self, message: Odometry) -> None:
        position = message.pose.pose.position
        self._guard.locate(position.x, position.y, time.monotonic())

    def _enable(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        response.message = self._guard.enable(request.data, time.monotonic())
        response.success = not response.message
        return response

    def _tick(self) -> None:
        robots = self._velocity.get_subscription_count()
        if robots > self._robots:
            self._guard.greet(time.monotonic())
        self._robots = robots
        self._publish(self._guard.step(time.monotonic()))
        passing = self._guard.enabled and not self._guard.emergency
        if passing != self._announced:
            self._announced = passing
            self._enabled.publish(Bool(data=passing))

    def _publish(self, command: Command | None) -> None:
        if command is None:
            return
        message = self._type()
        if isinstance(message, TwistStamped):
            message.header.stamp = self.get_clock().now().to_msg()
        twist = message.twist if isinstance(message, TwistStamped) else message
        twist.linear.x, twist.angular.z = command
        self._velocity.publish(message)

    def _diagnose(self) -> None:
        level, report = self._problem()
        if report != self._report:
            log = self.get_logger()
            {DiagnosticStatus.OK: log.info, DiagnosticStatus.WARN: log.warning}.get(level, log.error)(report)
        self._report = report
        values = [KeyValue(key="refused", value=str(self._guard.refused))]
        status = DiagnosticStatus(name=self.get_name(), hardware_id=self._p.robot, level=level, message=report, values=values)
        message = DiagnosticArray(status=[status])
        message.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(message)

    def _problem(self) -> tuple[bytes, str]:
        """Return the level and the text of the gravest problem, or of the state."""
        topics = [self.resolve_topic_name(name) for name in ("cmd_vel", "cmd_vel_teleop", "cmd_vel_in")]
        speakers = self.get_publishers_info_by_topic(topics[0])
        if len(speakers) > 1:
            names = ", ".join(sorted(f"/{info.node_name}" for info in speakers))
            return DiagnosticStatus.ERROR, f"{topics[0]} must have one publisher, the guard, but has {names}"
        package, name = self._type.__module__.split(".")[0], self._type.__name__
        for topic in topics:
            for info in (*self.get_publishers_info_by_topic(topic), *self.get_subscriptions_info_by_topic(topic)):
                if info.topic_type != f"{package}/msg/{name}":
                    return DiagnosticStatus.ERROR, (
                        f"/{info.node_name} has {info.topic_type} on {topic}, the guard {name}: start that node or this one "
                        f"with -p enable_stamped_cmd_vel:={str(not self._p.enable_stamped_cmd_vel).lower()}"
                    )
        if self._guard.emergency:
            service = self.resolve_service_name("~/enable")
            return DiagnosticStatus.ERROR, (
                f'emergency stop; when it is released: ros2 service call {service} std_srvs/srv/SetBool "{{data: true}}"'
            )
        if self._guard.outside(time.monotonic()):
            return DiagnosticStatus.WARN, f"not known to be within {self._p.geofence} m of the origin: only a person drives"
        if self._robots == 0:
            return DiagnosticStatus.WARN, f"nobody listens to {topics[0]}"
        return DiagnosticStatus.OK, self._guard.state

    def close(self) -> None:
        """Send zeros and wait until the robot has them."""
        for _ in range(3):
            self._publish(STOP)
        self._velocity.wait_for_all_acked(Duration(seconds=0.5))


def main(argv: Sequence[str] | None = None) -> int:
    """Run ``cmd_vel_guard``."""
    return run(CmdVelGuard, argv)


if __name__ == "__main__":
    raise SystemExit(main())
