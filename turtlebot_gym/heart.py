"""The loop: one step of a robot that acts on what its filter believes. Read this file first.

    act -> move -> sense -> believe -> look -> judge -> reward -> observe

`step` runs from the move to the reward; the policy acts before, and observes after it. Each part is a function of the system,
a *kernel*: open ground, rooms and filters differ in their kernels only. Plain Python runs them here, in ROS nodes too;
`turtlebot_gym.compiled` runs the same kernels for many environments, to the same bit.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.kernel import kernel
from turtlebot_gym.models.random import episode_key
from turtlebot_gym.models.unicycle import command_of
from turtlebot_gym.observations.columns import History, observing, row_of
from turtlebot_gym.rewards import rewarding
from turtlebot_gym.rooms.plan import FloorPlan
from turtlebot_gym.systems.assembly import system_of
from turtlebot_gym.systems.parameters import Parameters
from turtlebot_gym.systems.sensors import sensing
from turtlebot_gym.systems.system import System, course_after
from turtlebot_gym.systems.world import Outcome, Snapshot
from turtlebot_gym.tasks import distance_to
from turtlebot_gym.values import Command, Pose


class Step(NamedTuple):
    """The step of a system in three kernels, and its start in two."""

    begin: Callable[..., Snapshot]
    """``begin(pose, key, waypoints, p, scene)`` returns the world at the start of an episode, at rest."""
    start_outcome: Callable[..., Outcome]
    """``start_outcome(world)`` returns the outcome that stands for the start of an episode."""
    act: Callable[..., Snapshot]
    """``act(world, command, key, p)`` moves, senses and believes; without branches, so compiled loops run it in vectors."""
    conclude: Callable[..., tuple[Snapshot, Outcome]]
    """``conclude(world, moved, key, waypoints, p, scene)`` looks, judges and rewards; ``waypoints`` is their number."""
    retarget: Callable[..., tuple[Snapshot, Outcome]]
    """``retarget(world, outcome, key, waypoints, p, scene)`` sets the next waypoint, where one was reached."""


@cache
def step_of(system: System) -> Step:
    """Return the kernels of a system's step."""
    first_sense, sense = sensing(system.sensors)
    reward_of, no_shares = rewarding(system.rewards)
    around = system.surroundings

    @kernel
    def begin(pose, key, waypoints, p, scene):
        body = system.start(pose)
        senses = first_sense(body, key, p)
        course = course_after(0.0, waypoints, p.task.laps)
        world = Snapshot(body, senses, system.first_estimate(senses, p), course, 0.0, ())
        return world._replace(room=around.first_look(world, key, p, scene))

    @kernel
    def start_outcome(world):
        return Outcome(0.0, distance_to(world.body.true_state, world.course.reference), False, False, False, False, no_shares)

    @kernel
    def act(world, command, key, p):
        at = int(world.steps + 1.0)
        body = system.move(world.body, command, key, at, p)  # move: the plant obeys, with delay and slip
        senses = sense(body, world.senses, key, at, p)  # sense: odometry, and what else there is
        # believe: the filter sees the senses, never the body: true pose, slip, late commands
        estimate = world.estimate if system.reads_scan else system.estimate(world.estimate, world.senses, senses, p)
        return Snapshot(body, senses, estimate, world.course, world.steps + 1.0, world.room)

    @kernel
    def conclude(world, moved, key, waypoints, p, scene):
        room = around.look(moved, key, p, scene)  # look: beams, contact, and the way that is left
        estimate = moved.estimate
        if system.reads_scan:
            estimate = system.estimate(world.estimate, world.senses, moved.senses, p, room, scene)
        after = moved._replace(estimate=estimate, room=room)
        visited, outcome = system.judge(world, after, waypoints, p)  # judge: arrival, contact, end
        after = after._replace(course=world.course._replace(visited=visited))
        reward, shares = reward_of(world, after, outcome, p)  # reward: a sum of terms
        return after, outcome._replace(reward=reward, shares=shares)

    @kernel
    def retarget(world, outcome, key, waypoints, p, scene):
        course = course_after(world.course.visited, waypoints, p.task.laps)
        outcome = outcome._replace(distance=distance_to(world.body.true_state, course.reference))
        return around.renew(world._replace(course=course), outcome, key, p, scene)

    return Step(begin, start_outcome, act, conclude, retarget)


def step(
    system: System, before: Snapshot, command: Command, key: int, waypoints: Any, p: Parameters, scene: Any
) -> tuple[Snapshot, Outcome]:
    """Return the world a control interval after ``before``, and the outcome; the arrays of a scene change in place.

    The command is the policy's, in m/s and rad/s, and the key that of the episode's random numbers.
    """
    parts = step_of(system)
    world, outcome = parts.conclude(before, parts.act(before, command, key, p), key, len(waypoints), p, scene)
    return parts.retarget(world, outcome, key, waypoints, p, scene) if outcome.reached else (world, outcome)


def observe(system: System, world: Snapshot, p: Parameters, scene: Any) -> tuple[float, ...]:
    """Return what the policy sees at present, in double precision: the numbers of the observation's terms in turn."""
    values = iter(observing(system.terms)(world, p).values)
    return row_of(system.terms, [tuple(term.of(scene).tolist()) if term.in_scene else next(values) for term in system.terms])


class Episode:
    """One environment, episode by episode; `Outcome` reports an episode's end, and it continues until it is reset.

    The ROS simulator runs it, tests compare the compiled loop with it, and it accepts another plant::

        system = system_of(parameters)._replace(move=my_plant)
        episode = Episode(parameters, waypoints, system=system)

    Args:
        parameters: Parameters of a step.
        waypoints: The poses to visit; unused if the task draws its goal.
        seed: Seed of the noise and of the task's draws.
        system: The kernels of a step; None for those of the parameters.
        plan: The floor plan of a given room.
    """

    def __init__(
        self,
        parameters: Parameters,
        waypoints: Sequence[Pose] = (),
        *,
        seed: int = 0,
        system: System | None = None,
        plan: FloorPlan | None = None,
    ) -> None:
        self.parameters, self.seed, self.number = parameters, seed, -1
        self.system = system or system_of(parameters)
        self._given = tuple(waypoints)
        around = self.system.surroundings
        scenes = around.make([parameters])
        scene = around.at(plan.share(scenes) if plan else scenes, 0)
        self.scene: Any = plan.put(scene) if plan else scene
        self._history = History(self.system.terms, 1)
        self.reset()

    def reset(self) -> Snapshot:
        """Begin the next episode of the seed, and return the world at its start."""
        self.number += 1
        self.key = episode_key(self.seed, self.number)
        start, goal = self.system.lay_out(self.key, self.parameters, self.scene)
        self.waypoints = (goal,) if self.parameters.task.random else self._given
        self.world = step_of(self.system).begin(start, self.key, self.waypoints, self.parameters, self.scene)
        self.outcome = step_of(self.system).start_outcome(self.world)
        if self._history:
            self._history.begin(self._now(), np.ones(1, np.bool_))
        return self.world

    def step(self, command: Command) -> Outcome:
        """Advance by one control interval with the policy's command."""
        self.world, self.outcome = step(self.system, self.world, command, self.key, self.waypoints, self.parameters, self.scene)
        if self._history:
            self._history.advance(self._now())
        return self.outcome

    def act(self, action: Sequence[float]) -> Outcome:
        """Advance with an action: shares of the robot's speed and turning rate limits, clipped to [-1, 1]."""
        forward, turn = action
        return self.step(command_of(float(forward), float(turn), self.parameters.robot))

    def observe(self) -> tuple[float, ...]:
        """Return the policy's observation in double precision; on open ground the numbers of a `turtlebot_gym.Observation`."""
        now = self._now()
        self._history.show(now)
        return tuple(now[0].tolist())

    def _now(self) -> NDArray[np.float64]:
        return np.array([observe(self.system, self.world, self.parameters, self.scene)])
