"""A drive for calibrating a robot's odometry: all speeds and turning rates, in both directions, within a circle."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, NamedTuple

from turtlebot_gym.config import POSITIVE, Range, check_fields
from turtlebot_gym.estimation.agreement import Agreement
from turtlebot_gym.models.angles import wrap
from turtlebot_gym.models.unicycle import limit
from turtlebot_gym.parameters import Noise
from turtlebot_gym.presets import make_robot
from turtlebot_gym.robots import Robot
from turtlebot_gym.values import STOP, Command, Odometry, Pose
from turtlebot_gym_ros.node.block import Input, On, Output

LEVELS = (1.0, 0.5, 0.75, 0.25)
"""Speed levels, as shares of the highest speed and turning rate; fast ones first."""
REACH = 0.5
"""Length of a straight, and diameter of both circles side by side, as shares of the radius ..."""
LONGEST = 1.0
"""... but no longer than this, m."""
PAUSE = 1.0
"""Length of a stop, s: at rest only measurement noise remains."""
MARGIN = 0.25
"""Margin inside the circle at which the robot turns back, m: for the distance until a command acts, and measurement noise."""
HOME = 0.25
"""Share of the radius within which the robot counts as back."""
ASIDE = 0.5
"""Bearing of the centre above which the robot turns on the spot instead of driving an arc, rad."""


class _DriveLeg(NamedTuple):
    """A command and its duration."""

    command: Command
    duration: float
    """s"""


def _script(robot: Robot, *, speed: float, turning: float, reach: float) -> Iterator[_DriveLeg]:
    """Yield one round of the drive, which would end where it began if the robot executed commands exactly.

    For each level: a straight, half a turn to the left, the straight back, half a turn to the right, a circle to the left and a
    circle to the right, with a stop after each.

    Args:
        robot: Robot whose limits hold, with the commanded curvature.
        speed: Highest speed, m/s.
        turning: Highest turning rate, rad/s.
        reach: Length of the straights, m.
    """
    for level in LEVELS:
        v, omega, curvature = level * speed, level * turning, 4.0 / reach
        for wish, length, angle in (
            (Command(v, 0.0), reach, 0.0),
            (Command(0.0, omega), 0.0, math.pi),
            (Command(v, 0.0), reach, 0.0),
            (Command(0.0, -omega), 0.0, math.pi),
            (Command(v, v * curvature), 0.0, 2.0 * math.pi),
            (Command(v, -v * curvature), 0.0, 2.0 * math.pi),
        ):
            command = limit(wish, robot)
            yield _DriveLeg(command, length / command.v if length else angle / abs(command.omega))
            yield _DriveLeg(STOP, PAUSE)


class CalibrationDrive:
    """Drive a script with all the motion that a calibration needs, within a circle around the start. It does NOT SEE OBSTACLES.

    It repeats straights, turns on the spot, circles and stops, at four speeds and in both directions, for a given time, and
    then releases the robot. The circle is judged by the odometry: before its edge the robot turns back to the centre and
    continues from there. It starts disabled, and should publish to the guard, on ``cmd_vel_in``.

    A reset restarts the script. The centre stays, unless the robot was carried out of the circle, so a gap in the odometry does
    not move the circle.

    Inputs: ``odometry`` (`Odometry`, on ``odom``, every message).
    Outputs: ``command`` (`Command`, on ``cmd_vel``).
    Parameters: those of `Params`.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Params:
        """Parameters of the drive."""

        robot: str = "burger"
        """A name in `turtlebot_gym.robots.ROBOTS`, or a FILE.yaml."""
        duration: Annotated[float, POSITIVE.of("s")] = 300.0
        """Length of the drive, s."""
        radius: Annotated[float, Range(0.6, 100.0, unit="m")] = 2.0
        """Radius of the circle around the start in which the robot stays by its odometry, m."""
        speed: Annotated[float, Range(0.0, 10.0, open_low=True, unit="m/s")] = 0.2
        """Highest speed, m/s; the robot's limits hold too."""
        turning: Annotated[float, Range(0.0, 10.0, open_low=True, unit="rad/s")] = 1.5
        """Highest turning rate, rad/s; the robot's limits hold too."""

        def __post_init__(self) -> None:
            check_fields(self, "")

    inputs = {"odometry": Input(topic="odom", type=Odometry, reliable=False, sole=True)}
    outputs = {"command": Output(topic="cmd_vel", type=Command, stop=STOP)}
    trigger = On("odometry")

    def __init__(self, params: Params) -> None:
        self._p, self._robot = params, make_robot(params.robot)
        reach = min(REACH * params.radius, LONGEST)
        self._legs = tuple(_script(self._robot, speed=params.speed, turning=params.turning, reach=reach))
        self._center: Pose | None = None
        self._agreement = Agreement(self._robot, Noise(), leaps=True)  # of what noise is unknown
        self.reset()

    def reset(self) -> None:
        """Restart the script."""
        self._elapsed, self._at, self._left = 0.0, 0, self._legs[0].duration
        self._returns, self._is_first = False, True
        self._agreement.begin()

    def step(self, dt: float, odometry: Odometry) -> dict[str, Command]:
        """Return the command for the current time; nothing after the end.

        Raises:
            ValueError: If the pose repeats itself to the bit though the twist says that the robot moves (`agreement`).
        """
        self._agreement.judge(dt, odometry)
        if self._agreement.cause:
            raise ValueError(f"odometry is not believed: {self._agreement.cause}")
        pose = odometry.pose
        if self._center is None or (self._is_first and self._distance(pose, self._center) > self._p.radius):
            self._center = pose
        self._is_first = False
        self._elapsed += dt
        if self._elapsed >= self._p.duration:
            return {}
        self._left -= dt
        if self._returns:
            if self._distance(pose, self._center) > HOME * self._p.radius:
                return {"command": self._homeward(pose, self._center)}
            self._returns, self._left = False, 0.0
        if self._left <= 0.0:
            self._at = (self._at + 1) % len(self._legs)
            self._left += self._legs[self._at].duration
        command = self._legs[self._at].command
        self._returns = self._leaves(pose, self._center, command)
        return {"command": self._homeward(pose, self._center) if self._returns else command}

    def _leaves(self, pose: Pose, center: Pose, command: Command) -> bool:
        """Return whether a command leads outwards at the edge of the circle."""
        outwards = math.cos(pose.theta - math.atan2(pose.y - center.y, pose.x - center.x))
        return command.v * outwards > 0.0 and self._distance(pose, center) > self._p.radius - MARGIN

    def _homeward(self, pose: Pose, center: Pose) -> Command:
        """Return the command that leads to the centre."""
        bearing = wrap(math.atan2(center.y - pose.y, center.x - pose.x) - pose.theta)
        v, turning = 0.5 * self._p.speed, 0.5 * self._p.turning
        if abs(bearing) > ASIDE:
            return limit(Command(0.0, math.copysign(turning, bearing)), self._robot)
        return limit(Command(v, min(max(bearing, -turning), turning)), self._robot)

    @staticmethod
    def _distance(pose: Pose, center: Pose) -> float:
        return math.hypot(pose.x - center.x, pose.y - center.y)
