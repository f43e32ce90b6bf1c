"""Interface of a filter: three functions with fixed signatures, chosen once from its tuning."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from turtlebot_gym.estimation import dead_reckoning, ekf, gated, mixture, scale, slip
from turtlebot_gym.parameters import GATED, KALMAN, MIXTURE, SCALE, SLIP, FilterTuning
from turtlebot_gym.values import Pose


class Filter(NamedTuple):
    """A filter as kernels, which run in plain Python and inside a compiled loop."""

    start: Callable[[Any, FilterTuning], Any]
    """``start(senses, tuning)`` returns the estimate at the first measurement: the filter's whole state, a NamedTuple that
    includes the belief and the NIS of the last measurement."""
    step: Callable[[Any, Any, Any, FilterTuning, float, float], Any]
    """``step(estimate, before, senses, tuning, dt, middle)`` returns the estimate after a control interval of dt, s.

    ``before`` and ``senses`` are the sensors' values at the start and at the end of the interval, `values.Senses`; ``middle``
    is the integrator, a value of `models.unicycle.INTEGRATORS`.
    """
    fix: Callable[[Any, Pose, tuple[float, ...]], Any]
    """``fix(estimate, z, R)`` returns the estimate after an external pose measurement of the same time.

    R holds the variances of x, y and heading; m^2, m^2, rad^2; infinite for a heading that was not measured.
    """
    reads: tuple[str, ...] = ("odometry",)
    """Names of the sensors that ``step`` reads."""


EXTENDED_KALMAN = Filter(ekf.start, ekf.step, ekf.fix)
"""Predicts with the executed twist and corrects by the measured pose."""
DEAD_RECKONING = Filter(ekf.start, dead_reckoning.step, ekf.fix)
"""Moves as the wheel odometry moves."""
FILTERS = {
    KALMAN: EXTENDED_KALMAN,
    GATED: Filter(ekf.start, gated.step, ekf.fix),
    MIXTURE: Filter(mixture.start, mixture.step, mixture.fix),
    SLIP: Filter(slip.start, slip.step, slip.fix),
    SCALE: Filter(scale.start, scale.step, scale.fix),
}
"""Filters that correct by a measured pose, by kind."""


def filter_of(tuning: FilterTuning) -> Filter:
    """Return the filter for a tuning."""
    return DEAD_RECKONING if tuning.odometry_input else FILTERS[tuning.kind]
