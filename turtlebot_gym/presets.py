"""Named noise models, and filter tunings derived from them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from turtlebot_gym import parameters
from turtlebot_gym.config import given, refusal, split, vary
from turtlebot_gym.estimation.gyro import Gyro
from turtlebot_gym.estimation.objects import Copied, kinds_of, variances_of
from turtlebot_gym.estimation.plain import Plain
from turtlebot_gym.files import load_object
from turtlebot_gym.parameters import FilterTuning, FixNoise, Noise, OdometryNoise, ProcessNoise
from turtlebot_gym.robots import ROBOTS, Robot

SPEED_FLOOR, TURN_FLOOR = 0.005, 0.01
"""Least standard deviations of the executed twist that the matched filter assumes, m/s and rad/s per step of 0.1 s. A filter
that assumed perfect motion would soon ignore its measurements, and with them a speed error of 2 %."""
VARIANCE_FLOOR = 1e-6
"""Least measurement variance that the matched filter assumes: (1 mm)^2, (1 mrad)^2."""

HEADING_GATE = 6.635
"""Normalized innovation squared that 1 % of correct headings exceed (chi-square, 1 degree of freedom)."""
POSE_GATE = {"gate": 16.27, "max_rejections": 3, "lockout": 1.0}
"""The gate of all filters that correct, see `Kalman`: 0.1 % of correct poses exceed it (chi-square, 3 degrees of freedom).
A leap that lasts half a second is kept out; after a second the belief gives way."""

ODOMETRY_LEAP = {"leap": 0.3, "leap_turn": 0.3}
"""What dead reckoning takes for a leap of the odometry, m and rad, see `parameters.DeadReckoning`."""

CLEAN = Noise()
"""No noise, as in most simulators used for training."""

TUTORIAL = Noise(odometry=OdometryNoise(R=(0.05, 0.05, 0.1), spike_probability=0.02, spike=0.3))
"""The reference system as its code runs: 0.05, 0.05, 0.1 are *variances*, so 22 cm, 22 cm and 18 degrees. A spike is then
smaller than one standard deviation, and no filter can detect it."""

DOCUMENTED = Noise(
    odometry=OdometryNoise(R=(0.05**2, 0.05**2, 0.1**2), bias=(0.02, 0.0, 0.0), spike_probability=0.02, spike=0.3)
)
"""The reference system as its comments describe it: 5 cm, 5 cm and 0.1 rad are standard deviations. It includes the bias of 2
cm in x of one of its variants, and its spikes, which are now three standard deviations."""

WHEEL = Noise(
    process=ProcessNoise(alpha1=0.0029, alpha2=0.0064, alpha3=0.0062, alpha4=0.0049), odometry=OdometryNoise(wheel=True)
)
"""A robot with wheel odometry alone. The drift is that of a Wifibot, fitted to two recorded drives with
motion-capture truth by `turtlebot-gym calibrate`: 1.6 and 2.7 cm per metre. No filter can remove it."""

ROUGH = Noise(
    process=ProcessNoise(slip=0.5, slip_start=0.01, slip_end=0.2),
    odometry=OdometryNoise(R=(0.02**2, 0.02**2, 0.02**2), spike_probability=0.02, spike=0.3, dropout_probability=0.05),
)
"""Harsh use of a good sensor, chosen to separate filters: 2 cm and 0.02 rad, so that a heading spike is 15 standard deviations;
5 % of the measurements are lost; bursts of slip of half a second cost half of the motion."""

_TWIST = ProcessNoise(alpha1=0.017, alpha2=0.0068, alpha3=0.0021, alpha4=0.0065, scale=0.979, turn_scale=1.009)
_POSE = OdometryNoise(wheel=True, dropout_probability=0.00013, gap_end=0.065, reset_probability=1.2e-5)
RECORDED = Noise(
    process=replace(_TWIST, veer=0.0359, slip=0.5, slip_start=0.0005, slip_end=0.2),
    odometry=replace(_POSE, leap_probability=2.4e-5, leap=0.34, leap_turn=1.06, reverse_probability=0.0026),
)
"""Wheel odometry as recordings of three robots and the messages of a fourth have it, fitted with intervals,
see `benchmarks/recorded.json`: wheels, track and radii that are not as assumed, gaps as of late messages, leaps that stay.
Slips, resets and reverse motion counted as forward are in none of these recordings: their rates are half an event in all of the
time, and the depth and length of a slip are those of `rough`. No filter can remove the drift."""

NOISES = {"clean": CLEAN, "tutorial": TUTORIAL, "documented": DOCUMENTED, "wheel": WHEEL, "rough": ROUGH, "recorded": RECORDED}
"""Noise models by name."""

FIXES = {
    "beacons": FixNoise(R=(0.1**2, 0.1**2), period=0.5),
    "late": FixNoise(R=(0.1**2, 0.1**2), period=0.5, delay=0.3, dropout_probability=0.3),
    "localization": FixNoise(R=(0.05**2, 0.05**2, 0.05**2), period=0.5, delay=0.2),
    "markers": FixNoise(R=(0.03**2, 0.03**2, 0.03**2), period=0.2, delay=0.1, dropout_probability=0.5),
    "motion-capture": FixNoise(R=(0.002**2, 0.002**2, 0.005**2), period=0.1),
}
"""External pose sensors by name: a position by radio, in time, or late and lossy; localization in a map; markers on walls, seen
half of the time; motion capture. Illustrative values that differ clearly: put the numbers of a real device into a file."""

TUTORIAL_FILTER = FilterTuning(
    Q=(0.01, 0.01, 0.02, 0.1, 0.1), R=(0.05, 0.05, 0.1), from_origin=True, kind=parameters.Tutorial()
)
"""The reference system's filter as written, for any noise: process noise that the plant does not have, a Jacobian that keeps
the velocities of the previous step, and a heading innovation that jumps by 2 pi."""


_EXACT = {"scale": 1.0, "turn_scale": 1.0, "veer": 0.0}
"""A twist without the systematic errors that a filter can correct."""


def matched(noise: Noise) -> FilterTuning:
    """Return the tuning that matches the noise in use.

    R is the variance of the measurement: white noise and spikes. Q is that of the executed
    twist; bursts of slip enter by the long-run variance of their Markov chain, ``s^2 p (1 - p) (1 + r) / (1 - r)`` with p the
    share of time in a burst and r the chain's correlation from step to step. Both have floors. A covariance cannot express a
    bias, so a filter under bias is not consistent.
    """
    process, odometry = noise.process, noise.odometry
    spikes = odometry.spike_probability * odometry.spike**2
    R = (*odometry.R[:2], odometry.R[2] + spikes)
    change = process.slip_start + process.slip_end
    share = process.slip_start / change if change > 0.0 else 0.0
    bursts = process.slip**2 * share * (1.0 - share) * (2.0 - change) / change if change > 0.0 else 0.0
    return FilterTuning(
        Q=(0.0, 0.0, 0.0, SPEED_FLOOR**2, TURN_FLOOR**2),
        R=tuple(max(variance, VARIANCE_FLOOR) for variance in R),
        process=replace(process, **_EXACT, alpha1=process.alpha1 + bursts, alpha4=process.alpha4 + bursts, slip=0.0),
        kind=parameters.DeadReckoning(**ODOMETRY_LEAP) if odometry.wheel else parameters.Kalman(**POSE_GATE),
    )


def _calibrated(noise: Noise) -> FilterTuning:
    """Return the matched tuning that also knows, and corrects, the systematic errors of the twist."""
    tuning, errors = matched(noise), {name: getattr(noise.process, name) for name in _EXACT}
    return replace(tuning, process=replace(tuning.process, **errors))


def _gated(noise: Noise) -> FilterTuning:
    """Return the matched tuning for the noise without spikes, with a gate that refuses 1 % of correct headings."""
    tuning = matched(replace(noise, odometry=replace(noise.odometry, spike_probability=0.0)))
    is_corrected = not isinstance(tuning.kind, parameters.DeadReckoning)  # wheel odometry measures nothing
    return replace(tuning, kind=parameters.Gated(heading_gate=HEADING_GATE, **POSE_GATE)) if is_corrected else tuning


def _gyro(noise: Noise, imu: Any) -> FilterTuning:
    """Return the matched tuning of the filter `estimation.gyro`, for the gyro's noise, a `systems.sensors.ImuNoise`."""
    if not imu:
        raise ValueError("filter 'gyro' reads the sensor 'imu': choose one with imu=..., such as imu='calibrated'.")
    white, walk = max(imu.variance, TURN_FLOOR**2 * 1e-4), imu.bias_walk
    corrects = not noise.odometry.wheel
    gyro = Gyro(variance=white, bias_deviation=imu.bias_deviation, bias_walk=walk, corrects=corrects, **POSE_GATE)
    return replace(matched(noise), kind=gyro)


FILTERS: dict[str, Callable[..., FilterTuning]] = {
    "matched": matched,
    "calibrated": _calibrated,
    "tutorial": lambda noise: TUTORIAL_FILTER,
    "gated": _gated,
    "gyro": _gyro,
}
"""Filter tunings by name, as functions of the noise in use; `gyro` also takes that of the gyro."""


def make_robot(robot: str | Path | Mapping[str, Any] | Robot) -> Robot:
    """Return a robot: a name in `turtlebot_gym.robots.ROBOTS`, or what else `turtlebot_gym.config.given` takes."""
    return given(Robot, robot, ROBOTS, "robot")


def make_noise(noise: str | Path | Mapping[str, Any] | Noise) -> Noise:
    """Return a noise model: a name in `NOISES`, or what else `turtlebot_gym.config.given` takes."""
    return given(Noise, noise, NOISES, "noise")


def make_filter(tuning: Any, noise: Noise, *, imu: Any = ()) -> FilterTuning:
    """Return a filter tuning.

    Args:
        tuning: The tuning, a mapping of its fields, a variant or a file, see `turtlebot_gym.config.given`; a name in `FILTERS`,
            for the noise in use; an object of filterpy (see `estimation.objects`); a filter of one's own as a class with
            ``predict`` and ``update`` (see `estimation.plain`), or a function of the noise that returns a tuning; or
            "module:name" of any of these.
        noise: The noise in use.
        imu: Noise of the gyro, if there is one.
    """
    base, changes = split(tuning)
    if base is not tuning:
        return vary(make_filter(base, noise, imu=imu), changes, "filter")
    names: Any = FILTERS | {"gyro": partial(_gyro, imu=imu)}
    is_text = isinstance(tuning, str)
    made: Any = load_object(tuning) if is_text and ":" in tuning else names.get(tuning, tuning) if is_text else tuning
    if callable(made) and not (kinds_of(made) or _is_filter(made)):
        made = made(noise)
    corrects = not noise.odometry.wheel
    if kinds_of(made):
        kind = Plain(make=lambda tuning: Copied(made), corrects=corrects)
        return replace(matched(noise), R=variances_of(made), kind=kind)
    if _is_filter(made):
        if not isinstance(made, type):
            raise refusal("filter", "the class of a filter of one's own, not an object, unless of filterpy", made)
        return replace(matched(noise), kind=Plain(make=made, corrects=corrects))
    if made is not tuning and not isinstance(made, (FilterTuning, Mapping)):
        raise refusal("filter", "a tuning, or what makes one", made)
    return given(FilterTuning, made, names, "filter")


def _is_filter(given: object) -> bool:
    """Return whether something is a filter of one's own, see `estimation.plain`."""
    return hasattr(given, "predict") and hasattr(given, "update")
