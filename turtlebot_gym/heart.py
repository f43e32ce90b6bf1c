"""The loop: one step of a robot that acts on what its filter believes. Read this file first.

    act -> move -> sense -> believe -> look -> judge -> reward -> observe

`step` runs from the move to the reward; the policy acts before, and observes after it. Each part is a function of the system,
a *kernel*: open ground, rooms and filters differ in their kernels only. Plain Python runs them here, in ROS nodes too;
`turtlebot_gym.compiled` runs the same kernels for many environments, to the same bit.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.models.random import episode_key
from turtlebot_gym.models.unicycle import command_of
from turtlebot_gym.observations import History, observing, row_of
from turtlebot_gym.rewards import rewarding
from turtlebot_gym.rooms.plan import FloorPlan
from turtlebot_gym.systems.parameters import Parameters
from turtlebot_gym.systems.rooms import WithTerms, find_system
from turtlebot_gym.systems.sensors import looking, sensing
from turtlebot_gym.systems.system import System, course_after
from turtlebot_gym.systems.world import Outcome, Snapshot, outcome_of
from turtlebot_gym.tasks import StartAndGoal, distance_to, draw_goal
from turtlebot_gym.values import Command, Pose


def begin(system: System, start: Pose, key: int, waypoints: Any, p: Parameters, scene: Any) -> Snapshot:
    """Return the world at the start of an episode, at rest; the arguments are those of `step`."""
    first_sense, _ = sensing(system.sensors)
    body = system.start(start)
    senses = first_sense(body, key, p)
    estimate, course = system.first_estimate(senses, p), course_after(0.0, waypoints, p.task.laps)
    world = Snapshot(body, senses, estimate, course, 0.0, ())
    if system.surroundings:
        room = system.surroundings.first_look(world, key, p, scene)
        world = world._replace(room=room, senses=looking(system.sensors)(senses, room, p))
    return world


def begin_at(system: System, poses: StartAndGoal, key: int, p: Parameters) -> tuple[Snapshot, Pose]:
    """Return the world at the start of an episode on open ground from given poses, and the goal; what is not given is drawn."""
    start, goal = system.lay_out(key, p, ())
    if poses.start is not None:
        start, goal = poses.start, draw_goal(key, poses.start, p.task)
    goal = goal if poses.goal is None else poses.goal
    return begin(system, start, key, (goal,), p, ()), goal


def start_outcome(system: System, world: Snapshot) -> Outcome:
    """Return the outcome that stands for the start of an episode."""
    _, no_shares = rewarding(system.rewards)
    distance = distance_to(world.body.true_state, world.course.reference)
    nothing = {"is_success": False, "terminated": False, "truncated": False, "reached": False}
    return Outcome(reward=0.0, distance=distance, **nothing, shares=no_shares)


def step(
    system: System, before: Snapshot, command: Command, key: int, waypoints: Any, p: Parameters, scene: Any
) -> tuple[Snapshot, Outcome]:
    """Return the world a control interval later, and the outcome.

    Args:
        system: The kernels.
        before: The world.
        command: The policy's command; m/s, rad/s.
        key: Key of the episode's random numbers.
        waypoints: The poses to visit.
        p: Parameters.
        scene: Arrays of the surroundings, which change in place; an empty tuple on open ground.
    """
    around, at, steps = system.surroundings, int(before.steps) + 1, before.steps + 1.0
    _, sense = sensing(system.sensors)
    reward_of, _ = rewarding(system.rewards)

    body = system.move(before.body, command, key, at, p)  # move: the plant obeys, with delay and slip
    senses = sense(body, before.senses, key, at, p)  # sense: odometry, and what else there is
    estimate, room = before.estimate, before.room
    if not system.reads_scan:  # believe: the filter sees the senses, never the body: true pose, slip, late commands
        estimate = system.estimate(before.estimate, before.senses, senses, p)
    if around:  # look: beams, contact, and the way that is left
        moved = Snapshot(body, senses, estimate, before.course, steps, room)
        room = around.look(moved, key, p, scene)
        senses = looking(system.sensors)(senses, room, p)
        if system.reads_scan:
            estimate = system.estimate(before.estimate, before.senses, senses, p, room, scene)

    visited, judgement = system.judge(before, body, senses, estimate, len(waypoints), p)  # judge: arrival, end
    after = Snapshot(body, senses, estimate, before.course._replace(visited=visited), steps, room)
    if around:
        judgement = around.complete(after, judgement, p)
    reward, shares = reward_of(before, after, judgement, p)  # reward: a sum of terms

    if judgement.reached:  # the next waypoint
        course = course_after(visited, waypoints, p.task.laps)
        after = after._replace(course=course)
        judgement = judgement._replace(distance=distance_to(body.true_state, course.reference))
        if around and around.renew:
            after, judgement = around.renew(after, judgement, key, p, scene)
    return after, outcome_of(reward, judgement, shares)


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
        system: The kernels of a step, or what `find_system` takes; None for the system that belongs to the parameters.
        plan: The floor plan of a given room.
    """

    def __init__(
        self,
        parameters: Parameters,
        waypoints: Sequence[Pose] = (),
        *,
        seed: int = 0,
        system: System | str | Callable[[Parameters], System] | WithTerms | None = None,
        plan: FloorPlan | None = None,
    ) -> None:
        self.parameters, self.seed, self.number = parameters, seed, -1
        self.system = find_system(system, parameters)
        self._given = tuple(waypoints)
        around = self.system.surroundings
        scenes: Any = around.make([parameters]) if around else ()
        self.scene: Any = around.at(plan.share(scenes) if plan else scenes, 0) if around else ()
        if plan:
            self.scene = plan.put(self.scene)
        self._history = History(self.system.terms, 1)
        self.reset()

    def reset(self) -> Snapshot:
        """Begin the next episode of the seed, and return the world at its start."""
        self.number += 1
        self.key = episode_key(self.seed, self.number)
        start, goal = self.system.lay_out(self.key, self.parameters, self.scene)
        self.waypoints = (goal,) if self.parameters.task.random else self._given
        self.world = begin(self.system, start, self.key, self.waypoints, self.parameters, self.scene)
        self.outcome = start_outcome(self.system, self.world)
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
