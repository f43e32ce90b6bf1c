"""Beliefs about a pose whose measured headings may be off by a spike: true, or too large or too small by it.

A measurement is a mixture of the three, and the posterior is approximated by a Gaussian with the mixture's mean and covariance.

References:
    Alspach, Sorenson, "Nonlinear Bayesian estimation using Gaussian sum approximations", *IEEE Transactions on Automatic
    Control* 17 (1972). Bar-Shalom, Li, Kirubarajan (2001), section 1.4.16: the moments of a mixture.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, NamedTuple

from turtlebot_gym.config import NON_NEGATIVE, PROBABILITY, check_fields
from turtlebot_gym.estimation.ekf import predict
from turtlebot_gym.estimation.update import absorb, innovation_variance, inverse_of, of_row, update, wrapped
from turtlebot_gym.kernel import kernel, sqrt
from turtlebot_gym.models.angles import wrap
from turtlebot_gym.parameters import FilterTuning
from turtlebot_gym.values import Belief, Odometry

_LEAST = 1e-100
"""Least density of a measurement, without its exponent, so that one that was certain beforehand does not count as
impossible."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Spikes:
    """Spikes of the measured heading, as the ``kind`` of a `FilterTuning`."""

    spike_probability: Annotated[float, PROBABILITY]
    """Probability per measurement of a heading spike."""
    spike: Annotated[float, NON_NEGATIVE]
    """Size of a heading spike, rad."""

    def __post_init__(self) -> None:
        check_fields(self)


class _Tracked(NamedTuple):
    """A belief, and the measurement's likelihood under the one before, ``factor e^-exponent``."""

    belief: Belief
    exponent: float
    factor: float


@kernel
def exp_minus(q: float) -> float:
    """Return ``e^-q`` for ``q >= 0``, to 2e-12 relative, without a branch; above 60 as for 60."""
    # A Taylor series, squared seven times: 2^7 = 128.
    x = min(q, 60.0) * (1.0 / 128.0)
    y = 2.505210838544172e-08 - x * 2.08767569878681e-09
    y = 2.48015873015873e-05 - x * (2.7557319223985893e-06 - x * (2.755731922398589e-07 - x * y))
    y = 0.008333333333333333 - x * (0.001388888888888889 - x * (0.0001984126984126984 - x * y))
    y = 1.0 - x * (1.0 - x * (0.5 - x * (0.16666666666666666 - x * (0.041666666666666664 - x * y))))
    y = y * y
    y = y * y
    y = y * y
    y = y * y
    y = y * y
    y = y * y
    return y * y


@kernel
def track(belief: Belief, odometry: Odometry, tuning: FilterTuning, dt: float, integrator: float) -> _Tracked:
    """Predict a belief, and correct it by a measurement's three explanations."""
    R, share, spike, measured = tuning.R, tuning.kind.spike_probability, tuning.kind.spike, odometry.measured
    prior, z = predict(belief, odometry.twist, tuning, dt, integrator), odometry.pose
    turn = wrap(z.theta - prior.mean.theta)
    h_x = of_row(prior.covariance, (1.0, 0.0, 0.0))
    placed, nis_x = update(prior, h_x, z.x - prior.mean.x, R[0])
    h_y = of_row(placed.covariance, (0.0, 1.0, 0.0))
    placed, nis_y = update(placed, h_y, z.y - placed.mean.y, R[1])
    precision = inverse_of(innovation_variance(h_x.variance, R[0])) * inverse_of(innovation_variance(h_y.variance, R[1]))
    nis, turn = nis_x + nis_y, turn - (placed.mean.theta - prior.mean.theta)
    h = of_row(placed.covariance, (0.0, 0.0, 1.0))
    inverse = inverse_of(innovation_variance(h.variance, R[2]))
    high, low = turn - spike, turn + spike
    q_true, q_high, q_low = turn * turn * inverse, high * high * inverse, low * low * inverse
    # Relative to the likeliest explanation; its own power is e^0 = 1.
    near, far = min(q_high, q_low), max(q_high, q_low)
    least, other = min(q_true, near), max(q_true, near)
    of_other, of_far = exp_minus(0.5 * (other - least)), exp_minus(0.5 * (far - least))
    of_true, of_near = (1.0 if q_true <= near else of_other), (of_other if q_true <= near else 1.0)
    is_true = (1.0 - share) * of_true
    is_high = 0.5 * share * (of_near if q_high <= q_low else of_far)
    is_low = 0.5 * share * (of_far if q_high <= q_low else of_near)
    likely = is_true + is_high + is_low
    scale = 1.0 / likely
    is_true, is_high, is_low = is_true * scale, is_high * scale, is_low * scale
    mean = is_true * turn + is_high * high + is_low * low
    off_true, off_high, off_low = turn - mean, high - mean, low - mean
    spread = is_true * off_true * off_true + is_high * off_high * off_high + is_low * off_low * off_low
    posterior = wrapped(absorb(placed, h.column, mean * inverse, inverse - spread * inverse * inverse))
    return _Tracked(
        posterior if measured else prior,
        0.5 * (nis + least) if measured else 0.0,
        likely * max(sqrt(precision * inverse), _LEAST) if measured else 1.0,
    )
