"""A person at the keyboard, by a script."""

from __future__ import annotations

from dataclasses import dataclass

from turtlebot_gym.values import STOP, Command
from turtlebot_gym_ros.node.block import Every, Output, ranged

SCRIPT = (
    (5.0, Command(0.15, 0.0)),
    (8.0, Command(0.15, 0.8)),
    (13.0, Command(0.15, 0.0)),
    (16.0, Command(0.15, -0.8)),
    (21.0, Command(0.15, 0.0)),
    (24.0, Command(0.0, 1.5)),
    (30.0, Command(0.15, 0.0)),
)
"""The reference system's 30 s: until which time, s, which command."""


class SimulatedTeleop:
    """Drive as the tutorial's person does, for 30 s, then stop and leave the robot to others. A reset begins again.

    Inputs: none. It drives as soon as somebody listens: whoever starts it is the person.
    Outputs: ``command`` (`Command`, on ``cmd_vel``).
    Parameters: those of `Params`.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Params:
        """Parameters of the scripted person."""

        period: float = ranged(0.1, 0.0, 1000.0, "positive, below 1000 s")
        """Period of the commands, s."""
        start_enabled: bool = True
        """Whether it drives at once, without a call of ``~/enable``."""

    inputs = {}
    outputs = {"command": Output(topic="cmd_vel", type=Command, stop=STOP)}

    def __init__(self, params: Params) -> None:
        self.trigger = Every(params.period)
        self.reset()

    def reset(self) -> None:
        """Begin the script again."""
        self._steps = 0

    def step(self, dt: float) -> dict[str, Command]:
        """Return the command of the present time; nothing after the end."""
        time = (self._steps + 0.5) * dt  # half a step off the script's edges, so that rounding decides nothing
        self._steps += 1
        return next(({"command": command} for until, command in SCRIPT if time < until), {})
