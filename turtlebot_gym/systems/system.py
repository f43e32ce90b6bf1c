"""A system: the kernels of one step, and the step assembled from them.

    move -> sense -> estimate -> judge -> look -> complete -> observe

"Look" works on the surroundings in arrays, a scene: ranges and collisions. Open ground has none. A filter that reads the scan
estimates after the robot has looked:

    move -> sense -> look -> estimate -> judge -> complete -> observe

The first order is the fast one: all before "look" runs without branches for a whole tile of environments.

What changes the *types* of a step (another sensor, filter or plant) is a kernel of a `System`; numbers are in `Parameters`.
The step runs with the same kernels as plain Python and in a compiled loop (`turtlebot_gym.compiled`), bit-identically.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

from turtlebot_gym.kernel import kernel
from turtlebot_gym.systems.sensors import Sensor, sensing
from turtlebot_gym.systems.world import Course, Outcome, Snapshot
from turtlebot_gym.tasks import distance_to
from turtlebot_gym.values import Pose


class Surroundings(NamedTuple):
    """The parts of a step that work on arrays; they update a scene's arrays in place."""

    make: Callable[..., Any]
    """``make(parameters)`` returns the scenes of as many environments as there are parameters: a NamedTuple of arrays."""
    at: Callable[..., Any]
    """``at(scenes, index)`` returns the scene of one environment."""
    first_look: Callable[..., Any]
    """``first_look(world, key, p, scene)`` returns `Snapshot.room` at the start."""
    look: Callable[..., Any]
    """``look(world, key, p, scene)`` moves what moves in the scene, measures ranges, and returns the new `Snapshot.room`."""
    complete: Callable[..., Any]
    """``complete(world, room, outcome, p)`` returns the outcome of a step, completed by what `look` has found."""
    ranges: Callable[..., Any]
    """``ranges(scene)`` returns an array of `seen` numbers, which the observation holds between the two parts that `observe`
    returns: NamedTuples before them and one number after them."""
    seen: int
    """Number of ranges."""
    renew: Callable[..., Any] | None = None
    """``renew(world, outcome, key, p, scene)`` ends a step: it returns world and outcome, with the next goal where one was
    reached; None if an episode has one goal."""


class System(NamedTuple):
    """The parts of a step. ``p`` is `systems.parameters.Parameters`; ``key`` and ``at`` number the noise of a step."""

    lay_out: Callable[..., Any]
    """``lay_out(key, p, scene)`` returns the start pose of an episode, and the goal, which is the first waypoint if the task
    draws one."""
    start: Callable[..., Any]
    """``start(pose)`` returns the body at the start of an episode."""
    move: Callable[..., Any]
    """``move(body, command, key, at, p)`` returns the body after a control interval: action, limits, delay, plant, slip."""
    sensors: tuple[Sensor, ...]
    """The robot's sensors; their values are the senses, a NamedTuple with a field for each."""
    first_estimate: Callable[..., Any]
    """``first_estimate(senses, p)`` returns the filter's estimate at the start."""
    estimate: Callable[..., Any]
    """``estimate(estimate, before, senses, p)`` returns the filter's estimate after a step; with `reads_scan`,
    ``estimate(estimate, before, senses, p, room, scene)``."""
    judge: Callable[..., Any]
    """``judge(world, body, senses, estimate, waypoints, p)`` returns the waypoints visited and the `Outcome` of a step that led
    from ``world`` to the new body, senses and estimate; ``waypoints`` is their number."""
    observe: Callable[..., Any]
    """``observe(world, p)`` returns the observation, a NamedTuple of numbers."""
    layout: int
    """Version of the observation: a policy trained on another one must be refused."""
    low: tuple[float, ...]
    """Lower bounds of the observation."""
    high: tuple[float, ...]
    """Upper bounds."""
    example: Any
    """Example parameters with the types that the kernels take."""
    surroundings: Surroundings | None = None
    """Surroundings of the robot; None on open ground, where a scene is an empty tuple."""
    reads_scan: bool = False
    """Whether the filter reads the scan, and estimates after the robot has looked."""
    compiled: bool = True
    """Whether all parts are kernels; if one is not, such as a physics engine, the loop runs as plain Python too."""

    def with_sensor(self, sensor: Sensor) -> System:
        """Return the system with a further sensor, or another of its name."""
        others = tuple(other for other in self.sensors if other.name != sensor.name)
        at = [other.name for other in self.sensors].index(sensor.name) if len(others) < len(self.sensors) else len(others)
        example = self.example if sensor.noise is None else self.example._replace(**{sensor.name: sensor.noise})
        return self._replace(sensors=(*others[:at], sensor, *others[at:]), example=example)


class Step(NamedTuple):
    """A system's kernels, assembled."""

    begin: Callable[..., Snapshot]
    """``begin(pose, key, waypoints, p, scene)`` returns the world at the start of an episode, at rest in a pose."""
    transition: Callable[..., tuple[Snapshot, Outcome]]
    """``transition(world, command, key, waypoints, p, scene)`` returns the world a control interval later, and the outcome.

    ``command`` is the policy's command; ``waypoints`` are poses, or an array (M, 3).
    """
    observe: Callable[..., Any]
    """``observe(world, p)`` returns the observation."""
    advance: Callable[..., tuple[Snapshot, Outcome]]
    """The transition up to looking, without the next waypoint and without branches, which the compiled loop runs for all
    environments; not for filters that read the scan, for which it runs the transition."""
    retarget: Callable[..., tuple[Snapshot, Outcome]]
    """``retarget(world, outcome, waypoints, p)`` sets the next waypoint, for the few environments that reached one."""
    look_round: Callable[..., tuple[Snapshot, Outcome]]
    """``look_round(world, outcome, key, p, scene)`` looks, and completes world and outcome."""
    act: Callable[..., Snapshot]
    """``act(world, command, key, p)`` moves and senses: the first part of a transition with a filter that reads the scan,
    without branches. The belief is that before the step."""
    conclude_by_scan: Callable[..., tuple[Snapshot, Outcome]]
    """``conclude_by_scan(world, moved, key, waypoints, p, scene)`` is its rest, from ``moved`` on: look, estimate, judge."""


@kernel
def _course(visited: float, waypoints: Any, laps: float) -> Course:
    """Return the course after so many waypoints and rounds; the last waypoint stays."""
    last = len(waypoints) * laps - 1.0
    now = waypoints[int(min(visited, last)) % len(waypoints)]
    then = waypoints[int(min(visited + 1.0, last)) % len(waypoints)]
    return Course(Pose(now[0], now[1], now[2]), Pose(then[0], then[1], then[2]), visited)


@kernel
def _see_nothing(world: Snapshot, key: int, p: Any, scene: tuple[()]) -> tuple[()]:
    return ()


@kernel
def _leave(world: Snapshot, room: tuple[()], outcome: Outcome, p: Any) -> Outcome:
    return outcome


@kernel
def _keep(world: Snapshot, outcome: Outcome, key: int, p: Any, scene: Any) -> tuple[Snapshot, Outcome]:
    return world, outcome


@cache
def step_of(system: System) -> Step:
    """Return the step of a system.

    Raises:
        ValueError: If its filter reads a scan and there is none.
    """
    start, move, judge = system.start, system.move, system.judge
    first_estimate, estimate_of = system.first_estimate, system.estimate
    first_sense, sense = sensing(system.sensors)
    around = system.surroundings
    if system.reads_scan and not around:
        raise ValueError("System.reads_scan must be false without surroundings: there is no scan.")
    first_look, look, complete = (
        (around.first_look, around.look, around.complete) if around else (_see_nothing, _see_nothing, _leave)
    )
    renew = around.renew if around and around.renew else _keep

    @kernel
    def begin(pose, key, waypoints, p, scene):
        body = start(pose)
        senses = first_sense(body, key, p)
        world = Snapshot(body, senses, first_estimate(senses, p), _course(0.0, waypoints, p.task.laps), 0.0, ())
        room = first_look(world, key, p, scene)
        return Snapshot(world.body, world.senses, world.estimate, world.course, world.steps, room)

    @kernel
    def act(world, command, key, p):
        at = int(world.steps + 1.0)
        body = move(world.body, command, key, at, p)
        return body, sense(body, world.senses, key, at, p)

    @kernel
    def conclude(world, body, senses, estimate, waypoints, p):
        visited, outcome = judge(world, body, senses, estimate, waypoints, p)
        course = Course(world.course.reference, world.course.following, visited)
        return Snapshot(body, senses, estimate, course, world.steps + 1.0, world.room), outcome

    @kernel
    def advance(world, command, key, waypoints, p):
        body, senses = act(world, command, key, p)
        return conclude(world, body, senses, estimate_of(world.estimate, world.senses, senses, p), waypoints, p)

    @kernel
    def retarget(world, outcome, waypoints, p):
        course = _course(world.course.visited, waypoints, p.task.laps)
        distance = distance_to(world.body.true_state, course.reference)
        _, _, is_success, terminated, truncated, reached = outcome
        renewed = Outcome(outcome.reward, distance, is_success, terminated, truncated, reached)
        return Snapshot(world.body, world.senses, world.estimate, course, world.steps, world.room), renewed

    @kernel
    def completed(world, room, outcome, key, p, scene):
        outcome = complete(world, room, outcome, p)
        world = Snapshot(world.body, world.senses, world.estimate, world.course, world.steps, room)
        return renew(world, outcome, key, p, scene)

    @kernel
    def look_round(world, outcome, key, p, scene):
        return completed(world, look(world, key, p, scene), outcome, key, p, scene)

    @kernel
    def transition(world, command, key, waypoints, p, scene):
        world, outcome = advance(world, command, key, len(waypoints), p)
        world, outcome = retarget(world, outcome, waypoints, p) if outcome.reached else (world, outcome)
        return look_round(world, outcome, key, p, scene)

    @kernel
    def act_alone(world, command, key, p):
        body, senses = act(world, command, key, p)
        return Snapshot(body, senses, world.estimate, world.course, world.steps + 1.0, world.room)

    @kernel
    def conclude_by_scan(world, moved, key, waypoints, p, scene):
        body, senses, room = moved.body, moved.senses, look(moved, key, p, scene)
        estimate = estimate_of(world.estimate, world.senses, senses, p, room, scene)
        world, outcome = conclude(world, body, senses, estimate, len(waypoints), p)
        world, outcome = retarget(world, outcome, waypoints, p) if outcome.reached else (world, outcome)
        return completed(world, room, outcome, key, p, scene)

    @kernel
    def transition_by_scan(world, command, key, waypoints, p, scene):
        return conclude_by_scan(world, act_alone(world, command, key, p), key, waypoints, p, scene)

    chosen = transition_by_scan if system.reads_scan else transition
    return Step(begin, chosen, system.observe, advance, retarget, look_round, act_alone, conclude_by_scan)
