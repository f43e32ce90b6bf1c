"""The robot that the faults are done to: its chain as real processes, its sensors and sources, and the listener that judges.

The chain is that of `robot.launch.xml`: filter, waypoints, controller, guard with collision monitor, standby, each a process
with the parameters of `robot.yaml`, over sockets. This process is the robot's base, sensors, buttons and a person at the
sticks. It hears ``/cmd_vel`` on rclpy alone, independent of the guard's code, and records when each command was published, by
DDS's source time, and when each measurement was really made.
"""

from __future__ import annotations

import contextlib
import math
import os
import random
import signal
import subprocess
import sys
import tempfile
import threading
import time
from bisect import bisect_right
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

from faults_radio import Radio

HALL = (3.0, 1.5, 1.0)
"""Walls ahead of the start, to the left and right, and behind, m."""
DEAD_END = (1.3, 1.5, 1.0)
"""The same with a wall ahead that the robot reaches within seconds."""
BEAMS = 180
LIDAR_X = -0.032
"""Position of a Burger's LiDAR ahead of its axle, m."""
RADIUS, CENTER_X = 0.105, -0.032
"""Radius of its footprint, and its centre ahead of the axle, m."""
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
        self.heard: list[tuple[float, float, float]] = []
        """Time at which each command for the wheels was published, s, with its v, m/s, and omega, rad/s."""
        self.arrived: list[tuple[float, bool]] = []
        """Time at which each of them arrived, s, and whether it is a motion: one whose writer was suspended arrives late."""
        self.measured: list[tuple[float, float]] = []
        """Times at which what the robot may move on was sent, s, each with the newest time at which such was measured."""
        self.moving: list[tuple[float, float]] = []
        """Times at which the robot should move forward, s, each with its distance to the wall ahead, m."""
        self.began: float | None = None
        """Time of a fault that is itself a reason to stop, s."""
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
        self.processes: dict[str, subprocess.Popen[bytes]] = {}
        for name in CHAIN:
            self.start(name)

    def reset_world(self) -> None:
        """Put the robot back to its start, with honest sensors and clocks, nobody at the sticks, and no button pressed."""
        with self.lock:
            self.pose = (0.0, 0.0, 0.0)
            self.walls = HALL
            self.clock: Callable[[float], float] = lambda now: now
            self.odometry: Callable[[Any, float], list[tuple[Any, float]]] = lambda message, now: [(message, now)]
            self.scan: Callable[[Any], Any] = lambda message: message
            self.teleop: tuple[float, float] | None = None
            self.pressed: list[bool | None] = [False, False] if self.has_buttons else [None, None]
            for topic, which in [key for key in self._speakers if key[1] > 1]:
                self.silence(topic, which)

    # Processes

    def start(self, name: str) -> None:
        """Start a process of the chain."""
        given = CHAIN[name] | ({} if self.has_buttons or name != "cmd_vel_guard" else WITHOUT_BUTTON)
        parameters = ["--params-file", str(CONFIG), *(word for each in given.items() for word in ("-p", ":=".join(each)))]
        program = [sys.executable, "-m", "turtlebot_gym_ros", name, "--ros-args", "--log-level", "fatal"]
        words = ["setpriv", "--pdeathsig", "KILL", *program, *parameters]  # so that none outlives this process
        environment = {**os.environ, "ROS_DOMAIN_ID": str(self.domain)}
        self.processes[name] = subprocess.Popen([*words, *REMAPPED.get(name, [])], env=environment, cwd=self.folder.name)

    def signal(self, name: str, number: signal.Signals) -> None:
        """Send a signal to a process of the chain."""
        self.processes[name].send_signal(number)

    def kill(self, name: str) -> None:
        """Kill a process of the chain, and wait for its end."""
        self.processes[name].kill()
        self.processes[name].wait()

    @contextlib.contextmanager
    def suspended(self, name: str) -> Iterator[None]:
        """Suspend a process."""
        self.signal(name, signal.SIGSTOP)
        try:
            yield
        finally:
            self.signal(name, signal.SIGCONT)

    # What the robot says

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
                self._move(now - last)
                last = now
                self.send_odometry(now)
                if turn % 4 == 0:
                    self.send_scan(now)
                if self.teleop is not None:
                    self.send_command("cmd_vel_teleop", *self.teleop)
                for which, pressed in enumerate(self.pressed):
                    if pressed is not None and turn % 2:
                        self.say(which, pressed)

    def _move(self, dt: float) -> None:
        _, v, omega = self.heard[-1] if self.heard else (0.0, 0.0, 0.0)
        x, y, theta = self.pose
        middle = theta + 0.5 * omega * dt
        self.pose = x + v * dt * math.cos(middle), y + v * dt * math.sin(middle), theta + omega * dt
        gap = self.walls[0] - (x + CENTER_X * math.cos(theta)) - RADIUS
        if v > 0.0 and math.cos(theta) > 0.5:
            self.moving.append((time.time(), gap))

    def send_odometry(self, now: float) -> None:
        """Send what the wheels measured, through whatever the fault does to it."""
        message = self.stamped("Odometry", "odom", self.clock(now))
        message.child_frame_id = "base_footprint"
        pose = message.pose.pose
        pose.position.x, pose.position.y = self.pose[0], self.pose[1]
        pose.orientation.z, pose.orientation.w = math.sin(0.5 * self.pose[2]), math.cos(0.5 * self.pose[2])
        _, v, omega = self.heard[-1] if self.heard else (0.0, 0.0, 0.0)
        message.twist.twist.linear.x, message.twist.twist.angular.z = v, omega
        for sent, measured in self.odometry(message, now):
            self.rests_on(measured)
            self.speaker("odom", "Odometry").publish(sent)

    def send_scan(self, now: float) -> None:
        """Send what the LiDAR measured."""
        message = self.stamped("LaserScan", "base_scan", self.clock(now))
        x, y, theta = self.pose
        x, y = x + LIDAR_X * math.cos(theta), y + LIDAR_X * math.sin(theta)
        step = 2.0 * math.pi / BEAMS
        message.angle_min, message.angle_max, message.angle_increment = 0.0, (BEAMS - 1) * step, step
        message.range_min, message.range_max = 0.12, 3.5
        ranges = [_ray(x, y, theta + k * step, self.walls) + random.gauss(0.0, 0.005) for k in range(BEAMS)]
        message.ranges = [each if each <= 3.5 else math.inf for each in ranges]
        message = self.scan(message)
        if message is not None:
            self.speaker("scan", "LaserScan").publish(message)

    def send_command(self, topic: str, v: float, omega: float, age: float = 0.0) -> None:
        """Send a command with a stamp of a given age, s."""
        message = self.stamped("TwistStamped", "base_footprint", self.clock(time.time() - age))
        message.twist.linear.x, message.twist.angular.z = v, omega
        if (v, omega) != (0.0, 0.0) and math.isfinite(v + omega):
            self.rests_on(time.time() - age)
        self.speaker(topic, "TwistStamped").publish(message)

    def rests_on(self, measured: float) -> None:
        """Record that something was sent which the robot may move on until 0.6 s after it was measured."""
        newest = self.measured[-1][1] if self.measured else -math.inf
        self.measured.append((time.time(), max(newest, measured)))

    def say(self, which: int, pressed: bool) -> None:
        """Publish once whether a button is pressed."""
        self.speaker("emergency_stop", "Bool", which).publish(self.kinds["Bool"](data=pressed))

    def flood(self, topic: str, message: Any, duration: float) -> int:
        """Publish a message as often as a process can, and return how often that was."""
        speaker, until, count = self.speaker(topic, type(message).__name__, 9), time.monotonic() + duration, 0
        while time.monotonic() < until:
            speaker.publish(message)
            count += 1
        return count

    # What a person does

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
            for name in self.processes:
                self.kill(name)
        return trouble

    def _goes_on(self, patience: float) -> bool:
        """Return whether the robot drives within a time, s, once a person has put all right."""
        until = time.monotonic() + patience
        for name, process in list(self.processes.items()):
            process.send_signal(signal.SIGCONT)
            if process.poll() is not None:
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
                    if sum(v > 0.09 for at, v, _ in self.heard[-10:] if at > since) >= 5:
                        return True
        return False

    # What the judge sees

    def motions(self, since: float) -> list[float]:
        """Return the times at which motions were published."""
        return [at for at, v, omega in list(self.heard) if at > since and (v, omega) != (0.0, 0.0)]

    def moves(self, at: float) -> bool:
        """Return whether the last command that was published until a time is a motion."""
        return max((each for each in list(self.heard) if each[0] <= at), default=(0.0, 0.0, 0.0))[1:] != (0.0, 0.0)

    def stop(self) -> float:
        """Return the time from a fault that is a reason to stop to the next zero, s; 0 if the robot stood."""
        began = self.began
        if began is None or not self.moves(began):
            return 0.0
        return min((at for at, *command in list(self.heard) if at > began and command == [0.0, 0.0]), default=math.inf) - began

    def lag(self, since: float) -> float:
        """Return the longest time between the newest measurement that had been sent and a motion, s."""
        measured = list(self.measured)
        sent = [at for at, _ in measured]
        return max((at - measured[bisect_right(sent, at) - 1][1] for at in self.motions(since)), default=0.0)

    def hold(self, since: float) -> float:
        """Return the longest time from the newest measurement to the zero that ends its motion, s."""
        measured, heard = list(self.measured), sorted(message for message in list(self.heard) if message[0] > since)
        sent = [at for at, _ in measured]
        ends = [at for (_, *before), (at, *now) in pairwise(heard) if before != [0.0, 0.0] == now]
        return max((at - measured[bisect_right(sent, at) - 1][1] for at in ends), default=0.0)

    def revived(self, since: float, age: float) -> float:
        """Return the longest time from a motion's arrival to the next zero's, s, if it arrived so long, s, after a measurement.

        Such a motion is not late by its source time: its writer was suspended between reading the clock and sending.
        """
        measured, arrived = list(self.measured), [each for each in list(self.arrived) if each[0] > since]
        sent = [at for at, _ in measured]
        longest = 0.0
        for k, (at, moves) in enumerate(arrived):
            if moves and at - measured[bisect_right(sent, at) - 1][1] > age:
                longest = max(longest, next((end for end, on in arrived[k:] if not on), math.inf) - at)
        return longest

    def nearest(self, since: float) -> float:
        """Return the least distance to the wall ahead at which the robot still moved towards it, m."""
        return min((gap for at, gap in list(self.moving) if at > since), default=math.inf)

    def forget(self) -> None:
        """Forget all but the end of what was recorded."""
        with self.lock:
            self.began = None
            for each in (self.heard, self.arrived, self.measured, self.moving):
                del each[:-100]

    def close(self) -> None:
        """Shut everything down."""
        self.over.set()
        for thread in self.threads:
            thread.join()
        for name in self.processes:
            self.kill(name)
        if self.radio:
            self.radio.close()
        self.node.destroy_node()
        self.context.shutdown()
        self.folder.cleanup()

    def _read_reports(self, message: Any) -> None:
        self._reports |= {status.name: status.message for status in message.status}

    def _hear(self, message: Any, info: Any) -> None:
        command = message.twist.linear.x, message.twist.angular.z
        self.heard.append((info["source_timestamp"] * 1e-9, *command))
        self.arrived.append((info["received_timestamp"] * 1e-9, command != (0.0, 0.0)))


def _ray(x: float, y: float, angle: float, walls: tuple[float, float, float]) -> float:
    """Return the distance from a point to the walls of a rectangular room, m."""
    dx, dy = math.cos(angle), math.sin(angle)
    ahead, aside, behind = walls
    to_x = ((ahead if dx > 0.0 else -behind) - x) / dx if dx else math.inf
    to_y = (math.copysign(aside, dy) - y) / dy if dy else math.inf
    return min(to_x, to_y)


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
