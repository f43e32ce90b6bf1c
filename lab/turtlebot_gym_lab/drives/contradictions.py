"""Whether the odometry of a recorded drive contradicts itself, as a robot's node would have said."""

from __future__ import annotations

import numpy as np

from turtlebot_gym.drive import Drive
from turtlebot_gym.estimation.agreement import Agreement
from turtlebot_gym.parameters import Noise, OdometryNoise
from turtlebot_gym.robots import Robot
from turtlebot_gym.values import Command, Odometry, Pose

FEWEST = 20
"""Number of rows with a pose, and with a twist, from which something is said."""
LEAST = 0.2, 1.0
"""Least limits that a robot is given, m/s and rad/s."""


def contradiction(drive: Drive) -> str | None:
    """Return when and how the poses and twists of a drive first contradict each other, or None.

    The robot is unknown: its limits are those of nearly all of its twists, and the noise of its poses is that between rows.
    """
    if min(np.isfinite(each).all(axis=1).sum() for each in (drive.odometry, drive.twist)) < FEWEST:
        return None
    poses, twists = drive.odometry, drive.twist
    moves = np.diff(poses, axis=0)
    interval = np.diff(drive.time)
    off = np.hypot(moves[:, 0], moves[:, 1]) - np.abs(twists[1:, 0]) * interval
    turned = np.angle(np.exp(1j * (moves[:, 2] - twists[1:, 1] * interval)))
    R = tuple(min(0.5 * (1.4826 * float(np.nanmedian(np.abs(each)))) ** 2, 1.0) for each in (off, off, turned))
    linear, angular = (max(float(np.nanquantile(np.abs(twists[:, k]), 0.99)), LEAST[k]) for k in (0, 1))
    robot = Robot(max_linear=min(linear, 100.0), max_angular=min(angular, 100.0))
    agreement = Agreement(robot, Noise(odometry=OdometryNoise(R=R)))
    for row in range(len(drive)):
        measured = bool(np.isfinite(poses[row]).all())
        pose = Pose(*poses[row].tolist()) if measured else Pose(0.0, 0.0, 0.0)
        if np.isfinite(twists[row]).all():
            agreement.judge(float(interval[row - 1]) if row else 0.0, Odometry(pose, Command(*twists[row].tolist()), measured))
        if agreement.cause:
            return f"at {drive.time[row] - drive.time[0]:.1f} s odometry contradicts itself: {agreement.cause}"
    return None
