"""The guard of a robot's wheels: the only publisher of ``/cmd_vel``, which runs on the robot itself.

It limits commands and stops the robot when there are none. With ``collision_monitor`` false it does NOT SEE OBSTACLES.

**Its own death is covered by** ``cmd_vel_standby``, see `standby`: a TurtleBot3 holds its last command. A motion in
force is repeated every 0.05 s as a sign of life, and with ``require_standby`` the robot stands without the standby's. The first
message of a guard, to every listener that it meets in its first 5 s, is a zero.

Inputs: ``/cmd_vel_teleop`` (a person; wins while fresh) and ``/cmd_vel_in`` (a program), Twist or TwistStamped;
``/emergency_stop`` (Bool, reliable, true is stop; any number of buttons, each at 5 Hz or more, pressed or not); with a geofence
the Odometry on ``geofence_topic``; with the collision monitor the LaserScan on ``/scan``, and the TFMessage on ``/tf_static``,
which states its mount; ``cmd_vel_standby/alive`` (Empty) if it is required. Outputs: ``/cmd_vel``, ``/diagnostics`` (1 Hz),
``~/enabled`` (Bool, latched). Service: ``~/enable`` (SetBool).

**A command has two ages**, see `sent`: since it was sent (``max_age``), and since the measurement on which it rests
(``measured_age``), by its header's stamp. Of an unstamped Twist, and with ``use_sim_time``, only the first is known.

**An emergency stop** counts however short the press, and from any button, see `emergency`: the guard reads all waiting messages
before it sends any motion. After a stop it sends zeros until it is enabled again::

    ros2 service call /cmd_vel_guard/enable std_srvs/srv/SetBool "{data: true}"

A restarted guard remembers no emergency stop. On a robot ``require_emergency_stop`` is true: then it always starts disabled,
and cannot be enabled without a live button. After one of several buttons is removed for good, restart the guard.

All names are relative: to stop several robots with one button, remap ``emergency_stop`` of each guard and node that moves one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import Odometry
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message
from rclpy.subscription import Subscription
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Bool, Empty, String
from std_srvs.srv import SetBool

from cmd_vel_guard.arbiter import Arbiter
from cmd_vel_guard.collision import RawScan
from cmd_vel_guard.declare import declare
from cmd_vel_guard.executor import waiting
from cmd_vel_guard.parameters import Parameters
from cmd_vel_guard.process import precede, run
from cmd_vel_guard.qos import EVERY, LATCHED, LATEST, PROMPT
from cmd_vel_guard.report import Report
from cmd_vel_guard.sent import Age, Ages, SystemClock, read_clocks
from cmd_vel_guard.sources import BUTTONS, TF_STATIC, check_topics, hear_mounts, rivals
from cmd_vel_guard.values import STOP, Command, Pose
from turtlebot_gym.mounts import yaw_of_rotation

MOST = 100
"""Most waiting messages of the buttons that are taken at a time."""
LATE = 0.02
"""Time after its decision from which a motion is not published, s: the guard was suspended or starved in between."""


class CmdVelGuard(Node):
    """The guard as a node."""

    def __init__(self, context: Context) -> None:
        super().__init__("cmd_vel_guard", context=context, automatically_declare_parameters_from_overrides=True)
        (self._p,) = (p,) = declare(self, Parameters)
        self._clock_watch = SystemClock()
        self._ages: dict[str, Ages] = {}
        self._inputs: dict[str, Subscription] = {}
        check_topics(self.resolve_topic_name)
        wrap = partial(self._safely, TF_STATIC)
        mount_of = hear_mounts(self, p.frame_prefix + p.body_frame, wrap) if p.monitors else lambda frame: None
        self._arbiter = Arbiter(p, self._now(), mount_of)
        self._type = TwistStamped if p.enable_stamped_cmd_vel else Twist
        self._headers_count = not self.get_parameter("use_sim_time").value
        self._velocity = self.create_publisher(self._type, "cmd_vel", QoSProfile(depth=1))
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._enabled = self.create_publisher(Bool, "~/enabled", LATCHED)
        self._report = Report(self, self._arbiter, p, self._type)
        self._hear("cmd_vel_teleop", "teleop")
        self._hear("cmd_vel_in", "program")
        self._buttons = self._subscribe(Bool, BUTTONS, self._hear_button, EVERY)
        self._promptly = self._subscribe(Bool, BUTTONS, partial(self._hear_button, prompt=True), PROMPT)
        if p.require_standby:
            self._subscribe(Empty, "cmd_vel_standby/alive", self._hear_standby, LATEST)
        for topic in {topic for topic, on in ((p.geofence_topic, p.geofence > 0.0), ("odom", p.motion_check)) if on}:
            self._subscribe(Odometry, topic, partial(self._hear_pose, topic), LATEST)
        if p.heed_disagreement:
            self._subscribe(String, "disagreement", self._hear_disagreement, LATCHED)
        if p.monitors:
            self._subscribe(LaserScan, "scan", self._scan, LATEST)
        self.create_service(SetBool, "~/enable", self._enable)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(1.0 / p.rate, self._tick, clock=steady)
        self.create_timer(1.0, self._diagnose, clock=steady)
        self._robots, self._announced = 0, None
        self._velocity.publish(self._message_of(STOP))

    def _now(self) -> float:
        """Return the steady time, s, after comparing it with the system clock."""
        system, now = read_clocks()
        self._clock_watch.look(system=system, steady=now)
        return now

    def _age(self, topic: str, message: Any, info: Mapping[str, Any], now: float, *, hurried: bool = True) -> Age:
        """Return the age of a topic's message, and note it unless it may have waited for one that was sent again."""
        ages = self._ages.setdefault(topic, Ages(self._clock_watch))
        age = ages.age_of(info, getattr(message, "header", None) if self._headers_count else None, now)
        if hurried:
            self._report.note(self.resolve_topic_name(topic), age, now, ages.figures())
        return age

    def _subscribe(self, kind: type, topic: str, hear: Any, qos: QoSProfile) -> Subscription:
        callback: Any = self._safely(topic, hear)  # rclpy supports the info, but its types do not show it
        self._inputs[topic] = self.create_subscription(kind, topic, callback, qos)
        return self._inputs[topic]

    def _safely(self, topic: str, hear: Any) -> Any:
        """Return a callback after whose errors the robot stands."""

        def receive(message: Any, info: Mapping[str, Any]) -> None:
            try:
                hear(message, info)
            except Exception as error:  # whatever a message may cause
                self._report.fail(f"{self.resolve_topic_name(topic)}: {type(error).__name__}: {error}", self._now())

        return receive

    def _hear(self, topic: str, source: str) -> None:
        def hear(message: Any, info: Mapping[str, Any]) -> None:
            twist, now = (message.twist if self._p.enable_stamped_cmd_vel else message), self._now()
            age, command = self._age(topic, message, info, now), Command(twist.linear.x, twist.angular.z)
            self._arbiter.hear(source, command, now, sent=now - age.sent, measured=now - age.measured, dated=age.dated)
            self._step()

        self._subscribe(self._type, topic, hear, LATEST)

    def _hear_button(self, message: Bool, info: Mapping[str, Any], *, prompt: bool = False, step: bool = True) -> None:
        now = self._now()
        age = self._age(BUTTONS, message, info, now, hurried=prompt)
        number = info["publication_sequence_number"]
        times = {"sent": now - age.sent, "dated": age.dated}
        self._arbiter.hear_emergency(message.data, now, **times, number=number, prompt=prompt)
        if step:
            self._step()

    def _hear_pose(self, topic: str, message: Odometry, info: Mapping[str, Any]) -> None:
        """Take a pose for the geofence, odometry for the motion, or both."""
        pose, q, twist, now = message.pose.pose.position, message.pose.pose.orientation, message.twist.twist, self._now()
        measured = now - self._age(topic, message, info, now).measured
        if self._p.geofence > 0.0 and topic == self._p.geofence_topic:
            self._arbiter.locate(pose.x, pose.y, now, sent=measured, frame=message.header.frame_id)
        if self._p.motion_check and topic == "odom":
            at, speeds = Pose(pose.x, pose.y, yaw_of_rotation(q.w, q.x, q.y, q.z)), Command(twist.linear.x, twist.angular.z)
            self._arbiter.hear_odometry(at, speeds, now, measured=measured)

    def _hear_disagreement(self, message: String, info: Mapping[str, Any]) -> None:
        if message.data:
            self._arbiter.halt(message.data)
            self._step()

    def _scan(self, message: LaserScan, info: Mapping[str, Any]) -> None:
        now = self._now()
        age = self._age("scan", message, info, now)
        numbers = [getattr(message, name) for name in RawScan._fields[:-1]]
        scan = RawScan._make([*numbers, message.header.frame_id])
        # The stamp may be that of the first beam.
        self._arbiter.hear_scan(scan, now, sent=now - age.since(self._p.scan_period), dated=age.dated)
        self._step()

    def _enable(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self._take_buttons()
        response.message = self._arbiter.enable(request.data, self._now(), buttons=self._buttons.get_publisher_count())
        response.success = not response.message
        if request.data and response.success:
            for ages in self._ages.values():
                ages.begin()
        self._step()
        return response

    def _take_buttons(self) -> None:
        """Take the messages of the buttons that no callback has processed yet, at most `MOST` of each kind."""
        for prompt, buttons in ((False, self._buttons), (True, self._promptly)):
            for message, info in waiting(buttons, MOST):
                self._safely(BUTTONS, partial(self._hear_button, prompt=prompt, step=False))(message, info)
        self._arbiter.count_buttons(self._buttons.get_publisher_count(), self._now())

    def _hear_standby(self, message: Empty, info: Mapping[str, Any]) -> None:
        now = self._now()
        self._arbiter.hear_standby(now, sent=now - self._age("cmd_vel_standby/alive", message, info, now).sent)

    def _step(self) -> None:
        """Publish the command for the wheels, if any; a motion that was held up since it was decided is decided again."""
        self._take_buttons()
        self._arbiter.rivals = rivals(self._inputs)
        robots = self._velocity.get_subscription_count()
        if robots > self._robots:
            self._arbiter.greet(self._now())
        self._robots = robots
        while (command := self._arbiter.step(now := self._now())) is not None:
            message, stops = serialize_message(self._message_of(command)), command == STOP
            if stops or read_clocks()[1] - now <= LATE:  # as near as can be to the sending
                self._velocity.publish(message)
                break

    def _tick(self) -> None:
        self._step()
        passing = self._arbiter.enabled and not self._arbiter.emergency
        if passing != self._announced:
            self._announced = passing
            self._enabled.publish(Bool(data=passing))

    def _message_of(self, command: Command) -> TwistStamped | Twist:
        message = self._type()
        if isinstance(message, TwistStamped):
            message.header.stamp = self.get_clock().now().to_msg()
            message.header.frame_id = self._p.frame_prefix + self._p.body_frame
        twist = message.twist if isinstance(message, TwistStamped) else message
        twist.linear.x, twist.angular.z = command
        return message

    def _diagnose(self) -> None:
        self._diagnostics.publish(self._report.message(self._now(), robots=self._robots))

    def halt(self) -> None:
        """Send zeros and wait until the robot has received them."""
        for _ in range(3):
            self._velocity.publish(self._message_of(STOP))
        self._velocity.wait_for_all_acked(Duration(seconds=0.5))


def main(argv: Sequence[str] | None = None) -> int:
    """Run ``cmd_vel_guard``, before all other processes but its standby, where the system permits a real-time priority."""
    precede(1)
    return run([CmdVelGuard], argv, local=False)
