"""The robot that the faults are done to: its chain as real processes, its sensors and sources, and the listener that judges.

The chain is that of `robot.launch.xml`: filter, waypoints, controller, guard with collision monitor, standby, each a process
with the parameters of `robot.yaml`, over sockets. This process is the robot's base, sensors, buttons and a person at the
sticks. It hears ``/cmd_vel`` on rclpy alone, independent of the guard's code, and records when each command was published, by
DDS's source time, and when each measurement was really made.
"""

from __future__ import annotations

import contextlib
import math
import random
import signal
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from faults_radio import Radio
from faults_record import Record
from faults_world import BEAMS, FARTHEST, World
from ros_nodes import Nodes

CONFIG = Path(__file__).parents[1] / "bridges" / "turtlebot_gym_ros" / "config" / "robot.yaml"
CHAIN = {
    "cmd_vel_guard": {"collision_monitor": "true"},
    "cmd_vel_standby": {},
    "kalman_filter": {"takes_fixes": "true"},
    "waypoint_generator": {"waypoints": "far.csv"},
    "velocity_controller": {},
}
WITHOUT_BUTTON = {"require_emergency_stop": "false", "start_enabled": "true"}
"""Parameters of a guard without a button: one that is started again passes commands at once, unlike on a robot."""
REMAPPED = {"velocity_controller": ["-r", "cmd_vel:=cmd_vel_in"]}


class Robot:
    """The processes, the robot's base, and the listener.

    Args:
        domain: Its ROS domain.
        buttons: Whether it has emergency stops. A suspended guard that has heard one also stops because of its silence.
    """

    def __init__(self, domain: int, *, buttons: bool) -> None:
        import rclpy.node
        from rclpy.context import Context
        from rclpy.executors import SingleThreadedExecutor
        from rclpy.impl.implementation_singleton import rclpy_implementation
        from rclpy.qos import QoSProfile, ReliabilityPolicy

        self.domain, self.has_buttons = domain, buttons
        self.folder = tempfile.TemporaryDirectory()
        Path(self.folder.name, "far.csv").write_text("1000,0,0\n")
        self.context = Context()
        self.context.init([], domain_id=domain)
        self.node = rclpy.node.Node("faults", context=self.context)
        every = QoSProfile(depth=5000, reliability=ReliabilityPolicy.BEST_EFFORT)
        self._qos = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
        self.record = Record()
        self.kinds = _kinds()
        hear: Any = self._hear
        self.node.create_subscription(self.kinds["TwistStamped"], "cmd_vel", hear, every)
        self._reports: dict[str, str] = {}
        self.node.create_subscription(self.kinds["DiagnosticArray"], "/diagnostics", self._read_reports, 10)
        self._speakers: dict[tuple[str, int], Any] = {}
        self.radio = Radio(domain) if buttons else None
        if self.radio:  # of the second button, which keeps no message to send it again
            self._speakers["emergency_stop", 1] = self.radio.node.create_publisher(self.kinds["Bool"], "emergency_stop", 1)
        self._clients: dict[str, Any] = {}
        self.lock, self.over = threading.RLock(), threading.Event()
        self.reset_world()
        executor = SingleThreadedExecutor(context=self.context)
        executor.add_node(self.node)

        def spin() -> None:
            while not self.over.is_set():
                with contextlib.suppress(rclpy_implementation.InvalidHandle):  # of what a fault has just destroyed
                    executor.spin_once(timeout_sec=0.05)

        self.threads = [threading.Thread(target=target, daemon=True) for target in (spin, self._run)]
        for thread in self.threads:
            thread.start()
        self.nodes = Nodes(
            Path(self.folder.name), REMAPPED, "--params-file", str(CONFIG), "--log-level", "fatal", ROS_DOMAIN_ID=str(domain)
        )
        for name in CHAIN:
            self.start(name)

    def reset_world(self) -> None:
        """Put the robot back to its start, with honest sensors and clocks, nobody at the sticks, and no button pressed."""
        with self.lock:
            self.world = World()
            self.clock: Callable[[float], float] = lambda now: now
            self.odometry: Callable[[Any, float], list[tuple[Any, float]]] = lambda message, now: [(message, now)]
            self.scan: Callable[[Any], Any] = lambda message: message
            self.teleop: tuple[float, float] | None = None
            self.pressed: list[bool | None] = [False, False] if self.has_buttons else [None, None]
            for topic, which in [key for key in self._speakers if key[1] > 1]:
                self.silence(topic, which)

    def start(self, name: str) -> None:
        """Start a process of the chain."""
        self.nodes.start(name, **CHAIN[name], **({} if self.has_buttons or name != "cmd_vel_guard" else WITHOUT_BUTTON))

    def speaker(self, topic: str, kind: str, which: int = 0) -> Any:
        """Return a publisher; those above 1 end with the fault."""
        key = (topic, which)
        if key not in self._speakers:
            from rclpy.event_handler import PublisherEventCallbacks

            events = PublisherEventCallbacks(use_default_callbacks=False)  # an executor that waits for events keeps them alive
            speaker = self.node.create_publisher(self.kinds[kind], topic, self._qos, event_callbacks=events)
            self._speakers[key] = speaker
            until = time.monotonic() + (1.0 if which > 1 else 0.0)
            while not speaker.get_subscription_count() and time.monotonic() < until:
                time.sleep(0.01)
        return self._speakers[key]

    def silence(self, topic: str, which: int) -> None:
        """End a publisher."""
        self.node.destroy_publisher(self._speakers.pop((topic, which)))

    def stamped(self, kind: str, frame: str, at: float) -> Any:
        """Return an empty message with a stamp, s."""
        message = self.kinds[kind]()
        message.header.frame_id = frame
        message.header.stamp.sec, message.header.stamp.nanosec = int(at), int(at % 1.0 * 1e9)
        return message

    def _run(self) -> None:
        """Move by the last command for the wheels, and send odometry at 20 Hz, scans and buttons at 5 to 10 Hz."""
        turn, last = 0, time.time()
        while not self.over.wait(0.05):
            with self.lock:
                turn, now = turn + 1, time.time()
                gap = self.world.move(*self._speeds(), now - last)
                if gap is not None:
                    self.record.moving_forward.append((time.time(), gap))
                last = now
                self.send_odometry(now)
                if turn % 4 == 0:
                    self.send_scan(now)
                if self.teleop is not None:
                    self.send_command("cmd_vel_teleop", *self.teleop)
                for which, pressed in enumerate(self.pressed):
                    if pressed is not None and turn % 2:
                        self.say(which, pressed)

    def _speeds(self) -> tuple[float, float]:
        """Return v, m/s, and omega, rad/s, of the last command for the wheels."""
        return self.record.heard[-1][1:] if self.record.heard else (0.0, 0.0)

    def send_odometry(self, now: float) -> None:
        """Send what the wheels measured, through whatever the fault does to it."""
        message = self.stamped("Odometry", "odom", self.clock(now))
        message.child_frame_id = "base_footprint"
        pose, (x, y, theta) = message.pose.pose, self.world.pose
        pose.position.x, pose.position.y = x, y
        pose.orientation.z, pose.orientation.w = math.sin(0.5 * theta), math.cos(0.5 * theta)
        message.twist.twist.linear.x, message.twist.twist.angular.z = self._speeds()
        for sent, measured in self.odometry(message, now):
            self.record.rests_on(measured)
            self.speaker("odom", "Odometry").publish(sent)

    def send_scan(self, now: float) -> None:
        """Send what the LiDAR measured."""
        message = self.stamped("LaserScan", "base_scan", self.clock(now))
        step = 2.0 * math.pi / BEAMS
        message.angle_min, message.angle_max, message.angle_increment = 0.0, (BEAMS - 1) * step, step
        message.range_min, message.range_max = 0.12, FARTHEST
        message.ranges = self.world.ranges()
        message = self.scan(message)
        if message is not None:
            self.speaker("scan", "LaserScan").publish(message)

    def send_command(self, topic: str, v: float, omega: float, age: float = 0.0) -> None:
        """Send a command with a stamp of a given age, s."""
        message = self.stamped("TwistStamped", "base_footprint", self.clock(time.time() - age))
        message.twist.linear.x, message.twist.angular.z = v, omega
        if (v, omega) != (0.0, 0.0) and math.isfinite(v + omega):
            self.record.rests_on(time.time() - age)
        self.speaker(topic, "TwistStamped").publish(message)

    def say(self, which: int, pressed: bool) -> None:
        """Publish once whether a button is pressed."""
        self.speaker("emergency_stop", "Bool", which).publish(self.kinds["Bool"](data=pressed))

    def flood(self, topic: str, message: Any, duration: float) -> None:
        """Publish a message as often as a process can for a time, s."""
        speaker, until = self.speaker(topic, type(message).__name__, 9), time.monotonic() + duration
        while time.monotonic() < until:
            speaker.publish(message)

    def ask(self, service: str, patience: float = 3.0, **request: Any) -> bool:
        """Call a service, and return whether it agreed in time."""
        kind = self.kinds["SetBool" if request else "Trigger"]
        if service not in self._clients:  # kept, since a new one is not discovered at once
            self._clients[service] = self.node.create_client(kind, service)
        client = self._clients[service]
        until = time.monotonic() + patience
        while not client.service_is_ready() and time.monotonic() < until:
            time.sleep(0.01)
        future = client.call_async(kind.Request(**request))
        while not future.done() and time.monotonic() < until:
            time.sleep(0.005)
        return bool(future.done() and future.result().success)

    def enable(self, on: bool = True) -> bool:
        """Enable or disable the guard."""
        return self.ask("cmd_vel_guard/enable", data=on)

    def drive(self) -> str:
        """Make the robot drive from its start, from any state of its chain.

        Returns:
            What the nodes reported if the whole chain had to be started again for it, or an empty text.

        Raises:
            RuntimeError: If it does not drive then either.
        """
        trouble = ""
        while not self._goes_on(300.0):  # on a busy machine five chains take minutes to start
            if trouble:
                raise RuntimeError(f"the robot does not drive: {trouble}")
            trouble = "; ".join(f"{name}: {text}" for name, text in self._reports.items())
            for name in self.nodes:
                self.nodes.kill(name)
        return trouble

    def _goes_on(self, patience: float) -> bool:
        """Return whether the robot drives within a time, s, once a person has put all right."""
        until = time.monotonic() + patience
        for name in list(self.nodes):
            self.nodes.signal(name, signal.SIGCONT)
            if self.nodes.has_ended(name):
                self.start(name)
        while time.monotonic() < until:
            self.reset_world()
            self.ask("kalman_filter/reset")
            self.ask("waypoint_generator/reset")  # it may have compared clocks that a fault had set
            time.sleep(0.6)  # a button counts as pressed for half a second after it is released
            if self.enable() and self.ask("velocity_controller/enable", data=True):
                since = time.time()
                while time.time() < since + 2.0:
                    time.sleep(0.02)
                    if sum(v > 0.09 for at, v, _ in self.record.heard[-10:] if at > since) >= 5:
                        return True
        return False

    def close(self) -> None:
        """Shut everything down."""
        self.over.set()
        for thread in self.threads:
            thread.join()
        for name in self.nodes:
            self.nodes.kill(name)
        if self.radio:
            self.radio.close()
        self.node.destroy_node()
        self.context.shutdown()
        self.folder.cleanup()

    def _read_reports(self, message: Any) -> None:
        self._reports |= {status.name: status.message for status in message.status}

    def _hear(self, message: Any, info: Any) -> None:
        command = message.twist.linear.x, message.twist.angular.z
        self.record.heard.append((info["source_timestamp"] * 1e-9, *command))
        self.record.arrived.append((info["received_timestamp"] * 1e-9, command != (0.0, 0.0)))


Fault = Callable[[Robot, random.Random], int]
"""Injects a fault, and returns the number of unsafe motions; see `faults_kinds`."""


def nothing(message: Any, now: float) -> list[tuple[Any, float]]:
    """Send no odometry."""
    return []


def _kinds() -> dict[str, Any]:
    """Return the types of messages and services by name."""
    from diagnostic_msgs.msg import DiagnosticArray
    from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, TwistStamped
    from nav_msgs.msg import Odometry
    from sensor_msgs.msg import LaserScan
    from std_msgs.msg import Bool, Empty
    from std_srvs.srv import SetBool, Trigger

    kinds = (
        DiagnosticArray, PoseStamped, PoseWithCovarianceStamped, TwistStamped, Odometry, LaserScan, Bool, Empty, SetBool,
        Trigger,
    )  # fmt: skip
    return {kind.__name__: kind for kind in kinds}
