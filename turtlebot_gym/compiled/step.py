"""The step of a system as kernels that the compiled loops call: the parts of `turtlebot_gym.heart.step`.

Its first part has no branches and runs for a whole tile of environments at once.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

from turtlebot_gym.kernel import kernel
from turtlebot_gym.rewards import rewarding
from turtlebot_gym.systems import RoomParts, System
from turtlebot_gym.systems.sensors import looking, sensing
from turtlebot_gym.systems.system import course_after
from turtlebot_gym.systems.world import Course, Judgement, Outcome, Snapshot, outcome_of
from turtlebot_gym.tasks import distance_to


class Step(NamedTuple):
    """A system's kernels, assembled."""

    begin: Callable[..., Snapshot]
    """``begin(pose, key, waypoints, p, scene)`` returns the world at the start of an episode, at rest in a pose."""
    act: Callable[..., Snapshot]
    """``act(world, command, key, p)`` moves and senses with the policy's command, and estimates unless the filter reads the
    scan, without branches: it returns what has changed until then."""
    conclude: Callable[..., tuple[Snapshot, Outcome]]
    """``conclude(world, moved, key, waypoints, p, scene)`` looks and judges: it returns the world a control interval later,
    except for the next waypoint, and the outcome. ``waypoints`` is their number."""
    retarget: Callable[..., tuple[Snapshot, Outcome]]
    """``retarget(world, outcome, key, waypoints, p, scene)`` sets the next waypoint, for the few environments that reached one;
    ``waypoints`` are poses, or an array (M, 3)."""
    start_outcome: Callable[..., Outcome]
    """``start_outcome(world)`` returns the outcome that represents the start of an episode."""


@kernel
def _goal_unchanged(world: Snapshot, judgement: Judgement, key: int, p: Any, scene: Any) -> tuple[Snapshot, Judgement]:
    return world, judgement


@kernel
def _estimate_unchanged(estimate: Any, before: Any, senses: Any, p: Any) -> Any:
    return estimate


@kernel
def _scan_unread(estimate: Any, before: Any, senses: Any, unread: Any, p: Any, room: Any, scene: Any) -> Any:
    return unread


NOWHERE = RoomParts(
    make=lambda parameters: (),
    at=kernel(lambda scenes, index: ()),
    first_look=kernel(lambda world, key, p, scene: ()),
    look=kernel(lambda world, key, p, scene: ()),
    complete=kernel(lambda world, judgement, p: judgement),
)
"""What stands for surroundings on open ground."""


@cache
def step_of(system: System) -> Step:
    """Return the step of a system in rooms."""
    start, move, judge, first_estimate = system.start, system.move, system.judge, system.first_estimate
    (first_sense, sense), look_around = sensing(system.sensors), looking(system.sensors)
    reward_of, no_shares = rewarding(system.rewards)
    around, scan_estimate = system.surroundings or NOWHERE, system.estimate
    first_look, look, complete, renew = around.first_look, around.look, around.complete, around.renew or _goal_unchanged
    estimate_of = _estimate_unchanged if system.reads_scan else system.estimate

    @kernel
    def read_scan(estimate, before, senses, unread, p, room, scene):
        return scan_estimate(estimate, before, senses, p, room, scene)

    estimate_by_scan = read_scan if system.reads_scan else _scan_unread

    @kernel
    def begin(pose, key, waypoints, p, scene):
        body = start(pose)
        senses = first_sense(body, key, p)
        world = Snapshot(body, senses, first_estimate(senses, p), course_after(0.0, waypoints, p.task.laps), 0.0, ())
        room = first_look(world, key, p, scene)
        return Snapshot(world.body, look_around(senses, room, p), world.estimate, world.course, world.steps, room)

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
        senses = look_around(moved.senses, room, p)
        estimate = estimate_by_scan(world.estimate, world.senses, senses, moved.estimate, p, room, scene)
        visited, judgement = judge(world, moved.body, senses, estimate, waypoints, p)
        course = Course(world.course.reference, world.course.following, visited)
        after = Snapshot(moved.body, senses, estimate, course, moved.steps, room)
        judgement = complete(after, judgement, p)
        reward, shares = reward_of(world, after, judgement, p)
        return after, outcome_of(reward, judgement, shares)

    @kernel
    def retarget(world, outcome, key, waypoints, p, scene):
        course = course_after(world.course.visited, waypoints, p.task.laps)
        distance = distance_to(world.body.true_state, course.reference)
        after = Snapshot(world.body, world.senses, world.estimate, course, world.steps, world.room)
        reward, _, is_success, terminated, truncated, reached, shares = outcome
        after, judgement = renew(after, Judgement(distance, is_success, terminated, truncated, reached), key, p, scene)
        return after, outcome_of(reward, judgement, shares)

    @kernel
    def start_outcome(world):
        distance = distance_to(world.body.true_state, world.course.reference)
        return Outcome(0.0, distance, False, False, False, False, no_shares)

    return Step(begin, act, conclude, retarget, start_outcome)
