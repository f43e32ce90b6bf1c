"""Checks that a drive is right, in metres, seconds and radians, and that it holds enough motion to fit."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.drive import Drive, known
from turtlebot_gym.models.angles import TWO_PI, wrap_all
from turtlebot_gym.robots import Robot

DEGREES = 180.0 / math.pi
FASTER, TURNING_FASTER = 20.0, 3.0
"""Multiples of a robot's limits of speed and turning rate that no robot of its kind reaches. Robots differ more in
speed than in turning rate, and degrees are only 57 times radians."""
FARTHER = 5.0
"""Ratio of the span of poses to the way of the wheels that no slip explains."""
FEWEST = 20
"""Fewest rows of a drive to calibrate."""
STILL = (0.5, 1.0)
"""Distance, m, and turn, rad, below which there is nothing to fit."""


def check(drive: Drive, robot: Robot, where: str) -> None:
    """Refuse a drive whose units are wrong, as `require_units` does, or in which nothing moves, with a `ValueError`."""
    if len(drive) < FEWEST:
        why = "".join(f"; {remark}" for remark in drive.remarks)
        raise ValueError(f"{where}: only {len(drive)} rows are good, too few to calibrate; {FEWEST} are needed{why}.")
    way, turn = _moved(drive)
    if way < STILL[0] and turn < STILL[1]:
        raise ValueError(
            f"{where}: the robot moves by {way:.2f} m and {turn:.2f} rad in all: there is nothing to fit to; record a drive of "
            "10 m or more, with turns."
        )
    require_units(drive, robot, where)


def require_units(drive: Drive, robot: Robot, where: str) -> None:
    """Refuse a drive that is not in metres, seconds and radians.

    The limits of a robot say which speeds are possible.

    Raises:
        ValueError: If a speed is impossible, or a heading is in degrees; the message says what to do.
    """
    _check_clock(drive, where)
    speed, rate = (float(np.percentile(np.abs(drive.twist[:, k]), 99.0)) for k in (0, 1))
    for name, value, limit, times, unit, wrong, factor in (
        ("speed", speed, robot.max_linear, FASTER, "m/s", "mm/s", 1000.0),
        ("turning rate", rate, robot.max_angular, TURNING_FASTER, "rad/s", "deg/s", DEGREES),
    ):
        if value > times * limit:
            raise ValueError(
                f"{where}: the {name} reaches {value:.4g} {unit}, and the robot's limit is {limit:.4g}: if it is in {wrong}, "
                f"divide it by {factor:.4g}; another robot is chosen by its name or file."
            )
    way, turn = _moved(drive)
    for source, poses in (("measured", drive.odometry), ("true", drive.truth)):
        _check_headings(poses, turn=turn, what=f"{where}: the {source}")
        places = poses[known(poses), :2]
        span = float(np.ptp(places, axis=0).max()) if len(places) else 0.0
        if span > FARTHER * max(way, STILL[0]):
            raise ValueError(
                f"{where}: the {source} positions span {span:.4g} m, and the wheels have made {way:.4g} m in all: "
                "if they are in millimetres, divide them by 1000."
            )


def _moved(drive: Drive) -> tuple[float, float]:
    """Return the way, m, and the turn, rad, that the twists of a drive make in all."""
    way, turn = (np.abs(drive.twist[1:]) * np.diff(drive.time)[:, None])[drive.joined[1:]].sum(axis=0)
    return float(way), float(turn)


def _check_clock(drive: Drive, where: str) -> None:
    """Refuse time in milli-, micro- or nanoseconds."""
    if drive.period > 1.5:
        for unit, factor in (("nanoseconds", 1e9), ("microseconds", 1e6), ("milliseconds", 1e3)):
            if drive.period / factor > 5e-4:
                raise ValueError(
                    f"{where}: rows are {drive.period:.4g} s apart: if time is in {unit}, divide it by {factor:.0e}."
                )


def _check_headings(poses: NDArray[np.float64], *, turn: float, what: str) -> None:
    """Refuse headings in degrees, judged by the turn that the twists make."""
    are_known = known(poses)
    if are_known.sum() < 10:
        return
    heading = poses[are_known, 2]
    change = np.abs(np.diff(heading))
    jumps = change[(change > 0.9 * 360.0) & (change < 1.02 * 360.0)]
    if jumps.size or (np.ptp(heading) > 8.0 * TWO_PI and _turn(heading) > 8.0 * (turn + TWO_PI)):
        moved = f"{what} heading runs from {heading.min():.4g} to {heading.max():.4g}"
        raise ValueError(f"{moved}: if it is in degrees, multiply it by pi/180.")


def _turn(heading: NDArray[np.float64]) -> float:
    """Return a heading's total change, each the shorter way round, rad."""
    return float(np.abs(wrap_all(np.diff(heading))).sum())
