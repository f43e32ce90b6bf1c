"""Wheels by tape: what a person measures of parts of a drive, the legs, against what its odometry says.

Each measurement is a number of the pose at a part's end in the frame of its start. Generalized least squares over all parts
gives the wheels' parameters. Its covariance is that of the tape plus that of the execution, propagated along the path.

References:
    Borenstein, Feng, "Measurement and correction of systematic odometry errors in mobile robots", *IEEE Transactions on
        Robotics and Automation* 12 (1996): UMBmark, squares driven both ways.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from scipy.optimize import least_squares

from turtlebot_gym.drive import Drive, known
from turtlebot_gym.files import read_text
from turtlebot_gym.models.angles import TWO_PI, wrap_all
from turtlebot_gym.parameters import REFERENCE_PERIOD, Noise
from turtlebot_gym.presets import WHEEL
from turtlebot_gym.validation import POSITIVE, check_fields, short_repr
from turtlebot_gym_lab.calibration.calibrate import Calibration, detect_kind
from turtlebot_gym_lab.calibration.coordinates import ALPHAS, PARAMETERS, value_of, with_values
from turtlebot_gym_lab.calibration.estimates import FINE, MOTIONS, WHEELS, CalibrationEstimate
from turtlebot_gym_lab.calibration.fit import Z
from turtlebot_gym_lab.calibration.verdict import Verdict
from turtlebot_gym_lab.calibration.windows import PARAMETERS as WHEEL_PARAMETERS
from turtlebot_gym_lab.calibration.windows import USUAL, Array

NAMES = WHEEL_PARAMETERS[:3]
"""Parameters of the wheels."""
FREE, TYPICAL = np.array([0.3, 0.5, 0.5]), np.array([0.1, 0.3, 0.1])
"""Standard deviations of a prior so wide that it counts only where nothing was measured, and typical differences."""
GUESSED = (2, 0, 1)
"""The order in which parameters that nothing determines take the preset's value: veer, scale, turn scale."""
LEVEL = 1e-4
"""Level of the test whether the measurements agree."""
ROUNDS = 3
"""Rounds of least squares, each with the covariance of the one before it."""
RATIOS = (0.2, 5.0)
"""Ratios of a measurement to odometry that wheels reach; others are a mistake of units or of the log."""
TAPE, PROTRACTOR = 0.0025, math.radians(1.0)
"""Usual standard deviations of a measured place, m, and heading, rad."""
COLUMNS = ("log", "start", "end", "distance", "x", "y", "turns")
"""Columns of a table of measurements."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Leg:
    """A part of a drive and its measurements; NaN where there is none."""

    drive: Drive
    """The part, with wheel odometry or twists."""
    distance: float = math.nan
    """Straight from its start to its end, m."""
    x: float = math.nan
    """Place of its end in the frame of its start: ahead, m ..."""
    y: float = math.nan
    """... and to the left, m."""
    turn: float = math.nan
    """Turn in all, to the left, rad."""
    place_deviation: Annotated[float, POSITIVE] = TAPE
    """Standard deviation of a measured distance, x or y, m."""
    heading_deviation: Annotated[float, POSITIVE] = PROTRACTOR
    """Standard deviation of a measured turn, and of the frame of x and y, rad."""

    def __post_init__(self) -> None:
        check_fields(self, "")
        if not np.isfinite(self.measured).any():
            raise ValueError("distance, x, y or turn must be measured, got none of them.")

    @property
    def measured(self) -> Array:
        """Distance, x, y and turn, shape (4,)."""
        return np.array([self.distance, self.x, self.y, self.turn])


class _Steps(NamedTuple):
    """The n steps of a drive by its wheels."""

    dt: Array
    """Shape (n,), s."""
    ahead: Array
    """Distance of each step by odometry, shape (n,), m."""
    turn: Array
    """Shape (n,), rad."""


def _steps_of(drive: Drive) -> _Steps:
    """Return the steps of a drive by its wheels: of its odometry, if the poses are the wheels', and of its twists otherwise."""
    if drive.has_odometry and detect_kind(drive) == WHEELS:
        rows = np.flatnonzero(known(drive.odometry))
        time, at = np.unique(drive.time[rows], return_index=True)
        poses = drive.odometry[rows[at]]
        step = np.diff(poses, axis=0)
        turn = wrap_all(step[:, 2])
        middle = poses[:-1, 2] + 0.5 * turn
        return _Steps(np.diff(time), np.cos(middle) * step[:, 0] + np.sin(middle) * step[:, 1], turn)
    dt, (v, omega) = np.diff(drive.time), np.nan_to_num(drive.twist[1:]).T
    return _Steps(dt, v * dt, omega * dt)


def leg_of(drive: Drive, *, turns: float = math.nan, loop: bool = False, **measured: float) -> Leg:
    """Return a leg as a person states it.

    Args:
        drive: The part of a drive.
        turns: Turns in all, to the side to which odometry turns.
        loop: Whether it ends where it began, with the same heading; unless ``turns`` is given, after the whole number of turns
            that is next to odometry's.
        **measured: Other fields of `Leg`.

    Raises:
        ValueError: If nothing is measured, or the part has fewer than two rows.
    """
    if len(drive) < 2:
        raise ValueError("a part of a drive needs two rows, got fewer.")
    if loop:
        measured |= {"x": 0.0, "y": 0.0}
    turn = float(_steps_of(drive).turn.sum())
    if math.isfinite(turns) or loop:
        count = math.copysign(turns, turn) if math.isfinite(turns) else round(turn / (TWO_PI))
        measured["turn"] = TWO_PI * count
    return Leg(drive=drive, **measured)


def read_legs(path: Path, log: Drive, read: Callable[[Path], Drive], **deviations: float) -> list[Leg]:
    """Return the legs of a table of measurements with some of `COLUMNS`; empty cells are not measured.

    Args:
        path: The table, with commas.
        log: The drive of rows without ``log``.
        read: Reads another log, a file beside the table.
        **deviations: Standard deviations, see `Leg`.

    Raises:
        ValueError: If the table is not as described; the message names file and line.
    """
    legs, drives = [], {"": log}
    rows = csv.DictReader(read_text(path, most=csv.field_size_limit()).splitlines(), skipinitialspace=True)
    if not rows.fieldnames or not set(rows.fieldnames) <= set(COLUMNS):
        raise ValueError(f"{path}: the columns must be some of {', '.join(COLUMNS)}, got {short_repr(rows.fieldnames)}.")
    for row in rows:
        try:
            name = row.pop("log", "") or ""
            numbers = {key: float(cell) for key, cell in row.items() if cell}
            drive = drives[name] = drives[name] if name in drives else read(path.parent / name)
            since = drive.time - drive.time[0]
            first, last = np.searchsorted(since, [numbers.pop("start", 0.0), numbers.pop("end", math.inf)])
            legs.append(leg_of(drive[first : last + 1], **numbers, **deviations))  # pyright: ignore[reportArgumentType]
        except (TypeError, ValueError) as error:
            raise ValueError(f"{path}, line {rows.line_num}: {error!s:.300}") from error
    return legs


class _DrivenLegs(NamedTuple):
    measured: Array
    """Distance, x, y, and the turn in all, in the frame of the start, shape (4,)."""
    heading: Array
    """In the middle of each step, shape (n,), rad."""
    steps: Array
    """In x and y, shape (2, n), m."""


def _driven(path: _Steps, wheels: Array) -> _DrivenLegs:
    """Return the motion of wheels along a path."""
    scale, turn_scale, veer = wheels
    turn = scale * (turn_scale * path.turn + veer * path.ahead)
    heading = np.cumsum(turn) - 0.5 * turn
    steps = scale * path.ahead * np.stack([np.cos(heading), np.sin(heading)])
    x, y = steps.sum(axis=1)
    return _DrivenLegs(np.array([math.hypot(x, y), x, y, turn.sum()]), heading, steps)


def _covariance(leg: Leg, path: _Steps, wheels: Array, noise: Noise) -> Array:
    """Return the covariance of distance, x, y and turn by the noise of the execution and of the tape, shape (4, 4)."""
    (distance, x, y, _), heading, steps = _driven(path, wheels)
    scale, turn_scale, _ = wheels
    # What is left to drive from the middle of each step is the lever of its turn.
    left_x, left_y = np.array([[x], [y]]) - np.cumsum(steps, axis=1) + 0.5 * steps
    of_ahead = np.stack([np.cos(heading), np.sin(heading), np.zeros_like(heading)])
    of_turn = np.stack([-left_y, left_x, np.ones_like(heading)])
    p = noise.process
    a, t = (REFERENCE_PERIOD / path.dt) * np.stack([path.ahead**2, path.turn**2])
    moved, turned = scale**2 * (p.alpha1 * a + p.alpha2 * t), (scale * turn_scale) ** 2 * (p.alpha3 * a + p.alpha4 * t)
    covariance = (of_ahead * moved) @ of_ahead.T + (of_turn * turned) @ of_turn.T
    of_pose = np.array([[x / max(distance, 1e-9), y / max(distance, 1e-9), 0.0], *np.eye(3)])
    at_start = leg.heading_deviation * np.array([0.0, -y, x, 0.0])  # the frame of x and y is laid out by hand, too
    tape = np.diag([leg.place_deviation**2] * 3 + [leg.heading_deviation**2]) + np.outer(at_start, at_start)
    return of_pose @ covariance @ of_pose.T + tape


class _TapeFit(NamedTuple):
    wheels: Array
    covariance: Array
    """Of `NAMES`, shape (3, 3)."""
    chi_squared: float
    """Sum of the squared whitened residuals."""


def _fitted(legs: Sequence[Leg], paths: Sequence[_Steps], start: Noise, free: NDArray[np.bool_]) -> _TapeFit:
    """Return the likeliest free parameters; the others have the values of the start."""
    pairs = list(zip(legs, paths, strict=True))
    masks = [np.isfinite(leg.measured) for leg in legs]
    usual = np.array([value_of(start, name) for name in NAMES])
    roots = 1.0 / FREE[free]
    wheels, info, z = usual.copy(), np.zeros((3, 3)), np.zeros(0)
    for _ in range(ROUNDS if free.any() else 0):
        V = [_covariance(leg, path, wheels, start)[np.ix_(s, s)] for (leg, path), s in zip(pairs, masks, strict=True)]
        whiten = [np.linalg.inv(np.linalg.cholesky(covariance)) for covariance in V]

        def rest(x: Array, whiten: Sequence[NDArray[Any]] = whiten) -> Array:
            tried = usual.copy()
            tried[free] = x
            off = [leg.measured - _driven(path, tried).measured for leg, path in pairs]
            parts = [W @ error[s] for W, error, s in zip(whiten, off, masks, strict=True)]
            return np.concatenate([*parts, roots * (x - usual[free])])

        solution = least_squares(rest, wheels[free], x_scale=TYPICAL[free])
        wheels[free], z = solution.x, solution.fun[: -int(free.sum())]
        info[np.ix_(free, free)] = solution.jac.T @ solution.jac
    covariance = np.zeros((3, 3))
    covariance[np.ix_(free, free)] = np.linalg.inv(info[np.ix_(free, free)])
    return _TapeFit(wheels, covariance, float(z @ z))


def calibrate_by_tape(legs: Sequence[Leg], *, start: Noise = WHEEL) -> Calibration:
    """Fit the wheels' parameters to what was measured of parts of drives.

    Args:
        legs: The parts.
        start: Noise model whose alphas are the odometry's noise, and whose wheels are used where nothing was measured.

    Raises:
        ValueError: If there are no legs, or a measurement is far from odometry.
    """
    if not legs:
        raise ValueError("legs must hold at least one measurement, got none.")
    paths = [_steps_of(leg.drive) for leg in legs]
    for leg, path in zip(legs, paths, strict=True):
        _require_likely(leg, path)
    free = np.ones(3, np.bool_)
    fit = _fitted(legs, paths, start, free)
    estimates = {}
    for at in GUESSED:
        if math.sqrt(fit.covariance[at, at]) > FINE[NAMES[at]]:
            free[at], estimates[NAMES[at]] = False, _estimate(fit, at, f"{MOTIONS[NAMES[at]]}, and measure it")
            fit = _fitted(legs, paths, start, free)
    estimates |= {NAMES[at]: _estimate(fit, at, "") for at in range(3) if free[at]}
    noise = with_values(start, {name: float(fit.wheels[at]) for at, name in enumerate(NAMES)})
    numbers = int(sum(np.isfinite(leg.measured).sum() for leg in legs))
    return Calibration(
        noise=noise,
        likeliest=noise,
        estimates={name: estimates[name] for name in NAMES},
        unknown=dict.fromkeys(ALPHAS, "the preset's: a tape says nothing about noise; record the truth"),
        verdict=_verdict(fit.chi_squared, numbers, int(free.sum())),
        kind=WHEELS,
        has_truth=False,
        integrator="midpoint",
        remarks=tuple(dict.fromkeys(remark for leg in legs for remark in leg.drive.remarks)),
        drive=legs[0].drive,
        measured=numbers,
    )


def _estimate(fit: _TapeFit, at: int, remedy: str) -> CalibrationEstimate:
    value, off = float(fit.wheels[at]), Z * math.sqrt(fit.covariance[at, at])
    return CalibrationEstimate(value=value, low=value - off, high=value + off, unit=PARAMETERS[NAMES[at]].unit, remedy=remedy)


def _require_likely(leg: Leg, path: _Steps) -> None:
    distance, _, _, turn = _driven(path, USUAL[:3]).measured
    for name, measured, driven, least in (("distance", leg.distance, distance, 0.2), ("turn", leg.turn, turn, 1.0)):
        if abs(measured) > least and not RATIOS[0] < driven / measured < RATIOS[1]:
            text = f"the {name} by tape is {measured:.4g}, and by odometry {driven:.4g} (m, rad)"
            raise ValueError(f"{text}: is it of this part of the log, and in the right unit?")


def _verdict(chi_squared: float, numbers: int, parameters: int) -> Verdict:
    """Return whether the measurements agree with each other."""
    degrees = numbers - parameters
    if not parameters:
        is_good, text = False, "The measurements determine no parameter of the wheels."
    elif degrees <= 0:
        is_good, text = True, "As many numbers as parameters: nothing tests whether they agree. Measure again, or both ways."
    else:
        is_good = bool(stats.chi2.sf(chi_squared, degrees) >= LEVEL)
        how = "agree" if is_good else "contradict each other or the model"
        text = f"The measurements {how} (chi-squared {chi_squared:.1f} for {degrees})."
    return Verdict(is_good, text)
