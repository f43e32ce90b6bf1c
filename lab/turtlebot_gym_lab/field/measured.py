"""A straight of a given length or a turn by a given angle, by odometry, for a person to measure."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

from turtlebot_gym.models.angles import wrap
from turtlebot_gym.models.unicycle import limit
from turtlebot_gym.presets import make_robot
from turtlebot_gym.validation import POSITIVE, Range, check_fields
from turtlebot_gym.values import Command, Odometry, Pose
from turtlebot_gym_ros.blocks.calibration_drive import CalibrationDrive
from turtlebot_gym_ros.node.block import On

SLOWING = 1.0
"""Rate at which the speed falls with what is left to drive, 1/s."""
CREEPING = 0.2
"""Least share of the speed, so that the motion ends."""


class MeasuredDrive:
    """Drive straight ahead, or turn on the spot to the left, until odometry says that it is enough; then release the robot.

    Inputs and outputs are those of `CalibrationDrive`. It does NOT SEE OBSTACLES. Parameters: those of `Params`.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Params:
        """Parameters of the drive."""

        robot: str = "burger"
        """A name in `turtlebot_gym.robots.ROBOTS`, or a FILE.yaml."""
        turns: bool = False
        """Whether to turn instead of driving ahead."""
        amount: Annotated[float, POSITIVE.of("m or rad")] = 1.0
        """Distance, m, or angle, rad."""
        speed: Annotated[float, Range(0.0, 10.0, open_low=True, unit="m/s or rad/s")] = 0.15
        """Speed, m/s, or turning rate, rad/s; the robot's limits hold too."""

        def __post_init__(self) -> None:
            check_fields(self, "")

    inputs, outputs = CalibrationDrive.inputs, CalibrationDrive.outputs
    trigger = On("odometry")

    def __init__(self, params: Params) -> None:
        self._p, self._robot = params, make_robot(params.robot)
        self.reset()

    def reset(self) -> None:
        """Begin anew with the next odometry."""
        self._last: Pose | None = None
        self._driven = 0.0

    def step(self, dt: float, odometry: Odometry) -> dict[str, Command]:
        """Return the command for the current time; nothing after the end."""
        pose, last = odometry.pose, self._last or odometry.pose
        self._last = pose
        if self._p.turns:
            self._driven += wrap(pose.theta - last.theta)
        else:
            self._driven += math.hypot(pose.x - last.x, pose.y - last.y)
        left = self._p.amount - self._driven
        if left <= 0.0:
            return {}
        speed = min(self._p.speed, max(SLOWING * left, CREEPING * self._p.speed))
        return {"command": limit(Command(0.0, speed) if self._p.turns else Command(speed, 0.0), self._robot)}
