"""All the numbers that a step depends on, gathered from presets' names or values."""

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
"""What the policy is shown as the robot's pose."""

MAX_DELAY = 3
"""Longest delay of a command, steps."""
MAX_DEPTH = 25
"""Most steps that a fix may come late: each of them is remembered, and compiled."""
MIN_DT, MAX_DT = 1e-4, 10.0
"""Shortest and longest control interval, s."""


class Parameters(NamedTuple):
    """All that an environment's step depends on, besides its state and its key."""

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
    """A value of `OBSERVED`."""
    delay: float
    """Steps by which a command comes late, a whole number from 0 to `MAX_DELAY`."""
    room: Any = ()
    """What a room is like: nothing on open ground, `systems.rooms.RoomParameters` in a room."""
    fix: Any = ()
    """What measures the pose from outside, a `FixNoise`; nothing where nothing does."""
    plant: Any = ()
    """What moves the robot: nothing is the unicycle, a `turtlebot_gym.plants.MujocoBurger` is that in MuJoCo."""


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
    """Return the parameters of an environment, checked, from presets' names or values.

    Args:
        task: When waypoints count as reached, and when an episode ends.
        robot: A name in `robots.ROBOTS`, or a robot.
        noise: A name in `presets.NOISES`, or a noise model.
        filter: A name in `presets.FILTERS`, or a tuning.
        integrator: "euler" or "midpoint".
        observation: What the policy is shown as the robot's pose: "ekf", "odometry" or "truth".
        reward: Weights, or a mapping of some of them; None for the default ones.
        dt: Control interval, s.
        delay: Steps by which a command comes late, 0 to 3.
        fix: What measures the pose from outside, now and then: a name in `presets.FIXES`, or its noise; None for nothing.
        plant: A name in `turtlebot_gym.plants.PLANTS`, or a Burger for MuJoCo.

    Raises:
        ValueError: If a name is unknown, dt is not positive, the delay is out of its range, or the plant is not this robot or
            has steps that do not fit into dt.
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
