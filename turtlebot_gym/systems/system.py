"""A system: the kernels of one step, and the step that is put together from them.

    move -> sense -> estimate -> judge -> look round -> observe

Looking round is for what lies around the robot in arrays, a scene: ranges and collisions. On open ground there is none.

What changes the *types* of a step (another sensor, filter or plant) is a kernel of a `System`; numbers are in `Parameters`.
The step runs as plain Python with the kernels as they are, and in a compiled loop (`turtlebot_gym.compiled`), to the same bit.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

from turtlebot_gym.kernel import kernel
from turtlebot_gym.systems.world import Course, Outcome, World
from turtlebot_gym.tasks import distance_to
from turtlebot_gym.values import Pose


class Surroundings(NamedTuple):
    """The parts of a step that work on arrays; what they keep in a scene's arrays they change there."""

    make: Callable[..., Any]
    """``make(parameters)`` returns the scenes of as many environments as there are parameters: a NamedTuple of arrays."""
    at: Callable[..., Any]
    """``at(scenes, index)`` returns the scene of one environment."""
    first_look: Callable[..., Any]
    """``first_look(world, key, p, scene)`` returns `World.room` at the start."""
    look_round: Callable[..., Any]
    """``look_round(world, outcome, key, p, scene)`` returns the world and the outcome after a step, with all that is to be said
    about what lies around."""
    ranges: Callable[..., Any]
    """``ranges(scene)`` returns an array of `seen` numbers, given to a policy between the two parts that `observe` returns:
    what comes before them, a NamedTuple, and one number after them."""
    seen: int
    """How many."""


class System(NamedTuple):
    """The parts of a step. ``p`` is `systems.parameters.Parameters`; ``key`` and ``at`` number the noise of a step."""

    lay_out: Callable[..., Any]
    """``lay_out(key, p, scene)`` returns the pose in which an episode starts, and the goal, the first waypoint where the task
    draws one."""
    start: Callable[..., Any]
    """``start(pose)`` returns the body at the start of an episode."""
    move: Callable[..., Any]
    """``move(body, command, key, at, p)`` returns the body after a control interval: action, limits, delay, plant, slip."""
    sense: Callable[..., Any]
    """``sense(body, before, key, at, p)`` returns what the sensors say, ``before`` is what they said a step before."""
    first_sense: Callable[..., Any]
    """``first_sense(body, key, p)`` returns what they say at the start."""
    first_estimate: Callable[..., Any]
    """``first_estimate(senses, p)`` returns the filter's estimate at the start."""
    estimate: Callable[..., Any]
    """``estimate(estimate, before, senses, p)`` returns it after a step."""
    judge: Callable[..., Any]
    """``judge(world, body, senses, estimate, waypoints, p)`` returns the waypoints visited and the `Outcome` of a step that led
    from ``world`` to the new body, senses and estimate; ``waypoints`` is how many the task has."""
    observe: Callable[..., Any]
    """``observe(world, p)`` returns what the policy is given, a NamedTuple of numbers."""
    layout: int
    """Version of what it is given: a policy that was trained on another one must be refused."""
    low: tuple[float, ...]
    """Least values of what it is given."""
    high: tuple[float, ...]
    """Greatest values."""
    example: Any
    """Parameters of the types that the kernels take."""
    surroundings: Surroundings | None = None
    """What lies around the robot; None on open ground, where a scene is an empty tuple."""
    compiled: bool = True
    """Whether its parts are kernels; where one is not, as a physics engine, its loop too runs as plain Python."""


class Step(NamedTuple):
    """A system's kernels, put together."""

    begin: Callable[..., World]
    """``begin(pose, key, waypoints, p, scene)`` returns the world at the start of an episode, at rest in a pose."""
    transition: Callable[..., tuple[World, Outcome]]
    """``transition(world, command, key, waypoints, p, scene)`` returns the world a control interval later, and the outcome.

    ``command`` is the twist that the policy asks for; ``waypoints`` are poses, or an array (M, 3).
    """
    observe: Callable[..., Any]
    """``observe(world, p)`` returns what the policy is given."""
    advance: Callable[..., tuple[World, Outcome]]
    """The transition but for the next waypoint, without a branch: what the compiled loop runs for all environments."""
    retarget: Callable[..., tuple[World, Outcome]]
    """``retarget(world, outcome, waypoints, p)`` sets the next waypoint: for the few environments that reached one."""
    look_round: Callable[..., tuple[World, Outcome]]
    """``look_round(world, outcome, key, p, scene)`` says what is to be said of what lies around."""


@kernel
def _course(visited: float, waypoints: Any, laps: float) -> Course:
    """Return the course after so many visited waypoints, which are visited ``laps`` times in turn; the last one stays."""
    last = len(waypoints) * laps - 1.0
    now = waypoints[int(min(visited, last)) % len(waypoints)]
    then = waypoints[int(min(visited + 1.0, last)) % len(waypoints)]
    return Course(Pose(now[0], now[1], now[2]), Pose(then[0], then[1], then[2]), visited)


@kernel
def _see_nothing(world: World, key: int, p: Any, scene: tuple[()]) -> tuple[()]:
    """Return what is known of open ground's surroundings."""
    return ()


@kernel
def _look_at_nothing(world: World, outcome: Outcome, key: int, p: Any, scene: tuple[()]) -> tuple[World, Outcome]:
    """Return a world and an outcome as they are."""
    return world, outcome


@cache
def step_of(system: System) -> Step:
    """Return the step of a system."""
    start, move, sense, judge = system.start, system.move, system.sense, system.judge
    first_sense, first_estimate, estimate_of = system.first_sense, system.first_estimate, system.estimate
    around = system.surroundings
    first_look = around.first_look if around else _see_nothing
    look_round = around.look_round if around else _look_at_nothing

    @kernel
    def begin(pose, key, waypoints, p, scene):
        body = start(pose)
        senses = first_sense(body, key, p)
        world = World(body, senses, first_estimate(senses, p), _course(0.0, waypoints, p.task.laps), 0.0, ())
        room = first_look(world, key, p, scene)
        return World(world.body, world.senses, world.estimate, world.course, world.steps, room)

    @kernel
    def advance(world, command, key, waypoints, p):
        steps = world.steps + 1.0
        at = int(steps)
        body = move(world.body, command, key, at, p)
        senses = sense(body, world.senses, key, at, p)
        estimate = estimate_of(world.estimate, world.senses, senses, p)
        visited, outcome = judge(world, body, senses, estimate, waypoints, p)
        course = Course(world.course.reference, world.course.following, visited)
        return World(body, senses, estimate, course, steps, world.room), outcome

    @kernel
    def retarget(world, outcome, waypoints, p):
        course = _course(world.course.visited, waypoints, p.task.laps)
        distance = distance_to(world.body.true_state, course.reference)
        _, _, is_success, terminated, truncated, reached = outcome
        told = Outcome(outcome.reward, distance, is_success, terminated, truncated, reached)
        return World(world.body, world.senses, world.estimate, course, world.steps, world.room), told

    def transition(world, command, key, waypoints, p, scene):
        world, outcome = advance(world, command, key, len(waypoints), p)
        world, outcome = retarget(world, outcome, waypoints, p) if outcome.reached else (world, outcome)
        return look_round(world, outcome, key, p, scene)

    return Step(begin, transition, system.observe, advance, retarget, look_round)
