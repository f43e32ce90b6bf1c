"""Interface of a filter: three functions with fixed signatures. Each filter's module builds its own value."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from turtlebot_gym.parameters import FilterTuning, Kalman
from turtlebot_gym.values import Pose


class Filter(NamedTuple):
    """A filter as kernels, which run in plain Python and inside a compiled loop."""

    start: Callable[[Any, FilterTuning], Any]
    """``start(senses, tuning)`` returns the estimate at the first measurement: the filter's whole state, a NamedTuple that
    includes the belief and the NIS of the last measurement."""
    step: Callable[[Any, Any, Any, FilterTuning, float, float], Any]
    """``step(estimate, before, senses, tuning, dt, integrator)`` returns the estimate after a control interval of dt, s.

    ``before`` and ``senses`` are the sensors' values at the start and at the end of the interval, `values.Senses`;
    ``integrator`` is a value of `models.unicycle.INTEGRATORS`.
    """
    fix: Callable[[Any, Pose, tuple[float, ...], FilterTuning], Any]
    """``fix(estimate, z, R, tuning)`` returns the estimate after an external pose measurement of the same time.

    R holds six numbers: the variances of x, y and heading, infinite for a heading that was not measured, and the covariances
    of x and y, of x and heading, and of y and heading; m^2, m rad and rad^2.
    """
    reads: tuple[str, ...] = ("odometry",)
    """Names of the sensors that ``step`` reads."""
    kind: Any = Kalman()
    """Example of its own numbers, `FilterTuning.kind`; their class chooses the filter."""
    compiled: bool = True
    """Whether the functions are kernels; if not, the step runs as plain Python."""
