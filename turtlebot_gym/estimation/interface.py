"""What a filter is: two functions of one shape, chosen once from its tuning."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from turtlebot_gym.estimation import dead_reckoning, ekf, gated, mixture, scale, slip
from turtlebot_gym.parameters import GATED, KALMAN, MIXTURE, SCALE, SLIP, FilterTuning
from turtlebot_gym.values import Pose, Senses


class Filter(NamedTuple):
    """A filter as kernels: they run in plain Python and inside a compiled loop."""

    start: Callable[[Pose, FilterTuning], Any]
    """``start(odometry, tuning)`` returns the estimate at the first measurement: all that the filter remembers, a NamedTuple
    with the belief and the NIS of the last measurement among it."""
    step: Callable[[Any, Senses, Senses, FilterTuning, float, float], Any]
    """``step(estimate, before, senses, tuning, dt, middle)`` returns the estimate after a control interval of dt, s.

    ``before`` is what the odometry said at the start of the interval, ``senses`` what it says at its end; ``middle`` is the
    integrator, a value of `models.unicycle.INTEGRATORS`.
    """


EXTENDED_KALMAN = Filter(ekf.initialize, ekf.step)
"""Predicts with the executed twist and corrects by the measured pose."""
DEAD_RECKONING = Filter(ekf.initialize, dead_reckoning.step)
"""Moves as the wheel odometry moves."""
FILTERS = {
    KALMAN: EXTENDED_KALMAN,
    GATED: Filter(ekf.initialize, gated.step),
    MIXTURE: Filter(mixture.initialize, mixture.step),
    SLIP: Filter(slip.initialize, slip.step),
    SCALE: Filter(scale.initialize, scale.step),
}
"""Those that are corrected by a measured pose, by kind."""


def filter_of(tuning: FilterTuning) -> Filter:
    """Return the filter that a tuning is for."""
    return DEAD_RECKONING if tuning.odometry_input else FILTERS[tuning.kind]
