"""The system of some parameters, and what makes one with kernels and terms of one's own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from turtlebot_gym.config import refusal
from turtlebot_gym.estimation.filters import filter_of
from turtlebot_gym.estimation.fixes import late_by, with_fixes
from turtlebot_gym.files import load_object
from turtlebot_gym.observations import LOCATED_ROOM, TRACKS, Observed
from turtlebot_gym.observations.reading import read_terms
from turtlebot_gym.rewards import RewardTerm
from turtlebot_gym.systems.fixes import fix_sensor
from turtlebot_gym.systems.imu import IMU
from turtlebot_gym.systems.missions import on_missions
from turtlebot_gym.systems.open_ground import open_ground
from turtlebot_gym.systems.parameters import Parameters
from turtlebot_gym.systems.rooms import rooms
from turtlebot_gym.systems.scans import localizing, tracking
from turtlebot_gym.systems.system import System

SystemMaker = Callable[[Parameters], System]
"""A function of parameters that returns their system, as `system_of` is."""


def system_of(parameters: Parameters) -> System:
    """Return the system for some parameters: rooms or open ground, with their sensors and filter.

    Raises:
        ValueError: If the filter reads a sensor that the system does not have.
    """
    p, filter = parameters, filter_of(parameters.tuning)
    late = late_by(p.fix.delay, p.dt) if p.fix else 0
    filter = with_fixes(filter, late) if p.fix else filter
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


@dataclass(frozen=True)
class Assembly:
    """What makes a system as options say; a pickle holds it in place of kernels, which it cannot hold."""

    own: System | str | SystemMaker | None = None
    """System of one's own, a function of the parameters that returns it, or "module:name" of either; None for theirs."""
    rewards: tuple[RewardTerm, ...] = ()
    """Terms of the reward beside the system's."""
    observation: tuple[str, ...] = ()
    """Names of the terms of the observation, see `turtlebot_gym.observations.reading.read_terms`; empty for the system's."""

    def __call__(self, parameters: Parameters) -> System:
        """Return the system.

        Raises:
            ValueError: If there is none, making it fails, or a term needs what it does not have.
        """
        own: Any = load_object(self.own) if isinstance(self.own, str) else self.own
        system = made_of(system_of if own is None else own, parameters).with_rewards(*self.rewards)
        if self.observation:
            system = system.with_observation(*read_terms(self.observation, system.terms))
        if not any(term.name == TRACKS.name for term in system.terms):
            return system
        if not parameters.noise.odometry.wheel:
            raise ValueError("observation 'tracks' needs wheel odometry: choose such a noise, such as noise='wheel'.")
        return tracking(system)


def made_of(system: System | SystemMaker, parameters: Parameters) -> System:
    """Return a system that is given, or made by a function of the parameters; a ``ValueError`` refuses what is none."""
    made: Any = system(parameters) if callable(system) else system
    if not isinstance(made, System):
        raise refusal("system", "a System, a function of the parameters that returns one, or 'module:name' of either", made)
    if made.reads_scan and not made.surroundings:
        raise ValueError("System.reads_scan must be false without surroundings: there is no scan.")
    return made
