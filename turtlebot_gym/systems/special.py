"""Special cases of parameters, for which a loop of their own is compiled: what they make idle is left out of it.

The equations stay as they are. Numbers that a case knows beforehand are constants of its loop, and the compiler drops what
follows from them: a draw that is multiplied by zero, a rule that is switched off, a covariance that stays zero. So the results
are those of the loop for all cases, to the bit.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from turtlebot_gym.estimation.interface import EXTENDED_KALMAN
from turtlebot_gym.systems.open_ground import open_ground
from turtlebot_gym.systems.parameters import BELIEVED
from turtlebot_gym.systems.system import System


class Special(NamedTuple):
    """What is known of a step, by the dotted paths of `Parameters` and `World`; tuples of pairs stand for dicts."""

    parameters: tuple[tuple[str, float], ...] = ()
    """Parameters of the case. They are the same for all environments, as are the others."""
    world: tuple[tuple[str, float], ...] = ()
    """Numbers of the world that then never change."""
    same: tuple[tuple[str, str], ...] = ()
    """Numbers of the world that then always equal another one."""
    waypoints: int = 0
    """How many there are; 0 for any number."""


GENERAL = Special()
"""No case: any parameters, and others in each environment."""

_ALPHAS = ("alpha1", "alpha2", "alpha3", "alpha4")
_WITH_TWIST = ("xv", "xw", "yv", "yw", "tv", "tw", "vw")
_P = "estimate.belief.covariance"

QUIET = Special(
    parameters=(
        *((f"noise.process.{alpha}", 0.0) for alpha in _ALPHAS),
        *((f"tuning.process.{alpha}", 0.0) for alpha in _ALPHAS),
        ("noise.process.scale", 1.0),
        ("noise.process.slip", 0.0),
        ("noise.process.slip_start", 0.0),
        ("noise.odometry.dropout_probability", 0.0),
        ("noise.odometry.quantization[0]", 0.0),
        ("noise.odometry.quantization[1]", 0.0),
        ("noise.odometry.wheel", 0.0),
        ("tuning.remember_velocity", 0.0),
        ("tuning.wrap_innovation", 1.0),
        ("tuning.gate", math.inf),
        ("task.on_belief", 0.0),
        ("task.switch_period", math.inf),
        ("task.laps", 1.0),
        ("middle", 0.0),
        ("observed", BELIEVED),
        ("delay", 0.0),
    ),
    world=(
        ("body.slipping", 0.0),
        ("senses.measured", 1.0),
        ("estimate.rejections", 0.0),
        *((f"{_P}.{entry}", 0.0) for entry in _WITH_TWIST),
    ),
    same=(
        *((f"body.wheels.{name}", f"body.true_state.{name}") for name in ("x", "y", "theta")),
        *((f"{part}.{name}", f"body.true_state.{name}")
          for part in ("body.command", "senses.twist", "estimate.belief.mean") for name in ("v", "omega")),
        *((f"course.following.{name}", f"course.reference.{name}") for name in ("x", "y", "theta")),
    ),
    waypoints=1,
)  # fmt: skip
"""One goal; commands are executed at once and exactly, measurements all arrive, and the Kalman filter's belief is shown: the
default. The wheels are then where the robot is, and the twist is known."""


def special_of(system: System, numbers: dict[str, float], waypoints: int) -> Special:
    """Return the case that parameters belong to, which all environments share.

    Args:
        system: Their system.
        numbers: The parameters by their dotted paths.
        waypoints: How many there are.
    """
    is_quiet = waypoints == QUIET.waypoints and all(numbers[path] == value for path, value in QUIET.parameters)
    return QUIET if is_quiet and system == open_ground(EXTENDED_KALMAN) else GENERAL
