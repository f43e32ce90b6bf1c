"""Parameters of a robot's noise, its filter and its reward.

They are frozen dataclasses that check themselves: whoever holds one holds a valid one. SI units and radians.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields

from turtlebot_gym.validation import require, typed, variances

REFERENCE_PERIOD = 0.1
"""Noise and tunings are stated for this control period, s; ``dt`` scales them (see `models.unicycle` and `estimation.ekf`)."""

MAX_FIX_AGE = 0.5
"""Greatest age with which a fix from outside counts, s."""

KALMAN, GATED, MIXTURE, SLIP, SCALE = 0.0, 1.0, 2.0, 3.0, 4.0
"""Kinds of filters, see `estimation.interface`."""


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
    """What the robot makes of a commanded twist, as a share of it: wheels whose radius is off by 2 % have 1.02 or 0.98. Neither
    the wheels' own odometry nor the filter sees it."""
    slip: float = 0.0
    """Share of the motion that is lost during a burst of slip, 0 to 1."""
    slip_start: float = 0.0
    """Probability per 0.1 s that a burst begins."""
    slip_end: float = 1.0
    """Probability per 0.1 s that a burst ends."""

    def __post_init__(self) -> None:
        typed(self)
        require(self, "non-negative", "alpha1", "alpha2", "alpha3", "alpha4")
        require(self, "a probability", "slip", "slip_start", "slip_end")
        require(self, "positive", "scale")


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
        typed(self)
        for name, size in (("bias", 3), ("quantization", 2)):
            value = getattr(self, name)
            if len(value) != size:
                raise ValueError(f"OdometryNoise.{name} must be a sequence of {size} numbers, got {value!r}.")
        require(self, "finite", "bias")
        require(self, "non-negative", "spike", "quantization")
        require(self, "a probability", "spike_probability", "dropout_probability")


@dataclass(frozen=True, slots=True, kw_only=True)
class FixNoise:
    """What measures the pose from outside, now and then: localization in a map, markers on the walls, motion capture."""

    R: tuple[float, ...]
    """Variances of the white noise on x, y and heading; m^2, m^2, rad^2. Of x and y only, or with an infinite one of the
    heading, where that is not measured."""
    period: float = 0.5
    """Time from one measurement to the next, s."""
    delay: float = 0.0
    """How late it comes, s; it says when it was measured."""
    dropout_probability: float = 0.0
    """Probability per measurement that it is lost."""

    def __post_init__(self) -> None:
        typed(self)
        if len(self.R) not in (2, 3) or not all(one > 0.0 for one in self.R) or math.inf in self.R[:2]:
            raise ValueError(f"FixNoise.R must be two or three positive variances, of x and y finite ones, got {self.R!r}.")
        object.__setattr__(self, "R", (*self.R, math.inf)[:3])
        require(self, "positive or infinite", "R")
        require(self, "positive", "period")
        require(self, "a probability", "dropout_probability")
        if not 0.0 <= self.delay <= MAX_FIX_AGE:
            raise ValueError(f"FixNoise.delay must be in [0, {MAX_FIX_AGE}] s, got {self.delay!r}.")


@dataclass(frozen=True, slots=True, kw_only=True)
class Noise:
    """What keeps a robot from knowing where it is: the execution of its commands and its odometry."""

    process: ProcessNoise = field(default_factory=ProcessNoise)
    """Noise of the executed twist."""
    odometry: OdometryNoise = field(default_factory=OdometryNoise)
    """Noise of the measured pose."""

    def __post_init__(self) -> None:
        typed(self)


@dataclass(frozen=True, slots=True, kw_only=True)
class FilterTuning:
    """What a filter assumes about the robot and its odometry, and which filter it is."""

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
    """Assumed noise of the commanded twist; for v and omega, the larger of this variance and that in `Q` is used."""
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
    kind: float = KALMAN
    """Which filter: `KALMAN`, or one of `GATED`, `MIXTURE`, `SLIP` and `SCALE`."""
    heading_gate: float = math.inf
    """Headings whose normalized innovation squared exceeds this are refused (chi-square, 1 degree of freedom); `GATED` only."""
    spike_probability: float = 0.0
    """Probability per measurement of a heading spike; for `MIXTURE` and `SLIP`, as is the next one."""
    spike: float = 0.0
    """Size of a heading spike, rad."""
    scale_deviation: float = 0.05
    """Standard deviation of what the robot makes of a commanded twist, as a share of it, at the start; `SCALE` only."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "Q", variances("FilterTuning.Q", self.Q, 5))
        object.__setattr__(self, "R", variances("FilterTuning.R", self.R, 3))
        object.__setattr__(self, "P0", variances("FilterTuning.P0", self.P0, 5))
        typed(self)
        require(self, "positive or infinite", "gate", "max_rejections", "heading_gate")
        require(self, "a probability", "spike_probability")
        require(self, "non-negative", "spike", "scale_deviation")
        if self.kind not in (KALMAN, GATED, MIXTURE, SLIP, SCALE):
            raise ValueError(f"FilterTuning.kind must be one of the kinds in turtlebot_gym.parameters, got {self.kind!r}.")


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
    collision: float = 50.0
    """Subtracted when it ends in a collision; in a room, as are the next two."""
    nearness: float = 0.5
    """Subtracted at every step, times the share of `near` by which the clearance falls short of it."""
    near: float = 0.15
    """Clearance below which it counts, m."""

    def __post_init__(self) -> None:
        typed(self)
        require(self, "finite", *(weight.name for weight in fields(self) if weight.name != "near"))
        require(self, "positive", "near")
