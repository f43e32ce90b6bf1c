"""All parameters of a step."""

from __future__ import annotations

from typing import Any, NamedTuple

from turtlebot_gym.config import Range
from turtlebot_gym.observations import Observed
from turtlebot_gym.parameters import FilterTuning, Noise
from turtlebot_gym.robots import Robot
from turtlebot_gym.rooms.lidar import Lidar
from turtlebot_gym.rooms.plan import FloorPlan
from turtlebot_gym.rooms.rules import RoomRules
from turtlebot_gym.tasks import Task

MAX_DELAY = 3
"""Longest delay of a command, steps."""
DT = Range(1e-4, 10.0, unit="s")
"""What a control interval may be."""


class Parameters(NamedTuple):
    """Everything that an environment's step depends on besides its state and its key."""

    robot: Robot
    noise: Noise
    tuning: FilterTuning
    task: Task
    reward: Any
    """Weight of each term of the reward: `turtlebot_gym.rewards.default_weights`, or others."""
    dt: float
    """Control interval, s."""
    integrator: float
    observed: Observed
    delay: float
    """Delay of commands in steps, a whole number from 0 to `MAX_DELAY`."""
    room: Any = ()
    """Parameters of a room, `RoomParameters`; an empty tuple on open ground."""
    fix: Any = ()
    """External pose sensor, a `FixNoise`; an empty tuple if there is none."""
    imu: Any = ()
    """Gyro, a `systems.sensors.ImuNoise`; an empty tuple if there is none."""
    localizer: Any = ()
    """Localizer in the room, a `localization.tuning.LocalizerTuning`; an empty tuple if there is none."""


class RoomParameters(NamedTuple):
    """Parameters of a step in a room, beyond those of open ground."""

    rules: RoomRules
    """Rules by which the room is drawn."""
    lidar: Lidar
    """The robot's LiDAR."""


def make_room(world: RoomRules | FloorPlan, lidar: Lidar, dt: float) -> RoomParameters:
    """Return the parameters of a room by its rules or plan; refuse a LiDAR that turns more than once in ``dt``, s."""
    if lidar.rate * dt > 1.0 + 1e-9:
        raise ValueError(f"Lidar.rate must be at most one scan in a control interval of {dt:g} s, got {lidar.rate:g} Hz.")
    return RoomParameters(world.rules() if isinstance(world, FloorPlan) else world, lidar)
