"""Visualization of a running loop, in addition to the poses that viewers draw by themselves."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, NamedTuple

from turtlebot_gym.estimation.ekf import Estimate
from turtlebot_gym.validation import POSITIVE, typed
from turtlebot_gym.values import Pose, State
from turtlebot_gym_ros.node.block import Input, On, Output


class Scene(NamedTuple):
    """Waypoints and paths, all in the world frame."""

    reference: Pose | None
    """The waypoint to reach; None if there is none."""
    following: Pose | None
    """The waypoint after it; None after the last one."""
    radius: float
    """Distance within which a waypoint counts as reached, m."""
    believed: Sequence[tuple[float, float]]
    """Path of the estimate, x and y, m."""
    true: Sequence[tuple[float, float]]
    """True path, x and y, m; empty on a robot, where it is unknown."""


class Visualization:
    """Collect waypoints and paths for viewers. No node depends on it; without estimates it publishes nothing.

    Inputs: ``estimate`` (`Estimate`, on ``estimate``), ``reference`` (`Pose`, on ``reference``; optional), ``following``
    (`Pose`, on ``next_reference``; optional), ``truth`` (`State`, on ``true_state``; optional). All in the world frame.
    Outputs: ``scene`` (`Scene`, on ``markers``), in the world frame.
    Parameters: those of `Params`. A reset forgets the paths.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Params:
        """Parameters of the visualization."""

        period: Annotated[float, POSITIVE.of("s")] = 0.2
        """Least time between two pictures, and between two points of a path, s."""
        trail: Annotated[float, POSITIVE.of("s")] = 120.0
        """Time span of a path, s."""
        radius: Annotated[float, POSITIVE.of("m")] = 0.3
        """Distance within which a waypoint counts as reached, m, as in ``waypoint_generator``."""

        def __post_init__(self) -> None:
            typed(self, "")
            if not self.period <= self.trail <= 1e4 * self.period:
                rule = "must satisfy period <= trail <= 10000 period"
                raise ValueError(f"period and trail {rule}, got {self.period!r} and {self.trail!r}.")

    inputs = {
        "estimate": Input(topic="estimate", type=Estimate, reliable=False),
        "reference": Input(topic="reference", type=Pose, required=False),
        "following": Input(topic="next_reference", type=Pose, required=False),
        "truth": Input(topic="true_state", type=State, required=False, reliable=False),
    }
    outputs = {"scene": Output(topic="markers", type=Scene)}

    def __init__(self, params: Params) -> None:
        self.trigger = On("estimate", period=params.period)
        self._radius = params.radius
        self._points = round(params.trail / params.period)
        self.reset()

    def reset(self) -> None:
        """Forget the paths."""
        self._believed: deque[tuple[float, float]] = deque(maxlen=self._points)
        self._true: deque[tuple[float, float]] = deque(maxlen=self._points)

    def step(
        self, dt: float, estimate: Estimate, reference: Pose | None, following: Pose | None, truth: State | None
    ) -> dict[str, Scene]:
        """Return the scene with the current poses at the ends of the paths."""
        self._believed.append((estimate.belief.mean.x, estimate.belief.mean.y))
        if truth is not None:
            self._true.append((truth.x, truth.y))
        ahead = None if following == reference else following
        return {"scene": Scene(reference, ahead, self._radius, tuple(self._believed), tuple(self._true))}
