"""The plant: the environment's own transition."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

from turtlebot_gym.estimation.ekf import Estimate
from turtlebot_gym.models.random import MAX_SEED
from turtlebot_gym.systems import Episode, make_parameters
from turtlebot_gym.tasks import NAV
from turtlebot_gym.values import STOP, Command, Pose, Senses, State
from turtlebot_gym_ros.node.block import Every, Input, Output

THROUGH = {"estimate": Estimate, "reference": Pose, "next_reference": Pose}
"""Topics over which a step's odometry leads to the command that answers it, in their order."""


class TurtlebotSimulator:
    """Simulate a TurtleBot: each step is the environment's, with the noise that it would have for the same seed and episode.

    Inputs: ``command`` (`Command`, on ``cmd_vel``; held for ever, as a TurtleBot3 does; none yet means at rest). Outputs:
    ``truth`` (`State`, on ``true_state``) and ``odometry`` (`Senses`, on ``odom``: the measured pose, marked where it dropped
    out, with the twist that the wheels executed), both in the world frame. Parameters: those of `Params`. A reset begins the
    next episode.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Params:
        """Parameters of the simulator."""

        robot: str = "burger"
        """A name in `turtlebot_gym.robots.ROBOTS`."""
        noise: str = "tutorial"
        """A name in `turtlebot_gym.presets.NOISES`."""
        integrator: str = "euler"
        """"euler" or "midpoint"."""
        period: float = 0.1
        """Period of the odometry and of the simulation, s."""
        speed: float = 1.0
        """How many times faster than real time it runs; other than at 1 it sets ``/clock``. In lock-step this is the upper
        limit, and 0 is as fast as the nodes answer."""
        seed: int = 0
        """Seed of the noise."""
        witness: bool = False
        """Whether in lock-step time also waits for the recorder of a `Graph`, which says on ``recorded`` how far it has
        heard."""
        random_start: bool = False
        """Whether an episode starts where the navigation task draws it, instead of at the origin."""

        def __post_init__(self) -> None:
            if not 0 <= self.seed <= MAX_SEED:
                raise ValueError(f"seed must be in [0, {MAX_SEED}], got {self.seed!r}.")

    inputs = {"command": Input(topic="cmd_vel", type=Command, max_age=None, required=False, lock_step="same")}
    outputs = {
        "truth": Output(topic="true_state", type=State),
        "odometry": Output(topic="odom", type=Senses),
    }

    def __init__(self, params: Params) -> None:
        task = replace(NAV, random=params.random_start, max_steps=math.inf)
        p = make_parameters(task, robot=params.robot, noise=params.noise, integrator=params.integrator, dt=params.period)
        self.trigger = Every(params.period, params.speed, through=THROUGH, witness="recorded" if params.witness else None)
        self._episode = Episode(p, (Pose(0.0, 0.0, 0.0),), seed=params.seed)  # it has no waypoints: others drive
        self._begun = False

    def reset(self) -> None:
        """Begin the next episode."""
        self._episode.reset()
        self._begun = False

    def step(self, dt: float, command: Command | None) -> dict[str, Any]:
        """Return the first measurement; from the second call on, the result of a control interval."""
        if self._begun:
            self._episode.step(command or STOP)
        self._begun = True
        world = self._episode.world
        return {"truth": world.body.true_state, "odometry": world.senses}
