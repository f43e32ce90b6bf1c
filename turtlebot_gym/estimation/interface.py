"""Interface of a filter: three functions with fixed signatures, chosen once from its tuning."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from turtlebot_gym.estimation import dead_reckoning, ekf, gated, mixture, scale, slip
from turtlebot_gym.parameters import DeadReckoning, FilterTuning, Gated, Kalman, Mixture, Scale, Slip
from turtlebot_gym.validation import refusal
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
    fix: Callable[[Any, Pose, tuple[float, ...], FilterTuning], Any]
    """``fix(estimate, z, R, tuning)`` returns the estimate after an external pose measurement of the same time.

    R holds the variances of x, y and heading; m^2, m^2, rad^2; infinite for a heading that was not measured.
    """
    reads: tuple[str, ...] = ("odometry",)
    """Names of the sensors that ``step`` reads."""
    kind: Any = Kalman()
    """Example of its own numbers, `FilterTuning.kind`; their class chooses the filter."""
    compiled: bool = True
    """Whether the functions are kernels; if not, the step runs as plain Python."""


EXTENDED_KALMAN = Filter(ekf.start, ekf.step, ekf.fix)
"""Predicts with the executed twist and corrects by the measured pose."""
DEAD_RECKONING = Filter(ekf.start, dead_reckoning.step, ekf.fix, kind=DeadReckoning())
"""Moves as the wheel odometry moves."""
_SPIKES = {"spike_probability": 0.02, "spike": 0.3}
FILTERS = {
    type(filter.kind): filter
    for filter in (
        EXTENDED_KALMAN,
        DEAD_RECKONING,
        Filter(ekf.start, gated.step, ekf.fix, kind=Gated(heading_gate=6.635)),
        Filter(mixture.start, mixture.step, mixture.fix, kind=Mixture(**_SPIKES)),
        Filter(slip.start, slip.step, slip.fix, kind=Slip(**_SPIKES)),
        Filter(scale.start, scale.step, scale.fix, kind=Scale()),
    )
}
"""Filters by the class of their own numbers."""


def filter_of(tuning: FilterTuning) -> Filter:
    """Return the filter for a tuning; a class of numbers from elsewhere names its filter as its attribute ``filter``.

    Raises:
        ValueError: If its kind belongs to no filter.
    """
    own = getattr(tuning.kind, "filter", None)
    if not isinstance(own, Filter) and type(tuning.kind) not in FILTERS:
        known = ", ".join(kind.__name__ for kind in FILTERS)
        raise refusal("FilterTuning.kind", f"one of {known}, or have a Filter as its attribute 'filter'", tuning.kind)
    return own if isinstance(own, Filter) else FILTERS[type(tuning.kind)]
