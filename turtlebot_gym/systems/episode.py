"""An environment in plain Python, without arrays or compiled code, with bit-identical results.

The ROS simulator runs it, tests compare the compiled loop with it, and it accepts another plant::

    system = system_of(parameters)._replace(move=my_plant)
    episode = Episode(parameters, waypoints, system=system)
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import chain
from typing import Any

from turtlebot_gym.models.random import episode_key
from turtlebot_gym.models.unicycle import command_of
from turtlebot_gym.rooms.plan import FloorPlan
from turtlebot_gym.systems.parameters import Parameters
from turtlebot_gym.systems.rooms import WithRewards, find_system
from turtlebot_gym.systems.system import System, step_of
from turtlebot_gym.systems.world import Outcome, Snapshot
from turtlebot_gym.values import Command, Pose


class Episode:
    """One environment, episode by episode; `Outcome` reports an episode's end, and it continues until it is reset.

    Args:
        parameters: Parameters of a step.
        waypoints: The poses to visit; unused if the task draws its goal.
        seed: Seed of the noise and of the task's draws.
        system: The kernels of a step, or what `find_system` takes; None for the system that belongs to the parameters.
        plan: The floor plan of a given room.
    """

    def __init__(
        self,
        parameters: Parameters,
        waypoints: Sequence[Pose] = (),
        *,
        seed: int = 0,
        system: System | str | Callable[[Parameters], System] | WithRewards | None = None,
        plan: FloorPlan | None = None,
    ) -> None:
        self.parameters, self.seed, self.number = parameters, seed, -1
        self.system = find_system(system, parameters)
        self._step = step_of(self.system)
        self._given = tuple(waypoints)
        around = self.system.surroundings
        scenes: Any = around.make([parameters]) if around else ()
        self.scene: Any = around.at(plan.share(scenes) if plan else scenes, 0) if around else ()
        if plan:
            self.scene = plan.put(self.scene)
        self.reset()

    def reset(self) -> Snapshot:
        """Begin the next episode of the seed, and return the world at its start."""
        p = self.parameters
        self.number += 1
        self.key = episode_key(self.seed, self.number)
        start, goal = self.system.lay_out(self.key, p, self.scene)
        self.waypoints = (goal,) if p.task.random else self._given
        self.world: Snapshot = self._step.begin(start, self.key, self.waypoints, p, self.scene)
        self.outcome = self._step.start_outcome(self.world)
        return self.world

    def step(self, command: Command) -> Outcome:
        """Advance by one control interval with the policy's command."""
        transition = self._step.transition
        self.world, self.outcome = transition(self.world, command, self.key, self.waypoints, self.parameters, self.scene)
        return self.outcome

    def act(self, action: Sequence[float]) -> Outcome:
        """Advance with an action: shares of the robot's speed and turning rate limits, clipped to [-1, 1]."""
        forward, turn = action
        return self.step(command_of(float(forward), float(turn), self.parameters.robot))

    def observe(self) -> Any:
        """Return the policy's observation in double precision; on open ground a `turtlebot_gym.tasks.Observation`."""
        seen, around = self._step.observe(self.world, self.parameters), self.system.surroundings
        if around is None:
            return seen
        *before, after = seen
        return (*chain.from_iterable(before), *around.ranges(self.scene).tolist(), after)
