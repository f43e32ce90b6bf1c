"""A system: the kernels of one step, and the step assembled from them.

    move -> sense -> estimate -> look -> judge -> complete -> reward -> renew -> observe

"Look" works on the surroundings in arrays, a scene: ranges and collisions. Open ground has none, and its step runs without
branches for a whole tile of environments; in rooms what follows "estimate" runs one by one. A filter that reads the scan
estimates after the robot has looked.

What changes the *types* of a step (another sensor, filter or plant) is a kernel of a `System`; numbers are in `Parameters`.
The step runs with the same kernels as plain Python and in a compiled loop (`turtlebot_gym.compiled`), bit-identically.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

from turtlebot_gym.kernel import kernel
from turtlebot_gym.rewards import RewardTerm, rewarding, shares_of
from turtlebot_gym.systems.sensors import Sensor, sensing
from turtlebot_gym.systems.world import Course, Judgement, Outcome, Snapshot
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
    """``complete(world, judgement, p)`` returns the judgement of a step, completed by what `look` has found."""
    ranges: Callable[..., Any]
    """``ranges(scene)`` returns an array of `seen` numbers, which the observation holds between the two parts that `observe`
    returns: NamedTuples before them and one number after them."""
    seen: int
    """Number of ranges."""
    renew: Callable[..., Any] | None = None
    """``renew(world, judgement, key, p, scene)`` ends a step in which a goal was reached: it returns world and judgement with
    the next goal; None if an episode has one goal."""


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
    """``judge(world, body, senses, estimate, waypoints, p)`` returns the waypoints visited and the `Judgement` of a step that
    led from ``world`` to the new body, senses and estimate; ``waypoints`` is their number."""
    rewards: tuple[RewardTerm, ...]
    """The terms of the reward; their weights are `Parameters.reward`."""
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

    def with_rewards(self, *terms: RewardTerm) -> System:
        """Return the system with further terms of the reward.

        Raises:
            ValueError: If it has a term of that name.
        """
        names = [term.name for term in (*self.rewards, *terms)]
        for at, name in enumerate(names):
            if name in names[:at]:
                raise ValueError(f"the reward has a term {name!r} already: give yours another name.")
        weights = shares_of(tuple(names))(*self.example.reward, *(term.weight for term in terms))
        return self._replace(rewards=(*self.rewards, *terms), example=self.example._replace(reward=weights))


class Step(NamedTuple):
    """A system's kernels, assembled."""

    begin: Callable[..., Snapshot]
    """``begin(pose, key, waypoints, p, scene)`` returns the world at the start of an episode, at rest in a pose."""
    act: Callable[..., Snapshot]
    """``act(world, command, key, p)`` moves and senses with the policy's command, and estimates unless the filter reads the
    scan, without branches: it returns what has changed until then."""
    conclude: Callable[..., tuple[Snapshot, Outcome]]
    """``conclude(world, moved, key, waypoints, p, scene)`` looks and judges: it returns the world a control interval later,
    except for the next waypoint, and the outcome. On open ground it has no branches. ``waypoints`` is their number."""
    retarget: Callable[..., tuple[Snapshot, Outcome]]
    """``retarget(world, outcome, key, waypoints, p, scene)`` sets the next waypoint, for the few environments that reached one;
    ``waypoints`` are poses, or an array (M, 3)."""
    transition: Callable[..., tuple[Snapshot, Outcome]]
    """``transition(world, command, key, waypoints, p, scene)`` is all of these."""
    observe: Callable[..., Any]
    """``observe(world, p)`` returns the observation."""
    start_outcome: Callable[..., Outcome]
    """``start_outcome(world)`` returns the outcome that represents the start of an episode."""


@kernel
def _course(visited: float, waypoints: Any, laps: float) -> Course:
    """Return the course after so many waypoints and rounds; the last waypoint stays."""
    last = len(waypoints) * laps - 1.0
    now = waypoints[int(min(visited, last)) % len(waypoints)]
    then = waypoints[int(min(visited + 1.0, last)) % len(waypoints)]
    return Course(Pose(now[0], now[1], now[2]), Pose(then[0], then[1], then[2]), visited)


@kernel
def _no_look(world: Snapshot, key: int, p: Any, scene: tuple[()]) -> tuple[()]:
    return ()


@kernel
def _judgement_unchanged(world: Snapshot, judgement: Judgement, p: Any) -> Judgement:
    return judgement


@kernel
def _goal_unchanged(world: Snapshot, judgement: Judgement, key: int, p: Any, scene: Any) -> tuple[Snapshot, Judgement]:
    return world, judgement


@kernel
def _estimate_unchanged(estimate: Any, before: Any, senses: Any, p: Any) -> Any:
    return estimate


@kernel
def _scan_unread(estimate: Any, before: Any, moved: Snapshot, p: Any, room: Any, scene: Any) -> Any:
    return moved.estimate


@cache
def step_of(system: System) -> Step:
    """Return the step of a system.

    Raises:
        ValueError: If its filter reads a scan and there is none.
    """
    start, move, judge, first_estimate = system.start, system.move, system.judge, system.first_estimate
    first_sense, sense = sensing(system.sensors)
    reward_of, no_shares = rewarding(system.rewards)
    around, scan_estimate = system.surroundings, system.estimate
    if system.reads_scan and not around:
        raise ValueError("System.reads_scan must be false without surroundings: there is no scan.")
    first_look, look, complete = (
        (around.first_look, around.look, around.complete) if around else (_no_look, _no_look, _judgement_unchanged)
    )
    renew = around.renew if around and around.renew else _goal_unchanged
    estimate_of = _estimate_unchanged if system.reads_scan else system.estimate

    @kernel
    def read_scan(estimate, before, moved, p, room, scene):
        return scan_estimate(estimate, before, moved.senses, p, room, scene)

    estimate_by_scan = read_scan if system.reads_scan else _scan_unread

    @kernel
    def outcome_of(reward, judgement, shares):
        distance, is_success, terminated, truncated, reached = judgement
        return Outcome(reward, distance, is_success, terminated, truncated, reached, shares)

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
        senses = sense(body, world.senses, key, at, p)
        estimate = estimate_of(world.estimate, world.senses, senses, p)
        return Snapshot(body, senses, estimate, world.course, world.steps + 1.0, world.room)

    @kernel
    def conclude(world, moved, key, waypoints, p, scene):
        room = look(moved, key, p, scene)
        estimate = estimate_by_scan(world.estimate, world.senses, moved, p, room, scene)
        visited, judgement = judge(world, moved.body, moved.senses, estimate, waypoints, p)
        course = Course(world.course.reference, world.course.following, visited)
        after = Snapshot(moved.body, moved.senses, estimate, course, moved.steps, room)
        judgement = complete(after, judgement, p)
        reward, shares = reward_of(world, after, judgement, p)
        return after, outcome_of(reward, judgement, shares)

    @kernel
    def retarget(world, outcome, key, waypoints, p, scene):
        course = _course(world.course.visited, waypoints, p.task.laps)
        distance = distance_to(world.body.true_state, course.reference)
        after = Snapshot(world.body, world.senses, world.estimate, course, world.steps, world.room)
        reward, _, is_success, terminated, truncated, reached, shares = outcome
        after, judgement = renew(after, Judgement(distance, is_success, terminated, truncated, reached), key, p, scene)
        return after, outcome_of(reward, judgement, shares)

    @kernel
    def transition(world, command, key, waypoints, p, scene):
        moved = act(world, command, key, p)
        after, outcome = conclude(world, moved, key, len(waypoints), p, scene)
        return retarget(after, outcome, key, waypoints, p, scene) if outcome.reached else (after, outcome)

    @kernel
    def start_outcome(world):
        distance = distance_to(world.body.true_state, world.course.reference)
        return Outcome(0.0, distance, False, False, False, False, no_shares)

    return Step(begin, act, conclude, retarget, transition, system.observe, start_outcome)
