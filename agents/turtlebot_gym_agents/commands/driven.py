"""Shared by the subcommands that drive a policy: options for the task and the robot."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from turtlebot_gym_agents.commands.console import ROOMS, Setting


@dataclass(frozen=True, kw_only=True)
class Driven(Setting):
    """Environment, task and robot of a drive."""

    switch: str | None = None
    """Square only: switch to the next waypoint on "arrival", or after a "time" of 15 s."""
    laps: int | None = None
    """Square only: number of rounds."""
    delay: int = 0
    """Delay of commands in steps."""
    plant: str = "unicycle"
    """Model that moves the robot: unicycle, or mujoco, a Burger with wheels that creep and slip, which needs the extra
    [mujoco]."""
    friction: float | None = None
    """Plant mujoco only: coefficient of friction between wheels and floor; by default 1, which grips."""
    caster_friction: float | None = None
    """Plant mujoco only: the same between caster and floor; by default 0.05. For a slippery floor use --friction 0.5
    --caster-friction 0.3."""
    allow_mismatch: bool = False
    """Also drive policies made for another task or observation."""

    def options(self) -> dict[str, Any]:
        """Return the environment's keyword arguments."""
        from turtlebot_gym.plants import make_plant

        given: dict[str, Any] = {name: value for name in ("switch", "laps") if (value := getattr(self, name)) is not None}
        if self.env == ROOMS and given:
            raise ValueError(f"switch and laps are for tasks with given waypoints, not for {ROOMS}.")
        plant = make_plant(self.plant, friction=self.friction, caster_friction=self.caster_friction)
        if plant:
            if self.env == ROOMS:
                raise ValueError(f"plant must be 'unicycle' for {ROOMS}: MuJoCo supports open ground only.")
            given["plant"] = plant
        return (
            {name: getattr(self, name) for name in ("filter", "robot", "arrival", "delay", "allow_mismatch")}
            | self.given()
            | given
        )
