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

A guard that is started again remembers no emergency stop; with ``start_enabled`` false it needs to be enabled then too.
Parameters: see `arbiter.Parameters`. All times are of the steady clock, so it works with ``use_sim_time`` and no ``/clock``.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
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

from turtlebot_gym.values import STOP, Command
from turtlebot_gym_ros.robot.arbiter import Arbiter, Parameters
from turtlebot_gym_ros.robot.standalone import declare, run

LATEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class CmdVelGuard(Node):
    """The guard as a node."""

    def __init__(self, context: Context) -> None:
        super().__init__("cmd_vel_guard", context=context, automatically_declare_parameters_from_overrides=True)
        p = declare(self, Parameters)
        self._p, self._arbiter = p, Arbiter(p, time.monotonic())
        self._type = TwistStamped if p.enable_stamped_cmd_vel else Twist
        self._velocity = self.create_publisher(self._type, "cmd_vel", QoSProfile(depth=1))
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
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
            self._arbiter.hear(source, Command(twist.linear.x, twist.angular.z), now)
            self._publish(self._arbiter.step(now))

        self.create_subscription(self._type, topic, hear, LATEST)

    def _hear_emergency(self, message: Bool) -> None:
        now = time.monotonic()
        self._arbiter.hear_emergency(message.data, now)
        self._publish(self._arbiter.step(now))

    def _locate(self, message: Odometry) -> None:
        position = message.pose.pose.position
        self._arbiter.locate(position.x, position.y, time.monotonic())

    def _enable(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        response.message = self._arbiter.enable(request.data, time.monotonic())
        response.success = not response.message
        return response

    def _tick(self) -> None:
        robots = self._velocity.get_subscription_count()
        if robots > self._robots:
            self._arbiter.greet(time.monotonic())
        self._robots = robots
        self._publish(self._arbiter.step(time.monotonic()))
        passing = self._arbiter.enabled and not self._arbiter.emergency
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
            # one line for each severity: rclpy raises where a line changes its own
            if level == DiagnosticStatus.OK:
                self.get_logger().info(report)
            elif level == DiagnosticStatus.WARN:
                self.get_logger().warning(report)
            else:
                self.get_logger().error(report)
        self._report = report
        values = [KeyValue(key="refused", value=str(self._arbiter.refused))]
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
        stamped = self._p.enable_stamped_cmd_vel
        package, name = self._type.__module__.split(".")[0], self._type.__name__
        for topic in topics:
            for info in (*self.get_publishers_info_by_topic(topic), *self.get_subscriptions_info_by_topic(topic)):
                if info.topic_type != f"{package}/msg/{name}":
                    mine, other = (f"-p enable_stamped_cmd_vel:={str(each).lower()}" for each in (stamped, not stamped))
                    return DiagnosticStatus.ERROR, (
                        f"/{info.node_name} has {info.topic_type} on {topic}, the guard {name}: start the guard with {other}, "
                        f"or that node with {mine}"
                    )
        if self._arbiter.emergency:
            service = self.resolve_service_name("~/enable")
            return DiagnosticStatus.ERROR, (
                f'emergency stop; when it is released: ros2 service call {service} std_srvs/srv/SetBool "{{data: true}}"'
            )
        if self._arbiter.outside(time.monotonic()):
            return DiagnosticStatus.WARN, f"not known to be within {self._p.geofence} m of the origin: only a person drives"
        if self._robots == 0:
            return DiagnosticStatus.WARN, f"nobody listens to {topics[0]}"
        return DiagnosticStatus.OK, self._arbiter.state

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
