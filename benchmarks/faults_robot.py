"""The robot that the faults are done to: its chain as real processes, its driver, LiDAR and buttons, and the judge's ears.

This process is the robot's base, sensors, buttons and a person at the sticks. It hears ``/cmd_vel`` by itself, and records
when each command was published, by DDS's source time, when it arrived, and when each measurement was really made.
"""

from __future__ import annotations

import math
import random
import threading
import time
from collections.abc import Callable
from typing import Any

from faults_chain import Chain
from faults_record import UNSEEN, Record
from faults_ros import Ros, stamped
from faults_world import ANGLES, BEAMS, FARTHEST, Driver, Said, World

AHEAD, SETTLE = 50.0, 0.1
"""Distance of a goal, m: farther than the robot can drive in any fault; time for a message to take effect, s: several cycles of
the guard on a busy machine."""
Sent = list[tuple[Any, float]]
"""Messages of odometry, each with when it was measured, s."""


class Unseen(Exception):
    """A fault that did not happen, or could not be seen: nothing follows from it, and it must be injected again."""


class Robot:
    """The robot in its ROS domain, and the judge; a suspended guard that has heard a button stops because of its silence."""

    def __init__(self, domain: int, *, buttons: bool) -> None:
        self.record, self.ros = Record(), Ros(domain, radio=buttons)
        self.ros.hear("cmd_vel", self._hear, reliable=True)  # as a robot
        self.lock, self._over = threading.RLock(), threading.Event()
        self._has_buttons = buttons
        self.reset_world()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()
        self.chain = Chain(domain, buttons=buttons)
        self.chain.repair()

    def reset_world(self) -> None:
        """Put the robot back to its start, with honest sensors and clocks, nobody at the sticks, and no button pressed."""
        with self.lock:
            self.world = World()
            self.driver = Driver(self.world)
            self.clock: Callable[[float], float] = lambda now: now
            self.odometry: Callable[[Any, float], Sent] = lambda message, now: [(message, now)]
            """What is sent for a message of odometry."""
            self.beside: Callable[[Any, float], object] = lambda message, now: None
            """What a stranger does whenever there is a message of odometry."""
            self.scan: Callable[[Any], Any] = lambda message: message
            self.teleop: tuple[float, float] | None = None
            self.pressed: list[bool | None] = [False, False] if self._has_buttons else [None, None]
            self.ros.silence_strangers()

    def _run(self) -> None:
        """Move by the last command for the wheels, and send odometry at 20 Hz, scans and buttons at 5 to 10 Hz."""
        turn, last = 0, time.time()
        while not self._over.wait(0.05):
            with self.lock:
                turn, now = turn + 1, time.time()
                for begin, end, v, omega in self.record.held(last, now):
                    self.driver.move(v, omega, end - begin)
                    if (v, omega) != (0.0, 0.0):
                        self.record.clearances.append((now, self.world.clearance()))
                self.record.looks.append(now)
                last = now
                message = self.odometry_of(self.driver.says(now), now)
                self.beside(message, now)
                for sent, measured in self.odometry(message, now):
                    self.record.rests_on(measured)
                    self.ros.speaker("odom").publish(sent)
                if turn % 4 == 0 and (scan := self.scan(self.scan_of(self.world.ranges(), now))) is not None:
                    self.ros.speaker("scan").publish(scan)
                if self.teleop is not None:
                    self.send_command("cmd_vel_teleop", *self.teleop)
                for which, pressed in enumerate(self.pressed):
                    if pressed is not None and turn % 2:
                        self.say(which, pressed)

    def odometry_of(self, said: Said, now: float) -> Any:
        """Return the message of odometry that says something, with a stamp of the robot's clock."""
        message = stamped("odom", self.clock(now))
        message.header.frame_id, message.child_frame_id = said.frame, "base_footprint"
        pose, twist = message.pose.pose, message.twist.twist
        pose.position.x, pose.position.y = said.x, said.y
        pose.orientation.z, pose.orientation.w = math.sin(0.5 * said.theta), math.cos(0.5 * said.theta)
        twist.linear.x, twist.linear.y, twist.angular.z = said.v, said.across, said.omega
        message.pose.covariance[0] = said.variance
        return message

    def scan_of(self, ranges: Any, now: float) -> Any:
        """Return the message of a scan."""
        message = stamped("scan", self.clock(now))
        message.angle_min, message.angle_max, message.angle_increment = 0.0, float(ANGLES[-1]), 2.0 * math.pi / BEAMS
        message.range_min, message.range_max = 0.12, FARTHEST
        message.ranges = [float(distance) for distance in ranges]
        return message

    def send_command(self, topic: str, v: float, omega: float, age: float = 0.0, which: int = 0) -> None:
        """Send a command with a stamp of a given age, s."""
        message = stamped(topic, self.clock(time.time() - age))
        message.twist.linear.x, message.twist.angular.z = v, omega
        if (v, omega) != (0.0, 0.0) and math.isfinite(v + omega):
            self.record.rests_on(time.time() - age)
        self.ros.speaker(topic, which).publish(message)

    def send_goal(self, direction: float) -> None:
        """Send the robot somewhere far away, in a direction in the frame of its odometry, rad."""
        goal = stamped("goal_pose", self.clock(time.time()))
        goal.pose.position.x, goal.pose.position.y = AHEAD * math.cos(direction), AHEAD * math.sin(direction)
        goal.pose.orientation.w = 1.0
        self.ros.speaker("goal_pose").publish(goal)

    def say(self, which: int, pressed: bool) -> None:
        """Publish once whether a button is pressed."""
        message = stamped("emergency_stop", 0.0)
        message.data = pressed
        self.ros.speaker("emergency_stop", which).publish(message)

    def enable(self, on: bool = True) -> bool:
        """Enable or disable the guard."""
        return self.ros.ask("cmd_vel_guard/enable", data=on)

    def drive(self) -> None:
        """Make the robot drive from its start, from any state of its chain, which is started again at last."""
        for _ in range(2):
            self.chain.repair()
            until = time.monotonic() + 300.0  # on a busy machine five chains take minutes to start
            while time.monotonic() < until:
                self.reset_world()
                if self.begin():
                    return
            self.chain.kill()
        raise RuntimeError(f"the robot does not drive: {self.ros.reports[-10:]}")

    def begin(self) -> bool:
        """Let a person reset and enable everything, and return whether the robot drives within 2 s."""
        self.ros.ask("kalman_filter/reset")
        self.ros.ask("waypoint_generator/reset")  # it may have compared clocks that a fault had set
        time.sleep(0.6)  # a button counts as pressed for half a second after it is released
        return self.enable() and self.ros.ask("velocity_controller/enable", data=True) and self.drives(2.0)

    def drives(self, patience: float, v: float = 0.18, omega: float = 0.0) -> bool:
        """Return whether five commands from now on are such a motion, by default ahead, within a time, s."""
        since, least = time.time(), 0.5 * (v * v + omega * omega)
        while time.time() < since + patience:
            time.sleep(0.02)
            commands = [command for command in self.record.heard[-10:] if command.arrived > since]
            if sum(command.v * v + command.omega * omega > least for command in commands) >= 5:
                return True
        return False

    def until(self, condition: Callable[[], bool], patience: float = 90.0) -> None:
        """Wait until a condition holds; a fault is `Unseen` in which it does not within a time, s."""
        until = time.monotonic() + patience
        while not condition():
            if time.monotonic() > until:
                raise Unseen("the robot did not do what the fault needs")
            time.sleep(0.01)

    def judge(self, since: float) -> list[str]:
        """Return why what happened since a time was unsafe; a fault is `Unseen` that seems safe, but was not all seen."""
        until = time.time()
        while time.time() < until + 1.0 and self.record.age(time.time()) > 0.2 and self.record.in_force(until, time.time()):
            time.sleep(0.02)  # its sources are dead, so the motion has to end
        until, caught_up = time.time(), self.ros.catch_up()
        reasons = [*self.record.reasons(since, until), *(f"{name} has ended" for name in self.chain.dead())]
        gap = self.record.unseen(since, until)
        if not reasons and not (caught_up and self._thread.is_alive() and gap <= UNSEEN):
            raise Unseen(f"nobody looked for {gap:.1f} s, or the judge did not hear everything")
        return reasons

    def must_stand(self, since: float, watched: float = 1.0) -> list[str]:
        """Watch the robot for a time, s, and return that a motion was in force since another."""
        time.sleep(max(0.0, since - time.time()) + watched)
        return self.moves_on(since, time.time())

    def moves_on(self, since: float, until: float) -> list[str]:
        """Return that a motion was in force between two times, when there may be none; an empty list if none was."""
        self.ros.catch_up()
        lasts = self.record.lasts(since, until)
        return [f"motion was in force for {lasts:.2f} s after it had to end"] if lasts > 0.0 else []

    def stood(self, since: float, lasting: float) -> bool:
        """Return whether the robot has stood for some time, s, since a time or later."""
        now = time.time()
        return now > since + lasting and not self.record.in_force(now - lasting, now)

    def strays(self, since: float) -> list[str]:
        """Return why the motion was unsafe since a time at which a lie could be seen."""
        self.ros.catch_up()
        return self.record.strays(since, time.time())

    def close(self) -> None:
        """Shut everything down."""
        self._over.set()
        self._thread.join()
        self.chain.close()
        self.ros.close()

    def _hear(self, message: Any, info: Any) -> None:
        sent, arrived = info["source_timestamp"] * 1e-9, info["received_timestamp"] * 1e-9
        self.record.hear(sent, arrived, message.twist.linear.x, message.twist.angular.z)


Fault = Callable[[Robot, random.Random], list[str] | None]
"""Injects a fault, and may return why what happened was unsafe, besides what `Robot.judge` finds."""


def nothing(message: Any, now: float) -> Sent:
    """Send no odometry."""
    return []
