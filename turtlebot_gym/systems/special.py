"""Special cases of parameters with their own compiled loops, which leave out what the case makes idle.

The equations stay the same. Numbers that a case fixes are constants of its loop, and the compiler removes what follows from
them: a draw multiplied by zero, a rule that is switched off, a covariance that stays zero. So the results are bit-identical to
those of the general loop.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from turtlebot_gym.estimation.ekf import EXTENDED_KALMAN
from turtlebot_gym.systems.open_ground import open_ground
from turtlebot_gym.systems.parameters import BELIEVED
from turtlebot_gym.systems.system import System


class Special(NamedTuple):
    """Known numbers of a step, by their dotted paths; tuples of pairs stand for dicts."""

    parameters: tuple[tuple[str, float], ...] = ()
    """Fixed parameters of the case; all environments share all parameters."""
    world: tuple[tuple[str, float], ...] = ()
    """Numbers of the world that never change in this case."""
    same: tuple[tuple[str, str], ...] = ()
    """Numbers of the world that always equal another one in this case."""
    waypoints: int = 0
    """Number of waypoints; 0 for any."""


GENERAL = Special()
"""No special case: any parameters, which may differ between environments."""

_ALPHAS = ("alpha1", "alpha2", "alpha3", "alpha4")
_WITH_TWIST = ("xv", "xw", "yv", "yw", "tv", "tw", "vw")
_P = "estimate.belief.covariance"

QUIET = Special(
    parameters=(
        *((f"noise.process.{alpha}", 0.0) for alpha in _ALPHAS),
        *((f"tuning.process.{alpha}", 0.0) for alpha in _ALPHAS),
        *((f"{part}.process.{name}", value)
          for part in ("noise", "tuning") for name, value in (("scale", 1.0), ("turn_scale", 1.0), ("veer", 0.0))),
        ("noise.process.slip", 0.0),
        ("noise.process.slip_start", 0.0),
        ("noise.odometry.dropout_probability", 0.0),
        ("noise.odometry.quantization[0]", 0.0),
        ("noise.odometry.quantization[1]", 0.0),
        ("noise.odometry.wheel", 0.0),
        ("tuning.kind.remember_velocity", 0.0),
        ("tuning.kind.wrap_innovation", 1.0),
        ("tuning.kind.gate", math.inf),
        ("task.on_belief", 0.0),
        ("task.switch_period", math.inf),
        ("task.laps", 1.0),
        ("middle", 0.0),
        ("observed", BELIEVED),
        ("delay", 0.0),
    ),
    world=(
        ("body.slipping", 0.0),
        ("senses.odometry.measured", 1.0),
        ("estimate.rejections", 0.0),
        *((f"{_P}.{entry}", 0.0) for entry in _WITH_TWIST),
    ),
    same=(
        *((f"body.wheels.{name}", f"body.true_state.{name}") for name in ("x", "y", "theta")),
        *((f"{part}.{name}", f"body.true_state.{name}")
          for part in ("body.command", "senses.odometry.twist", "estimate.belief.mean") for name in ("v", "omega")),
        *((f"course.following.{name}", f"course.reference.{name}") for name in ("x", "y", "theta")),
    ),
    waypoints=1,
)  # fmt: skip
"""The default: one goal; commands are executed at once and exactly, all measurements arrive, and the policy observes the Kalman
filter's belief. The wheels' pose is then the robot's, and the twist is known."""


def special_of(system: System, numbers: dict[str, float], waypoints: int) -> Special:
    """Return the case of parameters that all environments share.

    Args:
        system: The system of the parameters.
        numbers: The parameters by dotted path.
        waypoints: Number of waypoints.
    """
    is_quiet = waypoints == QUIET.waypoints and all(numbers.get(path) == value for path, value in QUIET.parameters)
    return QUIET if is_quiet and system == open_ground(EXTENDED_KALMAN) else GENERAL
