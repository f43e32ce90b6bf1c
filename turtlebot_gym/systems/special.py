"""Special cases of parameters with their own compiled loops, which leave out what the case makes idle.

The equations stay the same. Numbers that a case fixes are constants of its loop, and the compiler removes what follows from
them: a draw multiplied by zero, a rule that is switched off, a covariance that stays zero. So the results are bit-identical to
those of the general loop.

Late fixes are rare: their cases have steps without one, and what follows for the few environments in which one arrives. Neither
part has branches, so both run in vectors, the second only for vectors in which a fix has arrived.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.estimation.ekf import EXTENDED_KALMAN
from turtlebot_gym.estimation.fixes import Remembered, late_by, no_fix, taking_fixes
from turtlebot_gym.estimation.slip import SLIP
from turtlebot_gym.kernel import kernel
from turtlebot_gym.models.unicycle import Integrator
from turtlebot_gym.observations import Observed
from turtlebot_gym.rewards import ON_GROUND, default_weights
from turtlebot_gym.systems.fixes import TrackedFix, fix_parts
from turtlebot_gym.systems.open_ground import open_ground
from turtlebot_gym.systems.system import System
from turtlebot_gym.systems.world import Snapshot
from turtlebot_gym.values import Covariance, Fix, State, senses_of


class _LateFixes(NamedTuple):
    """A system with fixes that are some steps late, in two parts."""

    complete: System
    without_fix_effects: System
    """The system without what an arriving fix does; the task must not depend on the belief."""
    apply_fix: Callable[..., Snapshot]
    """``apply_fix(world, key, p)`` returns the world after a step of `without_fix_effects`, with what a fix does if
    one arrived."""


_Senses = senses_of(("odometry", "fix"))


@cache
def late_fixes(late: int) -> _LateFixes:
    """Return the system of open ground with an extended Kalman filter that takes fixes ``late`` steps late, at least one."""
    (sensor, watch, measure), taking = fix_parts(late), taking_fixes(EXTENDED_KALMAN, late)
    insert_last = taking.insert_last

    @kernel
    def apply_fix(world, key, p):
        fix, before = world.senses.fix, world.estimate
        pose, R, age, arrived, cross, passed = measure(fix, key, int(world.steps), p)
        oldest, newest = insert_last(before, Fix(pose, R, age, arrived, cross), p.tuning, p.integrator)
        after = Remembered(newest.belief, newest.nis, newest, before.history, oldest, before.steps)
        senses = _Senses(world.senses.odometry, TrackedFix(pose, R, age, arrived, cross, passed) if fix.arrived else fix)
        return Snapshot(world.body, senses, after if fix.arrived else before, world.course, world.steps, world.room)

    without_fix_effects = open_ground(taking.filter._replace(step=taking.remember)).with_sensor(sensor._replace(sense=watch))
    return _LateFixes(open_ground(taking.filter).with_sensor(sensor), without_fix_effects, apply_fix)


class Special(NamedTuple):
    """Known numbers of a step, by their dotted paths; tuples of pairs stand for dicts."""

    parameters: tuple[tuple[str, float], ...] = ()
    """Fixed parameters of the case."""
    world: tuple[tuple[str, float], ...] = ()
    """Numbers of the world that never change in this case."""
    same: tuple[tuple[str, str], ...] = ()
    """Numbers of the world that always equal another one in this case."""
    waypoints: int = 0
    """Number of waypoints; 0 for any."""
    own: tuple[str, ...] | None = None
    """Parameters that may differ between environments; None for all."""
    name: str = ""
    """What the case is, for people."""
    late: int = 0
    """Number of steps by which fixes are late, see `late_fixes`; 0 without fixes."""

    def holds(self, parameters: Mapping[str, NDArray[np.float64]], waypoints: int) -> bool:
        """Return whether a batch is a case of this kind.

        Args:
            parameters: By dotted path, of all environments or of one that stands for all.
            waypoints: Number of waypoints.
        """
        fixed = all(path in parameters and (parameters[path] == value).all() for path, value in self.parameters)
        shared = () if self.own is None else parameters.keys() - {*self.own}
        alike = all((parameters[path] == parameters[path][0]).all() for path in shared)
        return fixed and alike and self.waypoints in (0, waypoints)

    def allows(self, before: Special) -> bool:
        """Return whether an episode that began in another case may go on in this one."""
        return {*self.world} <= {*before.world} and {*self.same} <= {*before.same} and self.late == before.late


GENERAL = Special()
"""No special case: any parameters, which may differ between environments."""

_ALPHAS = ("alpha1", "alpha2", "alpha3", "alpha4")
_WITH_TWIST = ("xv", "xw", "yv", "yw", "tv", "tw", "vw")
_P = "estimate.belief.covariance"

_SIMPLE = (
    *((f"noise.process.{alpha}", 0.0) for alpha in _ALPHAS),
    *((f"tuning.process.{name}", value) for name, value in (("scale", 1.0), ("turn_scale", 1.0), ("veer", 0.0))),
    ("tuning.process.alpha2", 0.0),
    ("tuning.process.alpha3", 0.0),
    ("noise.odometry.quantization[0]", 0.0),
    ("noise.odometry.quantization[1]", 0.0),
    ("noise.odometry.gap_end", 1.0),
    ("noise.odometry.wheel", 0.0),
    ("noise.odometry.leap_probability", 0.0),
    ("noise.odometry.reset_probability", 0.0),
    ("noise.odometry.reverse_probability", 0.0),
    ("tuning.kind.remember_velocity", 0.0),
    ("tuning.kind.wrap_innovation", 1.0),
    ("task.on_belief", 0.0),
    ("task.switch_period", math.inf),
    ("task.laps", 1.0),
    ("integrator", Integrator.EULER),
    ("observed", Observed.EKF),
)
_QUIET = (
    *(
        ("noise.process." + name, value)
        for name, value in (("scale", 1.0), ("turn_scale", 1.0), ("veer", 0.0), ("slip", 0.0), ("slip_start", 0.0))
    ),
    ("tuning.process.alpha1", 0.0),
    ("tuning.process.alpha4", 0.0),
    ("noise.odometry.dropout_probability", 0.0),
    ("delay", 0.0),
)
_OWN = (
    *(f"noise.process.{name}" for name in ("scale", "turn_scale", "veer", "slip", "slip_start", "slip_end")),
    *(f"noise.odometry.{name}[{at}]" for name in ("R", "bias") for at in range(3)),
    *(f"noise.odometry.{name}" for name in ("spike_probability", "spike", "dropout_probability")),
    *(f"tuning.R[{at}]" for at in range(3)),
    "tuning.process.alpha1",
    "tuning.process.alpha4",
    *(f"tuning.process.{name}" for name in ("slip", "slip_start", "slip_end")),
    "delay",
)
"""What a training draws for each environment."""


def _pairs(one: str, other: str, *names: str) -> Iterator[tuple[str, str]]:
    return ((f"{one}.{name}", f"{other}.{name}") for name in names)


_WHEELS = tuple(_pairs("body.wheels", "body.true_state", "x", "y", "theta"))
_TWISTS = tuple(
    pair for part in ("senses.odometry.twist", "estimate.belief.mean") for pair in _pairs(part, "body.command", "v", "omega")
)
_KNOWN = tuple((f"{_P}.{entry}", 0.0) for entry in _WITH_TWIST)
_ONE_GOAL = tuple(_pairs("course.following", "course.reference", "x", "y", "theta"))

_ANY_COURSE = Special(parameters=_SIMPLE, world=_KNOWN, same=(*_WHEELS, *_TWISTS), own=(), name="by waypoints")
_DRAWN_COURSE = _ANY_COURSE._replace(own=_OWN, name="by waypoints, drawn for each")
_QUIET_COURSE = _ANY_COURSE._replace(
    name="by waypoints without slip and delay",
    parameters=_SIMPLE + _QUIET,
    world=(*_KNOWN, ("body.slipping", 0.0), ("senses.odometry.measured", 1.0)),
    same=(*_WHEELS, *_pairs("body.command", "body.true_state", "v", "omega"), *_TWISTS),
)


def _to_one_goal(special: Special) -> Special:
    return special._replace(waypoints=1, same=special.same + _ONE_GOAL, name=special.name.replace("by waypoints", "to a goal"))


QUIET = _to_one_goal(_QUIET_COURSE)
"""The default: one goal; commands are executed at once and exactly, all measurements arrive, and the policy observes the Kalman
filter's belief. The wheels' pose is then the robot's, and the twist is known."""
SPECIALS = (
    QUIET,
    _QUIET_COURSE,
    _to_one_goal(_ANY_COURSE),
    _ANY_COURSE,
    _to_one_goal(_DRAWN_COURSE),
    _DRAWN_COURSE,
)
"""The cases, special ones before the general ones that include them: the default, and several waypoints; slip, wrong wheels,
lost measurements and delays; these with other values in each environment. Only what differs is loaded per environment."""


def _of_the_filter(path: str) -> bool:
    return path.startswith(("estimate.", "tuning.kind."))


def _with_slip(special: Special) -> Special:
    """Return a case with the filter that models slip.

    Its hypotheses have the twist of the odometry, all of it or the same share, so no covariance with it but in what they are
    merged into.
    """
    grip, slip = ([f"estimate.{mode}.{which}" for which in ("true", "high", "low")] for mode in ("gripping", "slipping"))
    return special._replace(
        parameters=tuple(pair for pair in special.parameters if not _of_the_filter(pair[0])),
        world=(
            *(pair for pair in special.world if not _of_the_filter(pair[0])),
            *((f"{belief}.covariance.{entry}", 0.0) for belief in (*grip, *slip) for entry in _WITH_TWIST),
        ),
        same=(
            *(pair for pair in special.same if not _of_the_filter(pair[0])),
            *(pair for belief in grip for pair in _pairs(f"{belief}.mean", "body.command", "v", "omega")),
            *(pair for belief in slip[1:] for pair in _pairs(f"{belief}.mean", f"{slip[0]}.mean", "v", "omega")),
        ),
        name=f"{special.name} with a filter that models slip",
    )


SLIPPING = tuple(map(_with_slip, SPECIALS))
"""The same cases with the filter that models slip."""


_POSE, _TWIST = ("pose.x", "pose.y", "pose.theta"), ("twist.v", "twist.omega")
_BELIEF = tuple(f"mean.{name}" for name in State._fields) + tuple(f"covariance.{name}" for name in Covariance._fields)


@cache
def with_late_fixes(special: Special, late: int) -> Special:
    """Return a case with fixes that are so many steps late: they count for the oldest estimate, never for a stored step."""
    steps = [f"estimate.history[{ago}]" for ago in range(late + 1)]
    none = {
        **dict.fromkeys((*_POSE, "age", "arrived", "cross[0]", "cross[1]", "cross[2]"), 0.0),
        **{f"R[{at}]": value for at, value in enumerate(no_fix().R)},
    }
    world = [(f"{step}.fix.{name}", value) for step in steps for name, value in none.items()]
    for path, value in special.world:
        if path == "senses.odometry.measured":
            world += [(path, value), *((f"{step}.{path}", value) for step in steps)]
        elif path.startswith("estimate."):
            rest = path.removeprefix("estimate.")
            world += [(f"estimate.{of}.{rest}", value) for of in ("newest", "oldest")]
            world.append((path, value))
        else:
            world.append((path, value))
    now, passed = "senses.odometry", "senses.fix.passed[0]"
    same = (
        *_pairs(f"{steps[0]}.{now}", now, *_POSE, *_TWIST, "measured"),
        *_pairs(passed, "body.true_state", "x", "y", "theta"),
        *_pairs("estimate.newest.belief", "estimate.belief", *_BELIEF),
        ("estimate.newest.nis", "estimate.nis"),
        *_pairs("estimate.oldest.belief.mean", f"{steps[-1]}.{now}.twist", "v", "omega"),
    )
    name = f"{special.name} with fixes {late} steps late"
    return special._replace(world=tuple(world), same=special.same + same, late=late, name=name)


def special_of(system: System, parameters: Mapping[str, NDArray[np.float64]], waypoints: int) -> Special:
    """Return the first case that holds.

    Args:
        system: The system of the parameters.
        parameters: By dotted path, of all environments or of one that stands for all.
        waypoints: Number of waypoints.
    """
    late = late_by(float(parameters["fix.delay"][0]), float(parameters["dt"][0])) if "fix.delay" in parameters else 0
    example = system.example._replace(reward=default_weights(ON_GROUND))
    plain = system._replace(rewards=ON_GROUND, example=example)  # a reward changes no case
    if plain == open_ground(SLIP):
        cases = SLIPPING
    elif plain == (late_fixes(late).complete if late else open_ground(EXTENDED_KALMAN)):
        cases = SPECIALS
    else:
        return GENERAL
    special = next((special for special in cases if special.holds(parameters, waypoints)), GENERAL)
    return with_late_fixes(special, late) if late and special != GENERAL else special
