"""The standby of the guard: it publishes zeros on ``/cmd_vel`` if the guard falls silent while the robot moves.

A TurtleBot3 holds its last command indefinitely, so a guard that crashed, was killed or is suspended would leave the robot
driving. This process shares nothing with it but the topic: its sign of life is its own output. While a motion is in force the
guard repeats it every 0.05 s; after `SILENCE` without a message, zeros follow for `ZEROS`. A guard that speaks again is obeyed
at once. While the guard is alive the standby publishes nothing on ``/cmd_vel``.

Its own sign of life is ``~/alive`` (Empty, 10 Hz), as long as it hears a publisher on ``/cmd_vel`` besides itself; with
``require_standby`` the guard stops the robot half a second after the last one. If both are killed at once, the robot drives on.

**It outlives its terminal.** It runs in a session of its own, so that what ends or suspends the processes of a terminal does
not reach it; a child process stays behind to notice. When that child or the process that started this one ends, or at a signal
that ends processes, it goes on until the guard has ended, at most for `LINGER`. Once its parent has ended in any other way, it
ends when nobody else was on ``/cmd_vel`` for `ALONE`. Its own last messages are zeros if a motion is in force.

Inputs: ``/cmd_vel``. Outputs: ``/cmd_vel``, ``~/alive``. Parameters: see `Parameters`.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Sequence
from dataclasses import dataclass

from geometry_msgs.msg import Twist, TwistStamped
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import QoSProfile
from std_msgs.msg import Empty

from cmd_vel_guard.declare import declare
from cmd_vel_guard.executor import PolledGroup, waiting
from cmd_vel_guard.process import precede, run
from cmd_vel_guard.qos import STREAM
from cmd_vel_guard.reports import ERROR, log
from cmd_vel_guard.session import leave

SILENCE = 0.18
"""Silence of a guard that moves the robot after which zeros follow, s: three of its repetitions."""
ZEROS = 1.0
"""Time for which zeros are sent, s."""
PERIOD = 0.02
"""Time between two looks, s; also the period of the zeros."""
LATE = 0.1
"""Most by which a message may have come before it was looked at, s."""
LINGER = 2.0
"""Longest time for which it goes on after it was asked to end, s; launch files escalate at 5 s."""
ALONE = 10.0
"""Time without a guard after which it ends if the process that started it has ended, s."""


@dataclass(frozen=True, kw_only=True)
class Parameters:
    """Parameters of ``cmd_vel_standby``."""

    enable_stamped_cmd_vel: bool = True
    """Whether velocities are TwistStamped, as on a Jazzy robot; Twist if false. As in the guard."""


class Standby:
    """The decision, without ROS; ``now`` is a steady time, s."""

    def __init__(self) -> None:
        self._looked = self._heard = self._until = -math.inf
        self.moves = False
        """Whether a motion is in force."""
        self.takeovers = 0

    def look(self, motions: Sequence[bool], now: float) -> bool:
        """Return whether to publish a zero now, by whether the messages since the last look move the robot; it hears itself."""
        came = max(self._looked, now - LATE)
        self._looked = now
        if any(motions):
            self._until = -math.inf
        if motions:
            self._heard, self.moves = came, motions[-1]
        if self.moves and now - self._heard > SILENCE:
            self.moves, self._until = False, now + ZEROS
            self.takeovers += 1
        return self.acts(now)

    def acts(self, now: float) -> bool:
        """Return whether it publishes zeros."""
        return now < self._until


class CmdVelStandby(Node):
    """The standby as a node."""

    def __init__(self, context: Context) -> None:
        super().__init__("cmd_vel_standby", context=context, automatically_declare_parameters_from_overrides=True)
        (p,) = declare(self, Parameters)
        self._type = TwistStamped if p.enable_stamped_cmd_vel else Twist
        self._rule = Standby()
        self._frame = ""
        self._parent, self._guarded, self._asked = os.getppid(), time.monotonic(), math.inf
        self._velocity = self.create_publisher(self._type, "cmd_vel", QoSProfile(depth=1))
        self._alive = self.create_publisher(Empty, "~/alive", QoSProfile(depth=1))
        polled = PolledGroup()
        self._guard = self.create_subscription(self._type, "cmd_vel", lambda message: None, STREAM, callback_group=polled)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(PERIOD, self._look, clock=steady)
        self.create_timer(0.1, self._live, clock=steady)

    def _look(self) -> None:
        motions = []
        for message, _ in waiting(self._guard, STREAM.depth):  # more than it keeps would be a flood
            twist = message.twist if isinstance(message, TwistStamped) else message
            motions.append((twist.linear.x, twist.angular.z) != (0.0, 0.0))
            self._frame = message.header.frame_id if isinstance(message, TwistStamped) else ""
        before = self._rule.takeovers
        if self._rule.look(motions, time.monotonic()):
            self._stop()
        if self._rule.takeovers > before:
            log(self, ERROR, f"the guard fell silent for {SILENCE} s while the robot moved: zeros")

    def _stop(self) -> None:
        zero = self._type()
        if isinstance(zero, TwistStamped):
            zero.header.stamp, zero.header.frame_id = self.get_clock().now().to_msg(), self._frame
        self._velocity.publish(zero)

    def _live(self) -> None:
        """Give a sign of life, unless only itself is on the topic: without its type it would hear nothing."""
        if self._guard.get_publisher_count() > 1 and self._asked == math.inf:
            self._alive.publish(Empty())

    def may_end(self, asked: bool) -> bool:
        """Return whether the process may end, which was asked to end or not."""
        now = time.monotonic()
        if self._guard.get_publisher_count() > 1 or self._rule.moves or self._rule.acts(now):
            self._guarded = now
        if asked:
            self._asked = min(self._asked, now)
            return self._guarded < now or now - self._asked > LINGER
        return os.getppid() != self._parent and now - self._guarded > ALONE

    def halt(self) -> None:
        """Send zeros if a motion is in force, and wait until the robot has received them."""
        self._look()
        if self._rule.moves:
            for _ in range(3):
                self._stop()
            self._velocity.wait_for_all_acked(Duration(seconds=0.5))


def main(argv: Sequence[str] | None = None) -> int:
    """Run ``cmd_vel_standby``, before all other processes and the guard, where the system permits a real-time priority."""
    lifelines = leave()
    precede(2)
    return run([CmdVelStandby], argv, local=False, lifelines=lifelines)
