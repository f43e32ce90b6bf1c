"""The system of some parameters, and one with kernels and terms of one's own."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from turtlebot_gym.config import refusal
from turtlebot_gym.estimation.filters import filter_of
from turtlebot_gym.estimation.fixes import with_fixes
from turtlebot_gym.files import load_object
from turtlebot_gym.observations import LOCATED_ROOM, TRACKS, Observed
from turtlebot_gym.observations.reading import read_terms
from turtlebot_gym.rewards import RewardTerm
from turtlebot_gym.systems.missions import on_missions
from turtlebot_gym.systems.open_ground import open_ground
from turtlebot_gym.systems.parameters import Parameters
from turtlebot_gym.systems.rooms import rooms
from turtlebot_gym.systems.scans import localizing, tracking
from turtlebot_gym.systems.sensors import IMU, fix_sensor
from turtlebot_gym.systems.system import System


def system_of(parameters: Parameters) -> System:
    """Return the system for some parameters; a ``ValueError`` if its filter reads a sensor that it does not have."""
    p, filter = parameters, filter_of(parameters.tuning)
    late = round(p.fix.delay / p.dt) if p.fix else 0
    filter = with_fixes(filter, late, all_late=True) if p.fix else filter
    system = rooms(filter) if p.room else open_ground(filter)
    system = localizing(system) if p.localizer else system
    system = system._replace(terms=LOCATED_ROOM) if p.localizer and p.observed == Observed.LOCATED else system
    system = on_missions(system) if p.room and p.task.laps > 1.0 else system
    system = system.with_sensor(fix_sensor(late)) if p.fix else system
    system = system.with_sensor(IMU) if p.imu else system
    lacking = [name for name in filter.reads if name not in {sensor.name for sensor in system.sensors}]
    if lacking:
        raise ValueError(f"The filter reads the sensor {lacking[0]!r}: choose one with {lacking[0]}=...")
    return system


def assemble(
    parameters: Parameters, own: Any = None, rewards: Sequence[RewardTerm] = (), observation: Sequence[str] = ()
) -> System:
    """Return a system with terms of one's own; a ``ValueError`` if there is no such system, or a term lacks what it needs.

    Args:
        parameters: The parameters.
        own: A system, a function of the parameters that returns one, or "module:name" of either; None for `system_of`.
        rewards: Terms of the reward beside the system's.
        observation: Names of the terms of the observation, see `turtlebot_gym.observations.reading.read_terms`; empty for the
            system's.
    """
    own = system_of if own is None else load_object(own) if isinstance(own, str) else own
    system: Any = own(parameters) if callable(own) else own
    if not isinstance(system, System):
        raise refusal("system", "a System, a function of the parameters that returns one, or 'module:name' of either", system)
    system = system.with_rewards(*rewards)
    if observation:
        system = system.with_observation(*read_terms(observation, system.terms))
    if not any(term.name == TRACKS.name for term in system.terms):
        return system
    if not parameters.noise.odometry.wheel:
        raise ValueError("observation 'tracks' needs wheel odometry: choose such a noise, such as noise='wheel'.")
    return tracking(system)
