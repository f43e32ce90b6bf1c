"""Observations: tuples of named terms, the same from an environment to a robot.

A term is a kernel of a world. The option ``observation`` names the terms that a policy sees, and adds terms of one's own:

    gym.make("turtlebot_gym/TurtleBotRooms-v0", observation="ekf,scan*2,bumper:BUMPER")

Here "ekf" stands for the task's own terms, computed from the filter's pose; "scan*2" replaces its scan by the present one and
the one before; and ``BUMPER`` is a term of the module ``bumper``. Policies name the terms that they read, and bundles carry
them. This module has the package's own terms; `reading` finds terms by name, and `columns` says where their numbers stand.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Any, NamedTuple

from turtlebot_gym.kernel import kernel, sqrt
from turtlebot_gym.models.angles import PI, sincos
from turtlebot_gym.observations.term import ObservationTerm
from turtlebot_gym.robots import Robot
from turtlebot_gym.rooms.lidar import MAX_AGE, SECTORS
from turtlebot_gym.values import Covariance, Pose, State


class Observed(IntEnum):
    """The robot's pose that a policy observes: the filter's estimate, the measured pose, or the true one.

    ``LOCATED`` is the estimate of a robot that localizes itself; the policy also observes how well the estimate fits.
    """

    EKF = 0
    ODOMETRY = 1
    TRUTH = 2
    LOCATED = -1


OBSERVED = {observed.name.lower(): observed for observed in Observed}
"""The observed poses by name."""


class Observation(NamedTuple):
    """The numbers of an observation on open ground, see the terms `GOAL`, `TWIST`, `UNCERTAINTY` and `NEXT_GOAL`."""

    distance: float
    cos_bearing: float
    sin_bearing: float
    cos_turn: float
    sin_turn: float
    v: float
    omega: float
    std_position: float
    std_heading: float
    nis: float
    next_distance: float
    cos_next: float
    sin_next: float


MAX_DISTANCE, MAX_TWIST, MAX_STD_POSITION, MAX_STD_HEADING, MAX_NIS = 20.0, 2.0, 5.0, PI, 25.0


@kernel
def next_goal_from(state: State, following: Pose) -> tuple[float, float, float]:
    """Return the numbers of `NEXT_GOAL` for a believed state."""
    sine, cosine = sincos(state.theta)
    dx, dy = following.x - state.x, following.y - state.y
    distance = sqrt(dx * dx + dy * dy)
    scale = 1.0 / (distance if distance > 0.0 else 1.0)
    ahead, left = (dx * cosine + dy * sine) * scale, (dy * cosine - dx * sine) * scale
    return (min(distance, MAX_DISTANCE), max(min(ahead, 1.0), -1.0) if distance > 0.0 else 1.0, max(min(left, 1.0), -1.0))


@kernel
def goal_from(state: State, reference: Pose) -> tuple[float, float, float, float, float]:
    """Return the numbers of `GOAL` for a believed state."""
    distance, ahead, left = next_goal_from(state, reference)
    sin_turn, cos_turn = sincos(reference.theta - state.theta)
    return distance, ahead, left, cos_turn, sin_turn


@kernel
def twist_of(state: State, robot: Robot) -> tuple[float, float]:
    """Return the numbers of `TWIST`."""
    v, omega = state.v / robot.max_linear, state.omega / robot.max_angular
    return max(min(v, MAX_TWIST), -MAX_TWIST), max(min(omega, MAX_TWIST), -MAX_TWIST)


@kernel
def uncertainty_of(P: Covariance, nis: float) -> tuple[float, float, float]:
    """Return the numbers of `UNCERTAINTY` for the covariance of a belief."""
    return min(sqrt(P.xx + P.yy), MAX_STD_POSITION), min(sqrt(P.tt), MAX_STD_HEADING), min(nis, MAX_NIS)


@kernel
def evidence_of(theta: float, P: Covariance, fits: float, weight: float) -> tuple[float, float, float, float]:
    """Return the numbers of `EVIDENCE` for a believed heading, rad, and the covariance of the belief."""
    sine, cosine = sincos(theta)
    cross = 2.0 * sine * cosine * P.xy
    ahead = cosine * cosine * P.xx + cross + sine * sine * P.yy
    aside = sine * sine * P.xx - cross + cosine * cosine * P.yy
    ahead, aside = sqrt(max(ahead, 0.0)), sqrt(max(aside, 0.0))
    shares = max(min(fits, 1.0), 0.0), max(min(weight, 1.0), 0.0)
    return min(ahead, MAX_STD_POSITION), min(aside, MAX_STD_POSITION), shares[0], shares[1]


@kernel
def _is_believed(p: Any) -> bool:
    """Return whether the policy observes the filter's estimate; compiled code has a float there, not an `Observed`."""
    return (p.observed == Observed.EKF.value) | (p.observed == Observed.LOCATED.value)


@kernel
def observed_state(body: Any, senses: Any, estimate: Any, p: Any) -> State:
    """Return the robot's state that the policy observes: the estimated one, the measured one or the true one."""
    z, u = senses.odometry.pose, senses.odometry.twist
    measured = State(z.x, z.y, z.theta, u.v, u.omega)
    other = measured if p.observed == Observed.ODOMETRY.value else body.true_state
    return estimate.belief.mean if _is_believed(p) else other


_state = kernel(lambda world, p: observed_state(world.body, world.senses, world.estimate, p))
_goal = kernel(lambda world, p: goal_from(_state(world, p), world.course.reference))
_twist = kernel(lambda world, p: twist_of(_state(world, p), p.robot))
_next_goal = kernel(lambda world, p: next_goal_from(_state(world, p), world.course.following))
_scan_age = kernel(lambda world, p: min(world.room.scan_age, MAX_AGE))
_scan = kernel(lambda scene: scene.lidar.sectors)
_tracks = kernel(lambda scene: scene.tracker.seen)


@kernel
def _uncertainty(world, p):
    is_believed = _is_believed(p)
    R = p.tuning.R if p.observed == Observed.ODOMETRY.value else (0.0, 0.0, 0.0)
    P = world.estimate.belief.covariance if is_believed else Covariance(R[0], 0.0, 0.0, R[1], 0.0, R[2])
    return uncertainty_of(P, world.estimate.nis if is_believed else 0.0)


@kernel
def _evidence(world, p):
    (mean, P), estimate = world.estimate.belief, world.estimate
    return evidence_of(mean.theta, P, estimate.fits, estimate.weight)


_POINT = ((0.0, -1.0, -1.0), (MAX_DISTANCE, 1.0, 1.0))
GOAL = ObservationTerm("goal", _goal, (*_POINT[0], -1.0, -1.0), (*_POINT[1], 1.0, 1.0))
"""The waypoint to reach from where the robot believes it is: distance, m; cosine and sine of its bearing in the body frame, 1
and 0 at distance 0; and those of the turn that remains to its heading."""
TWIST = ObservationTerm("twist", _twist, (-MAX_TWIST,) * 2, (MAX_TWIST,) * 2)
"""Speed and turning rate, as shares of the robot's limits."""
UNCERTAINTY = ObservationTerm("uncertainty", _uncertainty, (0.0,) * 3, (MAX_STD_POSITION, MAX_STD_HEADING, MAX_NIS))
"""Stated standard deviations of position (root of the trace) and heading, m and rad, and the last measurement's normalized
innovation squared."""
NEXT_GOAL = ObservationTerm("next_goal", _next_goal, *_POINT)
"""The waypoint after the one to reach, or the same one again: distance, m, and cosine and sine of its bearing."""
EVIDENCE = ObservationTerm("evidence", _evidence, (0.0,) * 4, (MAX_STD_POSITION, MAX_STD_POSITION, 1.0, 1.0))
"""How sure a localizer is: stated standard deviation of the position in the direction of the believed heading, m, which grows
in a corridor without ends, and across it; share of the last scan's beams that end near a surface of the map; and weight of the
best hypothesis of where the robot is, 1 while there is only one."""
SCAN = ObservationTerm("scan", _scan, (0.0,) * SECTORS, (1.0,) * SECTORS, in_scene=True)
"""Shortest range of the newest scan in each sector, from ahead to the left, as a share of 3.5 m."""
SCAN_AGE = ObservationTerm("scan_age", _scan_age, 0.0, MAX_AGE, "s")
"""Age of that scan, by its stamp."""
NEAREST = 5
"""Number of tracks that a policy observes."""
TRACK_BOUNDS = ((-12.0, -12.0, -3.0, -3.0, 0.0, 0.0, 0.0, 0.0), (12.0, 12.0, 3.0, 3.0, 5.0, 3.0, 1.0, 1.0))
"""Bounds of a track's numbers: position relative to the robot and velocity over ground, both in the robot's frame, m and m/s;
their standard deviations (root of the trace); the radius, m; and 1 for what moves, 0.5 for what may, or 0 without a track."""
TRACKS = ObservationTerm("tracks", _tracks, TRACK_BOUNDS[0] * NEAREST, TRACK_BOUNDS[1] * NEAREST, in_scene=True)
"""The nearest tracks of what moves or may move, nearest first, see `TRACK_BOUNDS` and `turtlebot_gym.tracking`."""

OPEN_GROUND = GOAL, TWIST, UNCERTAINTY, NEXT_GOAL
"""What a policy sees on open ground, 13 numbers: an `Observation`."""
ROOM = *OPEN_GROUND, SCAN, SCAN_AGE
"""What a policy sees in a room, 50 numbers."""
LOCATED_ROOM = *OPEN_GROUND, EVIDENCE, SCAN, SCAN_AGE
"""What a policy sees in a room in which the robot localizes itself, with ``observation="located"``: 54 numbers."""
TERMS = {term.name: term for term in (*LOCATED_ROOM, TRACKS)}
"""The package's own terms by name."""
