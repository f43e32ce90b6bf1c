"""The policy's observation: belief and waypoints in the body frame, layout 1; and a localizer's evidence, for layout 3."""

from __future__ import annotations

from typing import NamedTuple

from turtlebot_gym.kernel import kernel, sqrt
from turtlebot_gym.models.angles import PI, sincos
from turtlebot_gym.robots import Robot
from turtlebot_gym.values import Covariance, Pose, State

OBSERVATION_LAYOUT = 1
"""Version of `Observation`: a policy trained on another one must be refused."""


class Observation(NamedTuple):
    """A policy's observation, layout 1; "believed" is what the environment observes."""

    distance: float
    """Believed distance to the goal, m."""
    cos_bearing: float
    """Cosine of the goal's bearing in the body frame; 1 at distance 0."""
    sin_bearing: float
    """Its sine."""
    cos_turn: float
    """Cosine of the remaining turn to the reference's heading."""
    sin_turn: float
    """Its sine."""
    v: float
    """Speed, as a share of the robot's limit."""
    omega: float
    """Turning rate, as a share of the robot's limit."""
    std_position: float
    """Stated standard deviation of the position (root of the trace), m."""
    std_heading: float
    """Stated standard deviation of the heading, rad."""
    nis: float
    """Normalized innovation squared of the last measurement."""
    next_distance: float
    """Distance to the waypoint after this one, m; to the goal again if there is none."""
    cos_next: float
    """Cosine of its bearing."""
    sin_next: float
    """Its sine."""


_UNIT = (-1.0, 1.0)
MAX_DISTANCE, MAX_TWIST, MAX_STD_POSITION, MAX_STD_HEADING, MAX_NIS = 20.0, 2.0, 5.0, PI, 25.0
_BOUNDS: dict[str, tuple[float, float]] = {
    "distance": (0.0, MAX_DISTANCE),
    "cos_bearing": _UNIT,
    "sin_bearing": _UNIT,
    "cos_turn": _UNIT,
    "sin_turn": _UNIT,
    "v": (-MAX_TWIST, MAX_TWIST),
    "omega": (-MAX_TWIST, MAX_TWIST),
    "std_position": (0.0, MAX_STD_POSITION),
    "std_heading": (0.0, MAX_STD_HEADING),
    "nis": (0.0, MAX_NIS),
    "next_distance": (0.0, MAX_DISTANCE),
    "cos_next": _UNIT,
    "sin_next": _UNIT,
}
OBSERVATION_LOW = Observation(**{name: low for name, (low, _) in _BOUNDS.items()})
"""Lower bounds; observations are clipped to them."""
OBSERVATION_HIGH = Observation(**{name: high for name, (_, high) in _BOUNDS.items()})
"""Upper bounds."""


class Evidence(NamedTuple):
    """What a localizer says of its belief beyond an `Observation`, in layout 3."""

    std_ahead: float
    """Stated standard deviation of the position in the direction of the believed heading, m: in a corridor without ends it
    grows."""
    std_aside: float
    """The same across that direction, m."""
    fits: float
    """Share of the last scan's beams that end near a surface of the map."""
    weight: float
    """Weight of the best hypothesis of where the robot is; 1 while there is only one."""


EVIDENCE_LOW = Evidence(0.0, 0.0, 0.0, 0.0)
"""Lower bounds; observations are clipped to them."""
EVIDENCE_HIGH = Evidence(MAX_STD_POSITION, MAX_STD_POSITION, 1.0, 1.0)
"""Upper bounds."""


@kernel
def _towards(pose_x: float, pose_y: float, sine: float, cosine: float, to: Pose) -> tuple[float, float, float]:
    """Return distance, and cosine and sine of the bearing, of a point seen from a pose."""
    dx, dy = to.x - pose_x, to.y - pose_y
    distance = sqrt(dx * dx + dy * dy)
    scale = 1.0 / (distance if distance > 0.0 else 1.0)
    ahead, left = (dx * cosine + dy * sine) * scale, (dy * cosine - dx * sine) * scale
    return distance, (max(min(ahead, 1.0), -1.0) if distance > 0.0 else 1.0), max(min(left, 1.0), -1.0)


@kernel
def observe(state: State, std: tuple[float, float], nis: float, reference: Pose, following: Pose, robot: Robot) -> Observation:
    """Return a policy's observation.

    Args:
        state: Believed pose and twist.
        std: Standard deviations of position and heading; m, rad.
        nis: Normalized innovation squared of the last measurement.
        reference: The waypoint to reach.
        following: The waypoint after it.
        robot: Robot whose limits scale the twist.
    """
    sine, cosine = sincos(state.theta)
    distance, cos_bearing, sin_bearing = _towards(state.x, state.y, sine, cosine, reference)
    next_distance, cos_next, sin_next = _towards(state.x, state.y, sine, cosine, following)
    sin_turn, cos_turn = sincos(reference.theta - state.theta)
    return Observation(
        min(distance, MAX_DISTANCE),
        cos_bearing,
        sin_bearing,
        cos_turn,
        sin_turn,
        max(min(state.v / robot.max_linear, MAX_TWIST), -MAX_TWIST),
        max(min(state.omega / robot.max_angular, MAX_TWIST), -MAX_TWIST),
        min(std[0], MAX_STD_POSITION),
        min(std[1], MAX_STD_HEADING),
        min(nis, MAX_NIS),
        min(next_distance, MAX_DISTANCE),
        cos_next,
        sin_next,
    )


@kernel
def stated_deviations(P: Covariance) -> tuple[float, float]:
    """Return the standard deviations of position (root of the trace) and heading in a covariance; m, rad."""
    return sqrt(P.xx + P.yy), sqrt(P.tt)


@kernel
def evidence_of(theta: float, P: Covariance, fits: float, weight: float) -> Evidence:
    """Return what a localizer says of its belief.

    Args:
        theta: Believed heading, rad.
        P: Covariance of the belief.
        fits: Share of the last scan's beams that fit.
        weight: Weight of the best hypothesis.
    """
    sine, cosine = sincos(theta)
    cross = 2.0 * sine * cosine * P.xy
    ahead = cosine * cosine * P.xx + cross + sine * sine * P.yy
    aside = sine * sine * P.xx - cross + cosine * cosine * P.yy
    return Evidence(
        min(sqrt(max(ahead, 0.0)), MAX_STD_POSITION),
        min(sqrt(max(aside, 0.0)), MAX_STD_POSITION),
        max(min(fits, 1.0), 0.0),
        max(min(weight, 1.0), 0.0),
    )
