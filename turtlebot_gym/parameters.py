"""Parameters of a robot's noise, its filter and its reward.

They are frozen dataclasses that check themselves, so every instance is valid. SI units and radians.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, is_dataclass
from typing import Annotated, Any

from turtlebot_gym import config

REFERENCE_PERIOD = 0.1
"""Control period to which noise and tunings refer, s; ``dt`` scales them (see `models.unicycle` and `estimation.ekf`)."""

MAX_FIX_AGE = 0.5
"""Greatest age at which an absolute fix is still used, s."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ProcessNoise:
    """Difference between executed twist and command: the velocity motion model, wheels not as assumed, and bursts of slip.

    The executed twist is the command plus zero-mean noise of variance ``alpha1 v^2 + alpha2 omega^2`` (speed) and
    ``alpha3 v^2 + alpha4 omega^2`` (turning rate), per step of 0.1 s; at other periods the variance is scaled to keep the drift
    per metre. During a burst of slip the wheels turn as commanded, but the robot executes only a share of the motion.

    References:
        Thrun, Burgard, Fox, *Probabilistic Robotics* (2005), section 5.3: the velocity motion model.
    """

    alpha1: Annotated[float, config.NON_NEGATIVE] = 0.0
    """Variance of the speed per squared speed, 1."""
    alpha2: Annotated[float, config.NON_NEGATIVE] = 0.0
    """Variance of the speed per squared turning rate, m^2."""
    alpha3: Annotated[float, config.NON_NEGATIVE] = 0.0
    """Variance of the turning rate per squared speed, rad^2/m^2."""
    alpha4: Annotated[float, config.NON_NEGATIVE] = 0.0
    """Variance of the turning rate per squared turning rate, 1."""
    scale: Annotated[float, config.POSITIVE] = 1.0
    """Executed share of a commanded twist: 1.02 for wheels 2 % too large. Like the next two, only `calibrated` sees it."""
    turn_scale: Annotated[float, config.POSITIVE] = 1.0
    """Executed share of a commanded turn, beyond `scale`: the assumed track over the true one."""
    veer: Annotated[float, config.FINITE] = 0.0
    """Turn per metre driven, rad/m: the difference of the wheels' radii, right minus left, over their mean and the track. What
    it changes of the speed in a turn, 0.3 mm/rad for 0.04 rad/m, is left out."""
    slip: Annotated[float, config.PROBABILITY] = 0.0
    """Share of the motion that is lost during a burst of slip, 0 to 1."""
    slip_start: Annotated[float, config.PROBABILITY] = 0.0
    """Probability per 0.1 s that a burst begins."""
    slip_end: Annotated[float, config.PROBABILITY] = 1.0
    """Probability per 0.1 s that a burst ends."""

    __post_init__ = config.check_fields


@dataclass(frozen=True, slots=True, kw_only=True)
class OdometryNoise:
    """Difference between the measured pose and the true one.

    Without ``wheel`` the measurement is the true pose with white noise, bias, heading spikes and drop-outs. With ``wheel`` it
    is the pose integrated from the wheels since the start: it reflects the commands that the wheels carried out but not the
    noise of their execution, so its error is smooth and grows.
    """

    R: Annotated[tuple[float, ...], config.Numbers(config.NON_NEGATIVE, 3)] = (0.0, 0.0, 0.0)
    """Variances of the white noise on x, y and heading; m^2, m^2, rad^2."""
    bias: Annotated[tuple[float, ...], config.Numbers(config.FINITE, 3)] = (0.0, 0.0, 0.0)
    """Constant offset of x, y and heading; m, m, rad."""
    spike_probability: Annotated[float, config.PROBABILITY] = 0.0
    """Probability per measurement that the heading jumps by plus or minus `spike`, with equal probability."""
    spike: Annotated[float, config.NON_NEGATIVE] = 0.0
    """Size of a heading spike, rad."""
    dropout_probability: Annotated[float, config.PROBABILITY] = 0.0
    """Probability per measurement that it is lost."""
    gap_end: Annotated[float, config.PROBABILITY] = 1.0
    """Probability per measurement that a loss is the last one: 1 for losses that have nothing to do with each other, less for
    gaps, as of messages that come late, all at once, of which the newest counts."""
    wheel: bool = False
    """Whether the odometry integrates the wheels instead of measuring the pose; the next five are for such odometry alone."""
    leap_probability: Annotated[float, config.PROBABILITY] = 0.0
    """Probability per 0.1 s that the integrated pose leaps, by `leap` in any direction and by `leap_turn` to either side. It
    stays there."""
    leap: Annotated[float, config.NON_NEGATIVE] = 0.0
    """Length of a leap, m."""
    leap_turn: Annotated[float, config.NON_NEGATIVE] = 0.0
    """Turn of a leap, rad."""
    reset_probability: Annotated[float, config.PROBABILITY] = 0.0
    """Probability per 0.1 s that the integrated pose begins again at the origin, as when a driver is started anew."""
    reverse_probability: Annotated[float, config.PROBABILITY] = 0.0
    """Probability per 0.1 s of reverse motion that it is counted as forward motion, in the pose and in the twist."""

    def __post_init__(self) -> None:
        config.check_fields(self)
        for name in ("leap_probability", "reset_probability", "reverse_probability"):
            if getattr(self, name) > 0.0 and not self.wheel:
                raise config.refusal(f"OdometryNoise.{name}", "0 without wheel: a pose is not integrated", getattr(self, name))


def is_covariance(R: Sequence[float], cross: Sequence[float]) -> bool:
    """Return whether variances of x, y and heading and covariances, as in `values.Fix`, are those of any errors."""
    (xx, yy, tt), (xy, xt, yt) = R, cross
    if math.inf in (xx, yy) or (tt == math.inf and (xt, yt) != (0.0, 0.0)):
        return False
    x, y, t = math.sqrt(xx), math.sqrt(yy), math.sqrt(tt)
    a, b, c = xy / x / y, xt / x / t, yt / y / t  # no product, which may be 0 though no factor is
    return max(abs(a), abs(b), abs(c)) <= 1.0 + 1e-9 and 1.0 + 2.0 * a * b * c - a * a - b * b - c * c >= -1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class FixNoise:
    """An external sensor that measures the pose now and then: localization in a map, markers on the walls, motion capture."""

    R: Annotated[tuple[float, ...], config.Numbers(config.POSITIVE_OR_INFINITE)]
    """Variances of the white noise on x, y and heading; m^2, m^2, rad^2. Two values, or an infinite third one, mean that the
    heading is not measured."""
    period: Annotated[float, config.POSITIVE] = 0.5
    """Time from one measurement to the next, s."""
    delay: Annotated[float, config.Range(0.0, MAX_FIX_AGE, unit="s")] = 0.0
    """Latency of a measurement, s; its stamp says when it was measured."""
    dropout_probability: Annotated[float, config.PROBABILITY] = 0.0
    """Probability per measurement that it is lost."""

    def __post_init__(self) -> None:
        config.check_fields(self)
        if len(self.R) not in (2, 3) or math.inf in self.R[:2]:
            raise config.refusal("FixNoise.R", "two or three variances, those of x and y finite", self.R)
        object.__setattr__(self, "R", (*self.R, math.inf)[:3])


@dataclass(frozen=True, slots=True, kw_only=True)
class Noise:
    """Noise model of a robot: of the execution of its commands and of its odometry."""

    process: ProcessNoise = field(default_factory=ProcessNoise)
    """Noise of the executed twist."""
    odometry: OdometryNoise = field(default_factory=OdometryNoise)
    """Noise of the measured pose."""

    __post_init__ = config.check_fields


@dataclass(frozen=True, slots=True, kw_only=True)
class Kalman:
    """The extended Kalman filter, `estimation.ekf`, with its gate, which others have, too."""

    gate: Annotated[float, config.POSITIVE_OR_INFINITE] = math.inf
    """Measurements whose normalized innovation squared exceeds this are refused (chi-square, 3 degrees of freedom)."""
    max_rejections: Annotated[int, config.ONE_OR_MORE] = 10
    """Number of refusals in a row after which the filter counts as lost and restarts from the measurement."""
    lockout: Annotated[float, config.NON_NEGATIVE] = 0.0
    """Least time for which measurements of each step must be refused before the filter counts as lost, s."""

    __post_init__ = config.check_fields


@dataclass(frozen=True, slots=True, kw_only=True)
class Tutorial:
    """The tutorial's filter, `estimation.tutorial`, which has no numbers of its own."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DeadReckoning:
    """Odometry increments drive the prediction and nothing corrects it, as for `OdometryNoise.wheel`."""

    leap: Annotated[float, config.POSITIVE_OR_INFINITE] = math.inf
    """Way beyond that of the twist from which an increment is a leap of the odometry, m: the twist then moves the belief."""
    leap_turn: Annotated[float, config.POSITIVE_OR_INFINITE] = math.inf
    """The same for a turn, rad."""

    __post_init__ = config.check_fields


@dataclass(frozen=True, slots=True, kw_only=True)
class Gated(Kalman):
    """The extended Kalman filter with a further gate on the heading alone, `estimation.ekf`."""

    heading_gate: Annotated[float, config.POSITIVE_OR_INFINITE]
    """Headings whose normalized innovation squared exceeds this are refused (chi-square, 1 degree of freedom)."""


KINDS: dict[str, type] = {kind.__name__: kind for kind in (Kalman, DeadReckoning, Gated, Tutorial)}
"""Filters' own numbers by name."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FilterTuning:
    """A filter, and its assumptions about the robot and its odometry."""

    Q: Annotated[tuple[float, ...], config.Numbers(config.NON_NEGATIVE, 5)]
    """Variances that a step of 0.1 s adds to x, y, theta, v and omega; a step of dt adds dt / 0.1 times as much."""
    R: Annotated[tuple[float, ...], config.Numbers(config.NON_NEGATIVE, 3)]
    """Variances of the measured x, y and heading; m^2, m^2, rad^2."""
    from_origin: bool = False
    """Whether the filter starts at the origin with the variances `P0`, instead of at the first measurement with diag(R, 0,
    0)."""
    P0: Annotated[tuple[float, ...], config.Numbers(config.NON_NEGATIVE, 5)] = (0.1, 0.1, 0.1, 1.0, 1.0)
    """Variances of the initial belief, used with `from_origin`."""
    process: ProcessNoise = field(default_factory=ProcessNoise)
    """Assumed noise of the commanded twist; for v and omega, the larger of this variance and that in `Q` is used."""
    kind: Any = field(default_factory=Kalman)
    """The filter, with what it alone reads: `Kalman`, `DeadReckoning`, `Gated` or `Tutorial`; in a file its name, or a
    mapping of its name and its fields: ``{name: Gated, heading_gate: 6.6}``."""

    def __post_init__(self) -> None:
        config.check_fields(self)
        if isinstance(self.kind, (str, Mapping)):
            given = {"name": self.kind} if isinstance(self.kind, str) else dict(self.kind)
            kind = config.choose("FilterTuning.kind", given.pop("name", None), KINDS)
            object.__setattr__(self, "kind", config.build(kind, given, "FilterTuning.kind"))
        if not is_dataclass(self.kind) or isinstance(self.kind, type):
            raise config.refusal("FilterTuning.kind", "a filter's own tuning, such as Kalman(gate=9.0)", self.kind)
