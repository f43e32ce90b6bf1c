"""Observations: tuples of named terms, the same from an environment to a robot.

A term is a kernel of a world. The option ``observation`` names the terms that a policy sees, and adds terms of one's own:

    gym.make("turtlebot_gym/TurtleBotRooms-v0", observation="ekf,scan*2,bumper:BUMPER")

Here "ekf" stands for the task's own terms, computed from the filter's pose; "scan*2" replaces its scan by the present one and
the one before; and ``BUMPER`` is a term of the module ``bumper``. Policies name the terms that they read, and bundles carry
them.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.kernel import kernel, sqrt
from turtlebot_gym.models.angles import PI, sincos
from turtlebot_gym.own import failure, load_object
from turtlebot_gym.robots import Robot
from turtlebot_gym.rooms.lidar import MAX_AGE, SECTORS
from turtlebot_gym.validation import POSITIVE, did_you_mean, refusal, shown, whole
from turtlebot_gym.values import Covariance, Pose, State


class Observed(IntEnum):
    """The robot's pose that a policy observes."""

    EKF = 0
    """The filter's estimate."""
    ODOMETRY = 1
    """The measured pose."""
    TRUTH = 2
    LOCATED = -1
    """The estimate of a robot that localizes itself; the policy also observes how well the estimate fits."""


OBSERVED = {observed.name.lower(): observed for observed in Observed}
"""The observed poses by name."""
MOST = 100
"""Most numbers of a term, most values of it, and most steps from one to the next."""


SOURCE = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_]\w*", re.ASCII)
"""What the source of a term is: "module:name"."""


def _bounds(name: str, bound: Any) -> tuple[float, ...]:
    """Return the bounds of a term's numbers.

    Raises:
        ValueError: If they are not from 1 to `MOST` numbers.
    """
    given = bound if isinstance(bound, (list, tuple, np.ndarray)) else (bound,)
    try:
        if 1 <= len(given) <= MOST:
            return tuple(float(number) for number in given)
    except (TypeError, ValueError, OverflowError):
        pass
    raise refusal(f"a bound of the term {name!r}", f"a number, or up to {MOST} numbers", bound)


@dataclass(frozen=True, slots=True)
class ObservationTerm:
    """A term of an observation: one number, or several.

    On a robot, the package itself computes its own terms; another one needs a ``topic`` that brings it there.
    """

    name: str
    """Its name, by which policies and bundles ask for it."""
    of: Callable[..., Any]
    """``of(world, p)``, a kernel, returns its number, or a tuple of its numbers; it takes `systems.Snapshot` and
    `systems.Parameters`. Of a term in a scene, ``of(scene)`` returns an array."""
    low: float | tuple[float, ...]
    """Lower bound of each number; it is clipped to the bounds."""
    high: float | tuple[float, ...]
    """Upper bounds."""
    unit: str = ""
    """Unit of its numbers, such as "m"; empty for shares and for several units."""
    sensor: Any = None
    """A `systems.Sensor` that the term reads, which the robot then has: ``world.senses`` holds its value under its name."""
    topic: str = ""
    """ROS topic that brings the term on a robot; empty if only the environment has it."""
    message: str = ""
    """Type of the topic's messages, such as "std_msgs/msg/Bool"."""
    convert: Callable[[Any], Any] | None = None
    """Function of a message that returns the number, or the numbers."""
    lasts: float = 0.5
    """Age from which a message counts as missing, s; the robot then stands."""
    in_scene: bool = False
    """Whether its numbers are an array of the scene: of a LiDAR, for example."""
    length: int = 1
    """How many values it shows: the present one, and before it those of earlier steps."""
    every: int = 1
    """Steps from one of them to the next."""
    source: str = ""
    """"module:name" of a term of one's own."""

    def __post_init__(self) -> None:
        if not (isinstance(self.name, str) and self.name.isidentifier()):
            raise refusal("ObservationTerm.name", "a name, such as 'bumper'", self.name)
        low, high = (_bounds(self.name, bound) for bound in (self.low, self.high))
        if len(low) != len(high) or not all(-math.inf < a < b < math.inf for a, b in zip(low, high, strict=True)):
            raise ValueError(
                f"ObservationTerm {self.name!r}: low must be below high, both finite, got {shown(low)} and {shown(high)}."
            )
        if bool(self.topic) != bool(self.message and self.convert):
            raise ValueError(f"ObservationTerm {self.name!r}: topic, message and convert belong together.")
        POSITIVE.check(f"ObservationTerm {self.name!r}: lasts", self.lasts)
        for name in ("length", "every"):
            whole(f"ObservationTerm {self.name!r}: {name}", getattr(self, name), 1, MOST)
        object.__setattr__(self, "low", low)
        object.__setattr__(self, "high", high)

        if self.source and not SOURCE.fullmatch(self.source):
            raise refusal(f"the source of the term {self.name!r}", "MODULE:NAME", self.source)

    @property
    def bounds(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Lower and upper bounds of the present numbers."""
        return self.low, self.high  # type: ignore[return-value]

    @property
    def width(self) -> int:
        """How many numbers it has at a time."""
        return len(self.bounds[0])

    @property
    def size(self) -> int:
        """How many numbers of an observation it is."""
        return self.width * self.length

    def over(self, length: int, *, every: int = 1) -> ObservationTerm:
        """Return the term as a history: the present value, and earlier ones after it; before an episode, the first one."""
        return replace(self, length=length, every=every)

    def read(self, value: Any) -> tuple[float, ...]:
        """Return numbers that were measured for the term, clipped to its bounds.

        Raises:
            ValueError: If they are not as many finite numbers as the term has.
        """
        try:
            numbers = np.atleast_1d(np.asarray(value, np.float64))
        except (TypeError, ValueError, OverflowError):
            numbers = np.empty(0)
        if numbers.shape != (self.width,) or not np.isfinite(numbers).all():
            raise refusal(f"the term {self.name!r}", f"{self.width} finite number{'s' * (self.width > 1)}", value)
        return tuple(np.clip(numbers, *self.bounds).tolist())

    def example(self, world: Any, p: Any) -> Any:
        """Return the value of a term in a world, before it is clipped.

        Raises:
            ValueError: If its kernel fails, or returns another number of numbers; the message is one line that says where.
        """
        try:
            value = getattr(self.of, "__wrapped__", self.of)(world, p)
        except Exception as error:
            raise failure(self.source or self.name, error) from error
        if (count := len(value) if isinstance(value, tuple) else 1) != self.width:
            raise ValueError(f"the term {self.name!r} has bounds of {self.width} numbers, but its kernel returns {count}.")
        return value

    @property
    def spelled(self) -> str:
        """How the option ``observation`` names the term."""
        history = "" if self.length == 1 else f"*{self.length}" + (f"@{self.every}" if self.every > 1 else "")
        return (self.source or self.name) + history


class Observation(NamedTuple):
    """The numbers of an observation on open ground; "believed" is what the environment observes."""

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


MAX_DISTANCE, MAX_TWIST, MAX_STD_POSITION, MAX_STD_HEADING, MAX_NIS = 20.0, 2.0, 5.0, PI, 25.0


@kernel
def _towards(state: State, sine: float, cosine: float, to: Pose) -> tuple[float, float, float]:
    """Return distance, and cosine and sine of the bearing, of a point seen from a pose."""
    dx, dy = to.x - state.x, to.y - state.y
    distance = sqrt(dx * dx + dy * dy)
    scale = 1.0 / (distance if distance > 0.0 else 1.0)
    ahead, left = (dx * cosine + dy * sine) * scale, (dy * cosine - dx * sine) * scale
    return (
        min(distance, MAX_DISTANCE), max(min(ahead, 1.0), -1.0) if distance > 0.0 else 1.0, max(min(left, 1.0), -1.0)
    )  # fmt: skip


@kernel
def goal_from(state: State, reference: Pose) -> tuple[float, float, float, float, float]:
    """Return the numbers of `GOAL` for a believed state."""
    sine, cosine = sincos(state.theta)
    distance, ahead, left = _towards(state, sine, cosine, reference)
    sin_turn, cos_turn = sincos(reference.theta - state.theta)
    return distance, ahead, left, cos_turn, sin_turn


@kernel
def next_goal_from(state: State, following: Pose) -> tuple[float, float, float]:
    """Return the numbers of `NEXT_GOAL` for a believed state."""
    sine, cosine = sincos(state.theta)
    return _towards(state, sine, cosine, following)


@kernel
def twist_of(state: State, robot: Robot) -> tuple[float, float]:
    """Return the numbers of `TWIST`."""
    v, omega = state.v / robot.max_linear, state.omega / robot.max_angular
    return max(min(v, MAX_TWIST), -MAX_TWIST), max(min(omega, MAX_TWIST), -MAX_TWIST)


@kernel
def uncertainty_of(std: tuple[float, float], nis: float) -> tuple[float, float, float]:
    """Return the numbers of `UNCERTAINTY` for standard deviations of position and heading, m and rad."""
    return min(std[0], MAX_STD_POSITION), min(std[1], MAX_STD_HEADING), min(nis, MAX_NIS)


@kernel
def stated_deviations(P: Covariance) -> tuple[float, float]:
    """Return the standard deviations of position (root of the trace) and heading in a covariance; m, rad."""
    return sqrt(P.xx + P.yy), sqrt(P.tt)


def observe(state: State, std: tuple[float, float], nis: float, reference: Pose, following: Pose, robot: Robot) -> Observation:
    """Return a policy's observation on open ground.

    Args:
        state: Believed pose and twist.
        std: Standard deviations of position and heading; m, rad.
        nis: Normalized innovation squared of the last measurement.
        reference: The waypoint to reach.
        following: The waypoint after it.
        robot: Robot whose limits scale the twist.
    """
    goals = goal_from(state, reference), next_goal_from(state, following)
    return Observation(*goals[0], *twist_of(state, robot), *uncertainty_of(std, nis), *goals[1])


@kernel
def evidence_of(theta: float, P: Covariance, fits: float, weight: float) -> tuple[float, float, float, float]:
    """Return the numbers of `EVIDENCE`.

    Args:
        theta: Believed heading, rad.
        P: Covariance of the belief.
        fits: Share of the last scan's beams that end near a surface of the map.
        weight: Weight of the best hypothesis of where the robot is; 1 while there is only one.

    Returns:
        Stated standard deviation of the position in the direction of the believed heading, m, which in a corridor without ends
        grows; across it; the share; and the weight.
    """
    sine, cosine = sincos(theta)
    cross = 2.0 * sine * cosine * P.xy
    ahead = cosine * cosine * P.xx + cross + sine * sine * P.yy
    aside = sine * sine * P.xx - cross + cosine * cosine * P.yy
    return (
        min(sqrt(max(ahead, 0.0)), MAX_STD_POSITION),
        min(sqrt(max(aside, 0.0)), MAX_STD_POSITION),
        max(min(fits, 1.0), 0.0),
        max(min(weight, 1.0), 0.0),
    )


@kernel
def _is_believed(p: Any) -> bool:
    """Return whether the policy observes the filter's estimate.

    In compiled code ``p.observed`` is a float, which compares with the value of an `Observed` only.
    """
    return (p.observed == Observed.EKF.value) | (p.observed == Observed.LOCATED.value)


@kernel
def observed_state(body: Any, senses: Any, estimate: Any, p: Any) -> State:
    """Return the robot's state that the policy observes: the estimated one, the measured one or the true one."""
    mean, z, u, truth = estimate.belief.mean, senses.odometry.pose, senses.odometry.twist, body.true_state
    believed, measured = _is_believed(p), p.observed == Observed.ODOMETRY.value
    return State(
        mean.x if believed else (z.x if measured else truth.x),
        mean.y if believed else (z.y if measured else truth.y),
        mean.theta if believed else (z.theta if measured else truth.theta),
        mean.v if believed else (u.v if measured else truth.v),
        mean.omega if believed else (u.omega if measured else truth.omega),
    )


@kernel
def _state(world, p):
    return observed_state(world.body, world.senses, world.estimate, p)


@kernel
def _goal(world, p):
    return goal_from(_state(world, p), world.course.reference)


@kernel
def _twist(world, p):
    return twist_of(_state(world, p), p.robot)


@kernel
def _uncertainty(world, p):
    position, heading = stated_deviations(world.estimate.belief.covariance)
    believed, measured = _is_believed(p), p.observed == Observed.ODOMETRY.value
    R = p.tuning.R
    std = (
        position if believed else (sqrt(R[0] + R[1]) if measured else 0.0),
        heading if believed else (sqrt(R[2]) if measured else 0.0),
    )
    return uncertainty_of(std, world.estimate.nis if believed else 0.0)


@kernel
def _next_goal(world, p):
    return next_goal_from(_state(world, p), world.course.following)


@kernel
def _evidence(world, p):
    (mean, P), estimate = world.estimate.belief, world.estimate
    return evidence_of(mean.theta, P, estimate.fits, estimate.weight)


@kernel
def _scan(scene):
    return scene.lidar.sectors


@kernel
def _scan_age(world, p):
    return min(world.room.scan_age, MAX_AGE)


_POINT = ((0.0, -1.0, -1.0), (MAX_DISTANCE, 1.0, 1.0))
GOAL = ObservationTerm("goal", _goal, (*_POINT[0], -1.0, -1.0), (*_POINT[1], 1.0, 1.0))
"""The waypoint to reach: distance, m; cosine and sine of its bearing in the body frame, and of the heading still to turn."""
TWIST = ObservationTerm("twist", _twist, (-MAX_TWIST,) * 2, (MAX_TWIST,) * 2)
"""Speed and turning rate, as shares of the robot's limits."""
UNCERTAINTY = ObservationTerm("uncertainty", _uncertainty, (0.0,) * 3, (MAX_STD_POSITION, MAX_STD_HEADING, MAX_NIS))
"""Stated standard deviations of position and heading, m and rad, and the last measurement's normalized innovation squared."""
NEXT_GOAL = ObservationTerm("next_goal", _next_goal, *_POINT)
"""The waypoint after the one to reach, or the same one again: distance, m, and cosine and sine of its bearing."""
EVIDENCE = ObservationTerm("evidence", _evidence, (0.0,) * 4, (MAX_STD_POSITION, MAX_STD_POSITION, 1.0, 1.0))
"""How sure a localizer is, see `evidence_of`."""
SCAN = ObservationTerm("scan", _scan, (0.0,) * SECTORS, (1.0,) * SECTORS, in_scene=True)
"""Shortest range of the newest scan in each sector, from ahead to the left, as a share of 3.5 m."""
SCAN_AGE = ObservationTerm("scan_age", _scan_age, 0.0, MAX_AGE, "s")
"""Age of that scan, by its stamp."""

OPEN_GROUND = GOAL, TWIST, UNCERTAINTY, NEXT_GOAL
"""What a policy sees on open ground, 13 numbers: an `Observation`."""
ROOM = *OPEN_GROUND, SCAN, SCAN_AGE
"""What a policy sees in a room, 50 numbers."""
LOCATED_ROOM = *OPEN_GROUND, EVIDENCE, SCAN, SCAN_AGE
"""What a policy sees in a room in which the robot localizes itself, with ``observation="located"``: 54 numbers."""
TERMS = {term.name: term for term in LOCATED_ROOM}
"""The package's own terms by name."""


def size_of(terms: Sequence[ObservationTerm]) -> int:
    """Return how many numbers an observation of some terms has."""
    return sum(term.size for term in terms)


def slices_of(terms: Sequence[ObservationTerm]) -> dict[str, slice]:
    """Return where the numbers of each term stand in an observation, by its name."""
    ends = np.cumsum([term.size for term in terms]).tolist()
    return {term.name: slice(end - term.size, end) for term, end in zip(terms, ends, strict=True)}


def columns_of(wanted: Sequence[ObservationTerm], terms: Sequence[ObservationTerm]) -> NDArray[np.intp]:
    """Return the columns in which some terms stand in an observation of others; a history holds each shorter one.

    Raises:
        ValueError: If one is missing there; the message names it.
    """
    places, there = slices_of(terms), {term.name: term for term in terms}
    columns: list[int] = []
    for term in wanted:
        other = there.get(term.name, term)
        if (other.bounds, other.unit) != (term.bounds, term.unit):
            raise ValueError(f"it reads {term.spelled!r} with other bounds or another unit than {other.spelled!r} has")
        if term.source and other.source and term.source != other.source:
            raise ValueError(f"it reads {term.spelled!r}, not {other.spelled!r} of the same name")
        is_shorter = other.length < term.length or (term.length > 1 and other.every != term.every)
        if term.name not in there or is_shorter:
            raise ValueError(
                f"it reads {term.spelled!r}, which is not in the observation {','.join(each.spelled for each in terms)}"
            )
        start = places[term.name].start
        columns.extend(range(start, start + term.size))
    return np.array(columns, np.intp)


def bounds_of(terms: Sequence[ObservationTerm]) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return the lower and upper bounds of an observation."""
    low, high = zip(*([bound * term.length for bound in term.bounds] for term in terms), strict=True)
    return tuple(number for part in low for number in part), tuple(number for part in high for number in part)


@cache
def _clipped(term: ObservationTerm) -> ObservationTerm:
    """Return a term whose numbers are within its bounds; the kernel's attribute ``__wrapped__`` is the one before."""
    of, bounds = term.of, tuple(zip(*term.bounds, strict=True))
    if term.width == 1:
        ((low, high),) = bounds
        clipped: Any = kernel(lambda world, p: min(max(of(world, p), low), high))
    else:
        clip = _clip(term.width)
        clipped = kernel(lambda world, p: clip(of(world, p), bounds))
    clipped.__wrapped__ = of
    return replace(term, of=clipped)


def _clip(number: int) -> Callable[..., Any]:
    """Return the kernel that clips so many numbers of a tuple, each to its own bounds."""
    last = number - 1
    before = _clip(last) if last else kernel(lambda numbers, bounds: ())

    @kernel
    def clip(numbers, bounds):
        return before(numbers, bounds) + (min(max(numbers[last], bounds[last][0]), bounds[last][1]),)  # noqa: RUF005

    return clip


_HISTORY = re.compile(r"(.+?)\*(\d+)(?:@(\d+))?")


def read_items(observation: Any) -> tuple[str, tuple[str, ...]]:
    """Return the pose that a policy observes, a name in `OBSERVED`, and the names of terms beside it.

    Args:
        observation: The option: names with commas, or several names.

    Raises:
        ValueError: If it is something else, or names several poses.
    """
    given = observation.split(",") if isinstance(observation, str) else observation
    if not isinstance(given, (list, tuple)) or not given or not all(isinstance(item, str) for item in given):
        raise refusal("observation", "names of terms with commas, such as 'ekf,scan*2,MODULE:NAME'", observation)
    items = tuple(item.strip() for item in given)
    poses = [item for item in items if item in OBSERVED]
    if len(poses) > 1:
        raise ValueError(f"observation must name one pose, got {' and '.join(map(repr, poses))}.")
    return (poses or ["ekf"])[0], items


def read_terms(items: Sequence[str], own: Sequence[ObservationTerm]) -> tuple[ObservationTerm, ...]:
    """Return the terms that an observation names.

    Args:
        items: Names: of a pose, for all of a system's own terms; of a term; "MODULE:NAME" of one's own; with "*N", the last N
            values, or "*N@K", each K steps before the next. A history replaces the term that was named before it.
        own: The system's own terms.

    Raises:
        ValueError: If there is no such term, or one is named twice.
    """
    terms: dict[str, ObservationTerm] = {}
    for item in items:
        match = _HISTORY.fullmatch(item)
        name, length, every = match.groups() if match else (item, None, None)
        found = list(own) if name in OBSERVED and not match else [_term(name, own)]
        for term in found:
            if (before := terms.get(term.name)) and not (match and before == term):
                raise ValueError(f"observation has the term {term.name!r} twice: leave out one of them.")
            terms[term.name] = term.over(int(length or 1), every=int(every or 1)) if match else term
    if all(term.in_scene for term in terms.values()):
        raise ValueError(f"observation must have a term beside {', '.join(map(repr, terms))}, such as 'goal'.")
    return tuple(terms.values())


def _term(name: str, own: Sequence[ObservationTerm]) -> ObservationTerm:
    """Return a term of a system, of the package, or of one's own."""
    known = TERMS | {term.name: term for term in own}
    if ":" in name:
        return own_term(name)
    if name not in known:
        raise ValueError(
            f"observation has no term {shown(name)}: there are {', '.join((*OBSERVED, *known))}, and MODULE:NAME for one of "
            f"your own.{did_you_mean(name, (*OBSERVED, *known))}"
        )
    return known[name]


def own_term(source: str) -> ObservationTerm:
    """Return a term of one's own.

    Args:
        source: "MODULE:NAME".

    Raises:
        ValueError: If there is none, or it has the name of one of the package's.
    """
    term = load_object(source)
    if not isinstance(term, ObservationTerm):
        raise refusal(f"observation {source!r}", "a turtlebot_gym.observations.ObservationTerm", term)
    if term.name in TERMS or term.name in OBSERVED:
        raise ValueError(f"observation {source!r}: the package has a term {term.name!r} already: give yours another name.")
    if term.in_scene:
        raise ValueError(f"observation {source!r}: in_scene is for the package's own terms: return numbers of the world.")
    return _clipped(replace(term, source=source))


def _each(terms: tuple[ObservationTerm, ...]) -> Callable[..., Any]:
    """Return the kernel of each term's value, as a tuple."""
    of, rest = terms[0].of, _each(terms[1:]) if terms[1:] else None
    if rest is None:
        return kernel(lambda world, p: (of(world, p),))
    return kernel(lambda world, p: (of(world, p),) + rest(world, p))  # noqa: RUF005  # no star in compiled code


class PresentValues(NamedTuple):
    """The values of all terms of an observation that are in no scene."""

    values: tuple[Any, ...]


@cache
def observing(terms: tuple[ObservationTerm, ...]) -> Callable[..., PresentValues]:
    """Return the kernel ``observe(world, p)`` of an observation's terms."""
    each = _each(tuple(term for term in terms if not term.in_scene))
    return kernel(lambda world, p: PresentValues(each(world, p)))


class ColumnRun(NamedTuple):
    """Consecutive numbers of what `observing` returns, and where they stand in an observation."""

    start: int
    """The first of them ..."""
    stop: int
    """... and the one after the last."""
    column: int
    """Column of the first."""


class SceneColumns(NamedTuple):
    """An array in a scene, and where it stands in an observation."""

    of: Callable[..., Any]
    """``of(scene)`` returns it."""
    width: int
    column: int


def runs_of(terms: Sequence[ObservationTerm]) -> tuple[tuple[ColumnRun, ...], tuple[SceneColumns, ...]]:
    """Return where the present numbers of some terms stand in an observation; others are the past of a history."""
    places, runs, blocks, number = slices_of(terms), list[ColumnRun](), list[SceneColumns](), 0
    for term in terms:
        column = places[term.name].start
        if term.in_scene:
            blocks.append(SceneColumns(term.of, term.width, column))
            continue
        if runs and runs[-1].column + runs[-1].stop - runs[-1].start == column:
            runs[-1] = runs[-1]._replace(stop=number + term.width)
        else:
            runs.append(ColumnRun(number, number + term.width, column))
        number += term.width
    return tuple(runs), tuple(blocks)


def row_of(terms: Sequence[ObservationTerm], values: Any) -> tuple[float, ...]:
    """Return an observation from the present value of each term; the past of a history is the present."""
    rows = (value if isinstance(value, tuple) else (value,) for value in values)
    return tuple(number for term, row in zip(terms, rows, strict=True) for number in row * term.length)


class History:
    """The past values of terms that show more than the present one, of some environments.

    Args:
        terms: The terms of the observation.
        rows: How many environments there are.
    """

    def __init__(self, terms: Sequence[ObservationTerm], rows: int) -> None:
        places, self._at = slices_of(terms), 0
        self._parts: list[tuple[int, int, int, int, NDArray[np.float32]]] = []
        for term in terms:
            if term.length > 1:
                past = np.zeros(((term.length - 1) * term.every + 1, rows, term.width), np.float32)
                self._parts.append((places[term.name].start, term.width, term.length, term.every, past))

    def __bool__(self) -> bool:
        return bool(self._parts)

    def begin(self, observations: NDArray[Any], mask: NDArray[np.bool_]) -> None:
        """Begin episodes of some environments, whose present numbers stand in ``observations``, shape (N, k)."""
        for start, width, _, _, past in self._parts:
            past[:, mask] = observations[mask, start : start + width]
        self.show(observations)

    def advance(self, observations: NDArray[Any]) -> None:
        """Take a step: remember the present numbers of all environments, and write the past ones beside them."""
        self._at += 1
        for start, width, _, _, past in self._parts:
            past[self._at % len(past)] = observations[:, start : start + width]
        self.show(observations)

    def show(self, observations: NDArray[Any]) -> None:
        """Write the past numbers."""
        for start, width, length, every, past in self._parts:
            for k in range(1, length):
                to = start + k * width
                observations[:, to : to + width] = past[(self._at - k * every) % len(past)]
