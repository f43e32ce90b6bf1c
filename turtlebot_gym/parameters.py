"""Value types of the closed loop, and the parameters of its noise, its filter and its reward.

Conventions: SI units and radians; the world frame unless said; angles in [-pi, pi). Values are ``NamedTuple``s of floats, so
that the same functions take them in plain Python and in compiled code. Parameters are frozen dataclasses that check
themselves: whoever holds one holds a valid one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, NamedTuple, TypeVar

T = TypeVar("T")

REFERENCE_PERIOD = 0.1
"""Noise and tunings are stated for this control period, s; ``dt`` scales them (see `models.noise` and `estimation.ekf`)."""


class Pose(NamedTuple):
    """Planar pose in the world frame."""

    x: float
    """m"""
    y: float
    """m"""
    theta: float
    """Heading, rad, in [-pi, pi)."""


class Command(NamedTuple):
    """Planar twist in the body frame: what a robot is asked for."""

    v: float
    """Forward speed, m/s."""
    omega: float
    """Turning rate, rad/s."""


class State(NamedTuple):
    """Pose in the world frame and the twist, in the body frame, that moves it during the next control interval."""

    x: float
    y: float
    theta: float
    v: float
    omega: float


class Covariance(NamedTuple):
    """The 15 independent entries of the symmetric 5 x 5 covariance of a `State`, row by row from the diagonal on."""

    xx: float
    xy: float
    xt: float
    xv: float
    xw: float
    yy: float
    yt: float
    yv: float
    yw: float
    tt: float
    tv: float
    tw: float
    vv: float
    vw: float
    ww: float


class Belief(NamedTuple):
    """What a filter holds true: a Gaussian over the state."""

    mean: State
    covariance: Covariance


STOP = Command(0.0, 0.0)
"""The command that stops a robot."""


def variances(name: str, value: Any, size: int) -> tuple[float, ...]:
    """Return the diagonal of a covariance that was given as its diagonal or as a diagonal matrix.

    Args:
        name: What the error messages call it.
        value: Shape (size,) or (size, size).
        size: Number of components.

    Raises:
        ValueError: If the shape is wrong, a variance is negative or not finite, or a matrix is not symmetric and diagonal.
    """
    rows = value.tolist() if hasattr(value, "tolist") else value
    if not isinstance(rows, Sequence) or len(rows) != size:
        raise ValueError(f"{name} must hold {size} variances or be a {size} x {size} matrix, got {value!r}.")
    if any(isinstance(row, Sequence) for row in rows):
        if any(len(row) != size for row in rows):
            raise ValueError(f"{name} must be a {size} x {size} matrix, got {value!r}.")
        if any(rows[i][j] != rows[j][i] for i in range(size) for j in range(i)):
            raise ValueError(f"{name} must be symmetric, got {value!r}.")
        if any(rows[i][j] != 0.0 for i in range(size) for j in range(i)):
            raise ValueError(f"{name} must be diagonal (the components' noises are independent), got {value!r}.")
        rows = [rows[i][i] for i in range(size)]
    diagonal = tuple(float(variance) for variance in rows)
    if not all(0.0 <= variance < math.inf for variance in diagonal):  # also rejects NaN
        raise ValueError(f"{name} must hold finite variances >= 0, got {value!r}.")
    return diagonal


def choose(what: str, name: Any, known: Mapping[Any, T]) -> T:
    """Return a named choice.

    Raises:
        ValueError: If there is none of that name; the message lists those that there are.
    """
    if name not in known:
        raise ValueError(f"{what} must be one of {', '.join(map(repr, known))}, got {name!r}.")
    return known[name]


def require(owner: Any, rule: str, *names: str) -> None:
    """Check fields of a parameter class, which may be numbers or tuples of them, against a rule.

    Args:
        owner: The parameters.
        rule: "positive", "non-negative", "finite" or "a probability"; "positive" admits infinity.
        *names: The fields.

    Raises:
        ValueError: If a field breaks the rule; the message names it.
    """
    holds = {
        "positive": lambda number: number > 0.0,
        "non-negative": lambda number: 0.0 <= number < math.inf,
        "finite": math.isfinite,
        "a probability": lambda number: 0.0 <= number <= 1.0,
    }[rule]
    for name in names:
        value = getattr(owner, name)
        numbers = value if isinstance(value, tuple) else (value,)
        if not all(isinstance(number, (int, float)) and holds(number) for number in numbers):
            raise ValueError(f"{type(owner).__name__}.{name} must be {rule}, got {value!r}.")


@dataclass(frozen=True, slots=True, kw_only=True)
class ProcessNoise:
    """How the executed twist differs from the command: the velocity motion model, and slip that comes in bursts.

    The executed twist is the command plus zero-mean noise of variance ``alpha1 v^2 + alpha2 omega^2`` (speed) and
    ``alpha3 v^2 + alpha4 omega^2`` (turning rate), per step of 0.1 s; at other periods the variance is scaled so that the
    drift per metre stays. During a burst of slip the wheels turn as commanded and the robot moves by a smaller share of it.

    References:
        Thrun, Burgard, Fox, *Probabilistic Robotics* (2005), section 5.3: the velocity motion model.
    """

    alpha1: float = 0.0
    """Variance of the speed per squared speed, 1."""
    alpha2: float = 0.0
    """Variance of the speed per squared turning rate, m^2."""
    alpha3: float = 0.0
    """Variance of the turning rate per squared speed, rad^2/m^2."""
    alpha4: float = 0.0
    """Variance of the turning rate per squared turning rate, 1."""
    scale: float = 1.0
    """What the robot makes of a commanded speed, as a share of it: a wheel's radius that is off by 2 % is 1.02 or 0.98. The
    filter never knows it."""
    slip: float = 0.0
    """Share of the motion that is lost during a burst of slip, 0 to 1."""
    slip_start: float = 0.0
    """Probability per 0.1 s that a burst begins."""
    slip_end: float = 1.0
    """Probability per 0.1 s that a burst ends."""

    def __post_init__(self) -> None:
        require(self, "non-negative", "alpha1", "alpha2", "alpha3", "alpha4")
        require(self, "a probability", "slip", "slip_start", "slip_end")
        require(self, "positive", "scale")
        require(self, "finite", "scale")


@dataclass(frozen=True, slots=True, kw_only=True)
class OdometryNoise:
    """How the measured pose differs from the true one.

    Without ``wheel`` the measurement is the true pose with white noise, bias, heading spikes, drop-outs and
    quantization. With ``wheel`` it is the pose that the wheels have integrated since the start: it sees the commands that
    the wheels carried out, never the noise of their execution, so its error is smooth and grows.
    """

    R: tuple[float, ...] = (0.0, 0.0, 0.0)
    """Variances of the white noise on x, y and heading; m^2, m^2, rad^2. A diagonal 3 x 3 matrix is accepted."""
    bias: tuple[float, ...] = (0.0, 0.0, 0.0)
    """Constant offset of x, y and heading; m, m, rad."""
    spike_probability: float = 0.0
    """Probability per measurement that the heading jumps by plus or minus `spike`, with equal chances."""
    spike: float = 0.0
    """Size of a heading spike, rad."""
    dropout_probability: float = 0.0
    """Probability per measurement that it is lost."""
    quantization: tuple[float, ...] = (0.0, 0.0)
    """Resolution of position and heading; m, rad. Zero for none."""
    wheel: bool = False
    """Whether the odometry integrates the wheels instead of measuring the pose."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "R", variances("OdometryNoise.R", self.R, 3))
        for name, size in (("bias", 3), ("quantization", 2)):
            value = getattr(self, name)
            if not isinstance(value, Sequence) or len(value) != size:
                raise ValueError(f"OdometryNoise.{name} must be a sequence of {size} numbers, got {value!r}.")
            object.__setattr__(self, name, tuple(value))
        require(self, "finite", "bias")
        require(self, "non-negative", "spike", "quantization")
        require(self, "a probability", "spike_probability", "dropout_probability")


@dataclass(frozen=True, slots=True, kw_only=True)
class Noise:
    """What keeps a robot from knowing where it is: the execution of its commands and its odometry."""

    process: ProcessNoise = field(default_factory=ProcessNoise)
    """Noise of the executed twist."""
    odometry: OdometryNoise = field(default_factory=OdometryNoise)
    """Noise of the measured pose."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FilterTuning:
    """What the extended Kalman filter assumes about the robot and its odometry."""

    Q: tuple[float, ...]
    """Variances that a step of 0.1 s adds to x, y, theta, v and omega; a step of dt adds dt / 0.1 times as much.
    A diagonal 5 x 5 matrix is accepted."""
    R: tuple[float, ...]
    """Variances of the measured x, y and heading; m^2, m^2, rad^2. A diagonal 3 x 3 matrix is accepted."""
    from_origin: bool = False
    """Whether it starts at the origin with the variances `P0`, instead of at the first measurement with diag(R, 0, 0)."""
    P0: tuple[float, ...] = (0.1, 0.1, 0.1, 1.0, 1.0)
    """Variances of the initial belief where `from_origin` asks for it. A diagonal 5 x 5 matrix is accepted."""
    process: ProcessNoise = field(default_factory=ProcessNoise)
    """Noise that is assumed on the commanded twist; of its variances and those of `Q` the larger ones count."""
    remember_velocity: bool = False
    """The tutorial's Jacobian: speed and turning rate depend on their previous values, though commands replace them."""
    wrap_innovation: bool = True
    """Whether the heading's innovation is wrapped to [-pi, pi); the tutorial's is not."""
    gate: float = math.inf
    """Measurements whose normalized innovation squared exceeds this are refused (chi-square, 3 degrees of freedom)."""
    max_rejections: float = 10.0
    """So many refusals in a row mean that the filter is lost: it then starts again from the measurement."""
    odometry_input: bool = False
    """Whether the odometry drives the prediction, by its increments, and corrects nothing: for `OdometryNoise.wheel`."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "Q", variances("FilterTuning.Q", self.Q, 5))
        object.__setattr__(self, "R", variances("FilterTuning.R", self.R, 3))
        object.__setattr__(self, "P0", variances("FilterTuning.P0", self.P0, 5))
        require(self, "positive", "gate", "max_rejections")


@dataclass(frozen=True, slots=True, kw_only=True)
class Reward:
    """Weights of the reward. Distances in it are true ones, whatever the policy observes."""

    progress: float = 1.0
    """For a step on the way to the goal, as a share of what full speed allows."""
    time: float = 0.1
    """Subtracted at every step."""
    effort: float = 0.01
    """Subtracted, times the squared speed and turning rate as shares of their limits."""
    success: float = 10.0
    """Added when the episode ends in success."""

    def __post_init__(self) -> None:
        require(self, "finite", *(weight.name for weight in fields(self)))
