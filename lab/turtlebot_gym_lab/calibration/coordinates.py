"""Parameters of a noise model as unbounded search coordinates, in which likelihoods are nearly quadratic."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.parameters import Noise

VARIANCE, PROBABILITY, SIZE, PLAIN = "variance", "probability", "size", "plain"


class _Parameter(NamedTuple):
    part: str
    """"process" or "odometry"."""
    field: str
    at: int | None
    """Its index, in a field that holds several numbers."""
    kind: str
    unit: str
    scale: float
    """Typical step of its coordinate."""


PARAMETERS = {
    "R_x": _Parameter("odometry", "R", 0, VARIANCE, "m^2", 0.01),
    "R_y": _Parameter("odometry", "R", 1, VARIANCE, "m^2", 0.01),
    "R_theta": _Parameter("odometry", "R", 2, VARIANCE, "rad^2", 0.01),
    "bias_x": _Parameter("odometry", "bias", 0, PLAIN, "m", 0.01),
    "bias_y": _Parameter("odometry", "bias", 1, PLAIN, "m", 0.01),
    "bias_theta": _Parameter("odometry", "bias", 2, PLAIN, "rad", 0.01),
    "spike_probability": _Parameter("odometry", "spike_probability", None, PROBABILITY, "", 0.05),
    "spike": _Parameter("odometry", "spike", None, SIZE, "rad", 0.05),
    "alpha1": _Parameter("process", "alpha1", None, VARIANCE, "", 0.02),
    "alpha2": _Parameter("process", "alpha2", None, VARIANCE, "m^2", 0.02),
    "alpha3": _Parameter("process", "alpha3", None, VARIANCE, "rad^2/m^2", 0.02),
    "alpha4": _Parameter("process", "alpha4", None, VARIANCE, "", 0.02),
    "scale": _Parameter("process", "scale", None, PLAIN, "", 0.01),
    "turn_scale": _Parameter("process", "turn_scale", None, PLAIN, "", 0.01),
    "veer": _Parameter("process", "veer", None, PLAIN, "rad/m", 0.01),
}
"""Every parameter that a likelihood determines, by name; drop-outs are counted instead."""
MEASURED = ("R_x", "R_y", "R_theta", "bias_x", "bias_y", "bias_theta", "spike_probability", "spike")
"""Parameters of a measured pose."""
ALPHAS = ("alpha1", "alpha2", "alpha3", "alpha4")
"""Parameters of the execution noise."""


def value_of(noise: Noise, name: str) -> float:
    """Return a parameter of a noise model."""
    part, field, at, *_ = PARAMETERS[name]
    value = getattr(getattr(noise, part), field)
    return value if at is None else value[at]


def with_values(noise: Noise, values: Mapping[str, float]) -> Noise:
    """Return a noise model with some parameters replaced."""
    changed: dict[str, dict[str, object]] = {"process": {}, "odometry": {}}
    for name, value in values.items():
        part, field, at, *_ = PARAMETERS[name]
        if at is None:
            changed[part][field] = value
        else:
            old = changed[part].get(field, getattr(getattr(noise, part), field))
            assert isinstance(old, tuple)
            changed[part][field] = (*old[:at], value, *old[at + 1 :])
    return Noise(process=replace(noise.process, **changed["process"]), odometry=replace(noise.odometry, **changed["odometry"]))  # type: ignore[arg-type]


def _coordinate(name: str, value: float) -> float:
    """Return a value's coordinate: a variance's root, a probability's arc sine."""
    kind = PARAMETERS[name].kind
    if kind == VARIANCE:
        return math.sqrt(value)
    return math.asin(math.sqrt(value)) if kind == PROBABILITY else value


def _natural(name: str, x: float) -> float:
    kind = PARAMETERS[name].kind
    if kind == VARIANCE:
        return x * x
    if kind == PROBABILITY:
        return math.sin(x) ** 2
    return abs(x) if kind == SIZE else x


def natural_interval(name: str, low: float, high: float) -> tuple[float, float]:
    """Return the range of a parameter between two coordinates; the higher one is positive."""
    kind = PARAMETERS[name].kind
    if kind == PLAIN:
        return low, high
    top = min(high, 0.5 * math.pi) if kind == PROBABILITY else max(high, -low) if low < 0.0 else high
    return _natural(name, max(low, 0.0)), _natural(name, top) if math.isfinite(top) else math.inf


def to_coordinates(noise: Noise, names: Sequence[str]) -> NDArray[np.float64]:
    """Return the coordinates of a noise model's parameters, shape (n,)."""
    return np.array([_coordinate(name, value_of(noise, name)) for name in names])


def from_coordinates(noise: Noise, names: Sequence[str], x: NDArray[np.float64]) -> Noise:
    """Return a noise model with the parameters at some coordinates."""
    return with_values(noise, {name: _natural(name, float(number)) for name, number in zip(names, x, strict=True)})
