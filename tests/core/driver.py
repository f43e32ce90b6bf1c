"""A stand-in for a robot and its driver, which may lie. It shares no code with the package's simulation."""

import math
from collections import deque

from turtlebot_gym.values import Command, Odometry, Pose


def wrapped(angle):
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


def _swapped(p, t, d):
    return (p[1], p[0], p[2]), t


LIES = {
    "pose frozen": lambda p, t, d: (d.first[0], t),
    "twist frozen": lambda p, t, d: (p, d.first[1]),
    "all frozen": lambda p, t, d: d.first,
    "stands": lambda p, t, d: (d.first[0], (0.0, 0.0)),
    "heading frozen": lambda p, t, d: ((p[0], p[1], d.first[0][2]), t),
    "dead IMU": lambda p, t, d: ((p[0], p[1], d.first[0][2]), (t[0], 0.0)),
    "twist 0": lambda p, t, d: (p, (0.0, 0.0)),
    "turn sign": lambda p, t, d: (p, (t[0], -t[1])),
    "speed sign": lambda p, t, d: (p, (-t[0], t[1])),
    "heading sign": lambda p, t, d: ((p[0], p[1], -p[2]), t),
    "mm": lambda p, t, d: ((1e3 * p[0], 1e3 * p[1], p[2]), (1e3 * t[0], t[1])),
    "cm": lambda p, t, d: ((1e2 * p[0], 1e2 * p[1], p[2]), (1e2 * t[0], t[1])),
    "twist in mm/s": lambda p, t, d: (p, (1e3 * t[0], t[1])),
    "twist in deg/s": lambda p, t, d: (p, (t[0], math.degrees(t[1]))),
    "degrees": lambda p, t, d: ((p[0], p[1], math.degrees(p[2])), t),
    "x and y": _swapped,
    "y sign": lambda p, t, d: ((p[0], -p[1], p[2]), t),
    "late heading": lambda p, t, d: ((p[0], p[1], d.poses[0][2]), t),
    "scale 2": lambda p, t, d: ((2.0 * p[0], 2.0 * p[1], p[2]), t),
    "reset": lambda p, t, d: ((p[0] - d.first[0][0], p[1] - d.first[0][1], p[2]), t),
}
"""Lies of a driver: functions of a pose, a twist and the driver, which return what it says."""


class Driver:
    """A unicycle that holds its last command, at 20 Hz.

    Args:
        lie: A key of `LIES`, "blocked" for wheels that stand, "crossed" for wheels that turn the other way, or None.
        since: Time of the lie, s.
        delay: Time from a command to its effect, s.
        acceleration: Limits of the robot, m/s^2 and rad/s^2.
        grid: Resolution of commands.
    """

    dt = 0.05

    def __init__(self, lie=None, since=0.0, *, delay=0.0, acceleration=(math.inf, math.inf), grid=0.0):
        self.lie, self.since, self.acceleration, self.grid = lie, since, acceleration, grid
        self.time, self.way, self.true, self.twist = 0.0, 0.0, (0.0, 0.0, 0.0), (0.0, 0.0)
        self.commands = deque([(0.0, 0.0)] * round(delay / self.dt))
        self.poses = deque([self.true], 9)
        self.first = None

    def step(self, command):
        """Drive for an interval and return what the driver says."""
        self.commands.append(tuple(round(value / self.grid) * self.grid if self.grid else value for value in command))
        order = self.commands.popleft()
        lies = self.lie is not None and self.time >= self.since
        if lies and self.lie == "blocked":
            order = 0.0, 0.0
        if lies and self.lie == "crossed":
            order = order[0], -order[1]
        v, omega = (
            now + max(-most * self.dt, min(most * self.dt, goal - now))
            for now, goal, most in zip(self.twist, order, self.acceleration, strict=True)
        )
        x, y, theta = self.true
        self.true = (
            x + v * self.dt * math.cos(theta + 0.5 * omega * self.dt),
            y + v * self.dt * math.sin(theta + 0.5 * omega * self.dt),
            theta + omega * self.dt,
        )
        self.twist, self.time, self.way = (v, omega), self.time + self.dt, self.way + abs(v) * self.dt
        self.poses.append(self.true)
        said = self.true, self.twist
        if lies and self.lie in LIES:
            self.first = self.first or said
            said = LIES[self.lie](*said, self)
        (x, y, theta), twist = said
        return Odometry(Pose(x, y, wrapped(theta)), Command(*twist), True)
