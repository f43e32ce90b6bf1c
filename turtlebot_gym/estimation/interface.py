"""What a filter is: three functions of one shape, chosen once from its tuning."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from turtlebot_gym.estimation import dead_reckoning, ekf, gated, mixture, scale, slip
from turtlebot_gym.parameters import GATED, KALMAN, MIXTURE, SCALE, SLIP, FilterTuning
from turtlebot_gym.values import Pose


class Filter(NamedTuple):
    """A filter as kernels: they run in plain Python and inside a compiled loop."""

    start: Callable[[Pose, FilterTuning], Any]
    """``start(odometry, tuning)`` returns the estimate at the first measurement: all that the filter remembers, a NamedTuple
    with the belief and the NIS of the last measurement among it."""
    step: Callable[[Any, Any, Any, FilterTuning, float, float], Any]
    """``step(estimate, before, senses, tuning, dt, middle)`` returns the estimate after a control interval of dt, s.

    ``before`` is what the odometry said at the start of the interval, `values.Senses`, ``senses`` what it says at its end;
    ``middle`` is the integrator, a value of `models.unicycle.INTEGRATORS`.
    """
    fix: Callable[[Any, Pose, tuple[float, ...]], Any]
    """``fix(estimate, z, R)`` returns the estimate once a pose from outside is taken in, which was measured at its very time.

    R are the variances of x, y and heading; m^2, m^2, rad^2; infinite for a heading that was not measured.
    """


EXTENDED_KALMAN = Filter(ekf.initialize, ekf.step, ekf.fix)
"""Predicts with the executed twist and corrects by the measured pose."""
DEAD_RECKONING = Filter(ekf.initialize, dead_reckoning.step, ekf.fix)
"""Moves as the wheel odometry moves."""
FILTERS = {
    KALMAN: EXTENDED_KALMAN,
    GATED: Filter(ekf.initialize, gated.step, ekf.fix),
    MIXTURE: Filter(mixture.initialize, mixture.step, mixture.fix),
    SLIP: Filter(slip.initialize, slip.step, slip.fix),
    SCALE: Filter(scale.initialize, scale.step, scale.fix),
}
"""Those that are corrected by a measured pose, by kind."""


def filter_of(tuning: FilterTuning) -> Filter:
    """Return the filter that a tuning is for."""
    return DEAD_RECKONING if tuning.odometry_input else FILTERS[tuning.kind]
