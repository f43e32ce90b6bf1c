"""What a filter is: two functions of one shape, chosen once from its tuning."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from turtlebot_gym.estimation import dead_reckoning, ekf
from turtlebot_gym.estimation.ekf import Estimate
from turtlebot_gym.parameters import FilterTuning
from turtlebot_gym.values import Pose, Senses


class Filter(NamedTuple):
    """A filter as kernels: they run in plain Python and inside a compiled loop."""

    start: Callable[[Pose, FilterTuning], Estimate]
    """``start(odometry, tuning)`` returns the estimate at the first measurement."""
    step: Callable[[Estimate, Senses, Senses, FilterTuning, float, float], Estimate]
    """``step(estimate, before, senses, tuning, dt, middle)`` returns the estimate after a control interval of dt, s.

    ``before`` is what the odometry said at the start of the interval, ``senses`` what it says at its end; ``middle`` is the
    integrator, a value of `models.unicycle.INTEGRATORS`.
    """


EXTENDED_KALMAN = Filter(ekf.initialize, ekf.step)
"""Predicts with the executed twist and corrects by the measured pose."""
DEAD_RECKONING = Filter(ekf.initialize, dead_reckoning.step)
"""Moves as the wheel odometry moves."""


def filter_of(tuning: FilterTuning) -> Filter:
    """Return the filter that a tuning is for."""
    return DEAD_RECKONING if tuning.odometry_input else EXTENDED_KALMAN
