"""All parameters of a step, gathered from names of presets or values."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from turtlebot_gym.estimation.fixes import depth_of
from turtlebot_gym.models.unicycle import INTEGRATORS
from turtlebot_gym.parameters import REFERENCE_PERIOD, FilterTuning, FixNoise, Noise, Reward
from turtlebot_gym.plants import MujocoBurger, make_plant
from turtlebot_gym.presets import make_filter, make_fix, make_noise, make_robot
from turtlebot_gym.robots import Robot
from turtlebot_gym.tasks import NAV, Task
from turtlebot_gym.validation import choose, made, number, whole

BELIEVED, MEASURED, TRUE = 0.0, 1.0, 2.0
OBSERVED = {"ekf": BELIEVED, "odometry": MEASURED, "truth": TRUE}
"""Choices for the robot's pose that the policy observes."""

MAX_DELAY = 3
"""Longest delay of a command, steps."""
MAX_DEPTH = 25
"""Greatest delay of a fix in steps; each step is stored and compiled."""
MIN_DT, MAX_DT = 1e-4, 10.0
"""Shortest and longest control interval, s."""


class Parameters(NamedTuple):
    """Everything that an environment's step depends on besides its state and its key."""

    robot: Robot
    noise: Noise
    tuning: FilterTuning
    task: Task
    reward: Reward
    dt: float
    """Control interval, s."""
    middle: float
    """The integrator, a value of `models.unicycle.INTEGRATORS`."""
    observed: float
    """Observed pose, a value of `OBSERVED`."""
    delay: float
    """Delay of commands in steps, a whole number from 0 to `MAX_DELAY`."""
    room: Any = ()
    """Parameters of a room, `systems.rooms.RoomParameters`; an empty tuple on open ground."""
    fix: Any = ()
    """External pose sensor, a `FixNoise`; an empty tuple if there is none."""
    plant: Any = ()
    """Plant: an empty tuple for the unicycle, a `turtlebot_gym.plants.MujocoBurger` for MuJoCo."""


def make_parameters(
    task: Task = NAV,
    *,
    robot: str | Robot = "burger",
    noise: str | Noise = "tutorial",
    filter: str | FilterTuning = "matched",
    integrator: str = "euler",
    observation: str = "ekf",
    reward: Reward | Mapping[str, float] | None = None,
    dt: float = REFERENCE_PERIOD,
    delay: int = 0,
    fix: str | FixNoise | None = None,
    plant: str | MujocoBurger = "unicycle",
) -> Parameters:
    """Return the checked parameters of an environment from names of presets or values.

    Args:
        task: When waypoints count as reached, and when an episode ends.
        robot: A name in `robots.ROBOTS`, or a robot.
        noise: A name in `presets.NOISES`, or a noise model.
        filter: A name in `presets.FILTERS`, or a tuning.
        integrator: "euler" or "midpoint".
        observation: The robot's pose that the policy observes: "ekf", "odometry" or "truth".
        reward: Weights, or a mapping of some of them; None for the default ones.
        dt: Control interval, s.
        delay: Delay of commands in steps, 0 to 3.
        fix: External pose sensor: a name in `presets.FIXES`, or its noise; None for none.
        plant: A name in `turtlebot_gym.plants.PLANTS`, or a Burger for MuJoCo.

    Raises:
        ValueError: If a name is unknown, dt is not positive, the delay is out of its range, or the plant is another robot or dt
            is not a multiple of its step.
    """
    late, interval = whole("delay", delay, 0, MAX_DELAY), number("dt", dt)
    if not MIN_DT <= interval <= MAX_DT:
        raise ValueError(f"dt must be positive, from {MIN_DT:g} to {MAX_DT:g} s, got {dt!r}.")
    late_fix = () if fix is None else make_fix(fix)
    if late_fix and depth_of(interval, late_fix.delay) > MAX_DEPTH:
        raise ValueError(f"fix must come at most {MAX_DEPTH} steps late, got {late_fix.delay!r} s with dt {interval!r} s.")
    model, body, physics = make_noise(noise), make_robot(robot), make_plant(plant)
    if physics:
        physics.steps(interval)
        if body.wheel_separation != physics.wheel_separation:
            raise ValueError(
                f"plant is a robot with a track of {physics.wheel_separation:g} m, so robot must be 'burger', 'tutorial' or "
                f"another one with that track, got {body.wheel_separation:g} m."
            )
    return Parameters(
        body,
        model,
        make_filter(filter, model),
        task,
        Reward() if reward is None else made(Reward, reward, "reward"),
        interval,
        choose("integrator", integrator, INTEGRATORS),
        choose("observation", observation, OBSERVED),
        float(late),
        fix=late_fix,
        plant=physics,
    )
