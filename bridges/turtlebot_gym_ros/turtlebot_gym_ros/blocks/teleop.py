"""A scripted person at the keyboard."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

from turtlebot_gym.config import check_fields
from turtlebot_gym.values import STOP, Command
from turtlebot_gym_ros.node.block import PERIOD, Every, Output

STRAIGHT = 0.15, 0.0
SCRIPT = ((5, STRAIGHT), (8, (0.15, 0.8)), (13, STRAIGHT), (16, (0.15, -0.8)), (21, STRAIGHT), (24, (0.0, 1.5)), (30, STRAIGHT))
"""The 30 s of the reference system: end time, s, and command of each part."""


class SimulatedTeleop:
    """Drive like the person in the tutorial for 30 s, then stop and release the robot. A reset restarts the script.

    Inputs: none. It drives as soon as there is a listener, since starting it is the person's decision.
    Outputs: ``command`` (`Command`, on ``cmd_vel``).
    Parameters: those of `Params`.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Params:
        """Parameters of the scripted person."""

        period: Annotated[float, PERIOD] = 0.1
        """Period of the commands, s."""
        start_enabled: bool = True
        """Whether to drive at once, without a call of ``~/enable``."""

        def __post_init__(self) -> None:
            check_fields(self, "")

    inputs = {}
    outputs = {"command": Output(topic="cmd_vel", type=Command, stop=STOP)}
    trigger = Every(0.1)

    def __init__(self, params: Params) -> None:
        self.trigger = replace(self.trigger, period=params.period)
        self.reset()

    def reset(self) -> None:
        """Restart the script."""
        self._steps = 0

    def step(self, dt: float) -> dict[str, Command]:
        """Return the command for the current time; nothing after the end."""
        time = (self._steps + 0.5) * dt  # half a step off the script's edges, so that the result does not depend on rounding
        self._steps += 1
        return next(({"command": Command(*command)} for until, command in SCRIPT if time < until), {})
