"""Shared by the subcommands that drive a policy: options for the task and the robot."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from turtlebot_gym_agents.commands.console import Setting
from turtlebot_gym_agents.commands.flags import flags

_OPTIONS = flags("switch", "laps", "plant")


@dataclass(frozen=True, kw_only=True)
class Driven(_OPTIONS, Setting):
    """Environment, task and robot of a drive."""

    friction: float | None = None
    """Plant mujoco only: coefficient of friction between wheels and floor; by default 1, which grips."""
    caster_friction: float | None = None
    """Plant mujoco only: the same between caster and floor; by default 0.05. For a slippery floor use --friction 0.5
    --caster-friction 0.3."""
    allow_mismatch: bool = False
    """Also drive policies made for another task or observation."""

    def options(self) -> dict[str, Any]:
        """Return the keyword arguments of the environment, and whether a policy for another task may drive."""
        from turtlebot_gym.plants import make_plant

        plant = make_plant(self.plant, friction=self.friction, caster_friction=self.caster_friction)
        return super().options() | {"plant": plant or self.plant, "allow_mismatch": self.allow_mismatch}
