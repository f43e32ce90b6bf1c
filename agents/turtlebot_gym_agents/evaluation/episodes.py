"""Results of each episode, from the record of a batch."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.drive import Drive
from turtlebot_gym.observations import Observed
from turtlebot_gym.systems import Parameters
from turtlebot_gym.tasks import Task, arrived, believed_to_arrive
from turtlebot_gym.values import Pose, State
from turtlebot_gym_agents.evaluation.metrics import Errors, errors


class Record(NamedTuple):
    """Record of n environments at the start and after each of T steps; shapes (T + 1, n, ...)."""

    true_state: NDArray[np.float64]
    odometry: NDArray[np.float64]
    estimate: NDArray[np.float64]
    reference: NDArray[np.float64]
    command: NDArray[np.float64]
    is_success: NDArray[np.bool_]
    collision: NDArray[np.bool_]
    """False on open ground."""
    clearance: NDArray[np.float64]
    """NaN on open ground, like the next field."""
    way_left: NDArray[np.float64]
    running: NDArray[np.bool_]
    """Whether the step belongs to the first episode of its environment."""
    covariance: NDArray[np.float64]
    """Covariance of the first environment only, shape (T + 1, 5, 5)."""

    def trajectory(self, *, dt: float) -> Drive:
        """Return the first environment's episode."""
        rows = np.flatnonzero(self.running[:, 0])
        names = ("true_state", "odometry", "estimate", "reference", "command", "clearance")
        drive = {name: getattr(self, name)[rows, 0] for name in names}
        return Drive(time=np.asarray(rows * dt, np.float64), covariance=self.covariance[rows], **drive)


class Episodes(NamedTuple):
    """Results of each episode; all of shape (n,)."""

    seed: NDArray[np.int64]
    success: NDArray[np.bool_]
    """Success as reported by the environment; by the true pose."""
    time: NDArray[np.float64]
    """Length of the episode, s."""
    ideal: NDArray[np.float64]
    """Time at full speed in straight lines to the edge of the last waypoint, s."""
    path: NDArray[np.float64]
    """Length of the true path, m."""
    effort: NDArray[np.float64]
    """Squared speed and turning rate as shares of their limits, summed; mean over the steps."""
    reached: NDArray[np.int64]
    """Number of waypoints that the true pose reached while they were current."""
    given: NDArray[np.int64]
    """Number of waypoints that were completed or given up, or on the way to which the robot collided."""
    arrivals: NDArray[np.int64]
    """Number of those at whose completion the true pose was there ..."""
    false_arrivals: NDArray[np.int64]
    """... and of those at whose completion it was not, although the policy's pose was."""
    miss: NDArray[np.float64]
    """True distance to a waypoint at its completion; mean over waypoints, m."""
    false_arrival: NDArray[np.bool_]
    """Whether the first belief of having arrived at some waypoint was false."""
    arrival_distance: NDArray[np.float64]
    """True distance to a waypoint at the first belief of arrival; mean, m."""
    collision: NDArray[np.bool_]
    """Whether the episode ended in a collision."""
    clearance: NDArray[np.float64]
    """Least distance from the footprint to the surroundings, m; like the next field, NaN on open ground."""
    shortest: NDArray[np.float64]
    """Length of the shortest path to where the goal counts as reached, m."""
    estimate: Errors
    """Errors of the filter's estimate over the steps."""
    odometry: Errors
    """Errors of the measured odometry over the steps."""
    astray: NDArray[np.float64]
    """Share of the steps in which the pose that the policy observed was farther than `ASTRAY` from the truth."""


ASTRAY = 0.5
"""Error of the position above which a robot counts as lost, m."""


def concatenate(parts: Sequence[Episodes]) -> Episodes:
    """Return the episodes of several batches, one after the other."""

    def joined(rows: Sequence[tuple[Any, ...]]) -> Iterator[Any]:
        for column in zip(*rows, strict=True):
            yield Errors(*joined(column)) if isinstance(column[0], Errors) else np.concatenate(column)

    return Episodes(*joined(parts))


def outcome_of(episodes: Episodes, at: int = 0) -> str:
    """Return how an episode ended, in words; with several waypoints also how many were truly reached."""
    reached, collided, given = bool(episodes.success[at]), bool(episodes.collision[at]), int(episodes.given[at])
    waypoints = f"{episodes.arrivals[at]} of {given} waypoints, " if given > 1 else ""
    return waypoints + ending_of(reached, collided, episodes.time[at])


def ending_of(reached: bool, collided: bool, seconds: float) -> str:
    """Return how an episode ended after a time, s, in words."""
    return f"{'success' if reached else 'collision' if collided else 'time is up'} after {seconds:.1f} s"


def measure(record: Record, p: Parameters, seed: int) -> Episodes:
    """Return the results of each episode.

    Args:
        record: T steps of n environments.
        p: The environments' parameters.
        seed: Seed of the first episode.
    """
    running, task = record.running[1:], p.task
    truth, due = record.true_state[1:], record.reference[:-1]  # the waypoint that was current during the step
    steps = running.sum(axis=0)
    changed = (record.reference[1:] != due).any(axis=2) & running
    done_with = changed | (np.arange(len(running))[:, None] == steps - 1)
    # Number of the waypoint to which each step drives.
    leg = np.cumsum(done_with, axis=0) - done_with

    away = _distance(truth, due)
    inside = _at(truth, due, running, task, arrived)
    observed = _observed(record, p)
    believed_inside = _at(observed, due, running, task, believed_to_arrive)
    legs = [leg == number for number in range(int(leg.max()) + 1)]
    first_seen = np.any([_first(believed_inside & leg) for leg in legs], axis=0)
    effort = ((record.command[1:] / (p.robot.max_linear, p.robot.max_angular)) ** 2).sum(axis=-1)
    sides = _distance(record.reference[1:], due)

    collision = np.any(record.collision[1:] & running, axis=0)
    success = np.any(record.is_success[1:] & running, axis=0)
    ended = changed | (done_with & (collision | success | (steps < task.max_steps)))

    top_speed = min(p.robot.max_linear, p.robot.max_wheel)
    straight = _distance(record.true_state[0], record.reference[0]) + np.sum(sides, axis=0, where=changed)
    return Episodes(
        seed=seed + np.arange(steps.size),
        success=success,
        time=steps * p.dt,
        ideal=(straight - task.radius) / top_speed,
        path=np.sum(_distance(truth, record.true_state[:-1]), axis=0, where=running),
        effort=_mean(effort, running),
        reached=np.sum([(inside & leg).any(axis=0) for leg in legs], axis=0),
        given=ended.sum(axis=0),
        arrivals=(ended & inside & ~record.collision[1:]).sum(axis=0),
        false_arrivals=(ended & believed_inside & ~inside).sum(axis=0),
        miss=_mean(away, done_with),
        false_arrival=np.any(first_seen & ~inside, axis=0),
        arrival_distance=_mean(away, first_seen),
        collision=collision,
        clearance=np.min(record.clearance, axis=0, where=record.running, initial=np.inf),
        shortest=record.way_left[0] - task.radius,
        estimate=_errors(record.estimate[1:], truth, running),
        odometry=_errors(record.odometry[1:], truth, running),
        astray=_mean(_distance(observed, truth) > ASTRAY, running),
    )


def _observed(record: Record, p: Parameters) -> NDArray[np.float64]:
    """Return the states that the policy observed after each step, shape (T, n, 5)."""
    if p.observed == Observed.TRUTH:
        return record.true_state[1:]
    if p.observed == Observed.ODOMETRY:
        return np.concatenate([record.odometry, record.command], axis=-1)[1:]
    return record.estimate[1:]


def _at(
    states: NDArray[np.float64],
    due: NDArray[np.float64],
    running: NDArray[np.bool_],
    task: Task,
    rule: Callable[[State, Pose, Task], bool],
) -> NDArray[np.bool_]:
    """Return which states satisfy a rule of the task, shape (T, n)."""
    at = running & (_distance(states, due) <= task.radius)  # only few are near enough to check
    for step, row in np.argwhere(at):
        at[step, row] = rule(State(*states[step, row].tolist()), Pose(*due[step, row].tolist()), task)
    return at


def _distance(states: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.hypot(states[..., 0] - points[..., 0], states[..., 1] - points[..., 1])


def _first(flags: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return flags (T, n), keeping only the first in time."""
    return flags & (np.cumsum(flags, axis=0) == 1)


def _mean(values: NDArray[np.float64] | NDArray[np.bool_], where: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the mean over time of the values (T, n) whose flag is set; NaN if no flag is."""
    count = where.sum(axis=0)
    return np.where(count > 0, np.sum(values, axis=0, where=where) / np.maximum(count, 1), np.nan)


def _errors(poses: NDArray[np.float64], truth: NDArray[np.float64], running: NDArray[np.bool_]) -> Errors:
    return errors(np.where(running[..., None], poses, np.nan), truth)
