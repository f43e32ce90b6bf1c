"""Results of each episode, from the record of a batch."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.drive import heading_error, position_error
from turtlebot_gym.observations import Observed
from turtlebot_gym.systems import Parameters
from turtlebot_gym.tasks import Task, arrived, believed_to_arrive
from turtlebot_gym.values import Pose, State
from turtlebot_gym_agents.evaluation.metrics import Errors
from turtlebot_gym_agents.evaluation.record import Record


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


def outcome_of(episodes: Episodes, *, by_time: bool) -> str:
    """Return how the first episode ended, in words; with several waypoints also how many were truly reached.

    Where they follow ``by_time``, as many as `Episodes.reached` counts, the last one included.
    """
    waypoints = f"{episodes.arrivals[0]} of {episodes.given[0]} waypoints, " if episodes.given[0] > 1 else ""
    if by_time:
        waypoints = f"{episodes.reached[0]} waypoints reached, "
    return waypoints + ending_of(bool(episodes.success[0]), bool(episodes.collision[0]), episodes.time[0])


def ending_of(reached: bool, collided: bool, seconds: float) -> str:
    """Return how an episode ended after a time, s, in words."""
    return f"{'success' if reached else 'collision' if collided else 'time is up'} after {seconds:.1f} s"


def measure(record: Record, p: Parameters, seed: int) -> Episodes:
    """Return the results of each episode of a record; the first one has the seed ``seed``."""
    task, n, over, rows = p.task, record.number, _Over.of(record.episode), record.columns
    truth, due, following = rows["true_state"][n:], rows["reference"][record.before], rows["reference"][n:]
    changed = (following != due).any(axis=1)  # the waypoint, after the one that was current during the step
    done_with = changed.copy()
    done_with[over.last] = True

    away = _distance(truth, due)
    inside = _at(truth, due, away, task, arrived)
    observed = _observed(rows, p)[n:]
    believed_inside = _at(observed, due, _distance(observed, due), task, believed_to_arrive)
    # The few steps at a waypoint or done with one, episode by episode, each with the number of the waypoint to which it drives.
    few = np.flatnonzero(inside | believed_inside | done_with)
    few = few[np.argsort(record.episode[few], kind="stable")]
    leg = np.cumsum(done_with[few]) - done_with[few]
    first_inside, first_seen = (few[_first(flags[few], leg)] for flags in (inside, believed_inside))
    effort = ((rows["command"][n:] / (p.robot.max_linear, p.robot.max_angular)) ** 2).sum(axis=-1)

    collided = rows["collision"][n:]
    collision, success = over.number(collided) > 0, over.number(rows["is_success"][n:]) > 0
    ended = changed | (done_with & (collision | success | (over.steps < task.max_steps))[record.episode])
    clearance = rows["clearance"][:n].copy()
    if p.room:
        np.minimum.at(clearance, record.episode, rows["clearance"][n:])

    top_speed = min(p.robot.max_linear, p.robot.max_wheel)
    sides = over.sum(_distance(following[changed], due[changed]), changed)
    straight = _distance(rows["true_state"][:n], rows["reference"][:n]) + sides
    return Episodes(
        seed=seed + np.arange(n),
        success=success,
        time=np.asarray(over.steps * p.dt, np.float64),
        ideal=(straight - task.radius) / top_speed,
        path=over.sum(_distance(truth, rows["true_state"][record.before])),
        effort=over.mean(effort),
        reached=over.number(first_inside),
        given=over.number(ended),
        arrivals=over.number(ended & inside & ~collided),
        false_arrivals=over.number(ended & believed_inside & ~inside),
        miss=over.mean(away[done_with], done_with),
        false_arrival=over.number(first_seen[~inside[first_seen]]) > 0,
        arrival_distance=over.mean(away[first_seen], first_seen),
        collision=collision,
        clearance=clearance,
        shortest=rows["way_left"][:n] - task.radius,
        estimate=over.errors(rows["estimate"][n:], truth),
        odometry=over.errors(rows["odometry"][n:], truth),
        astray=over.mean(_distance(observed, truth) > ASTRAY),
    )


class _Over(NamedTuple):
    """Statistics over the steps of each of n episodes; sums are added up in the order of time."""

    episode: NDArray[np.intp]
    """Number of each step's episode, shape (S,)."""
    steps: NDArray[np.intp]
    """Number of steps of each, shape (n,)."""
    last: NDArray[np.intp]
    """The last step of each, shape (n,)."""

    @classmethod
    def of(cls, episode: NDArray[np.intp]) -> _Over:
        steps = np.bincount(episode)
        last = np.empty_like(steps)
        last[episode] = np.arange(len(episode))  # later ones replace earlier ones
        return cls(episode, steps, last)

    def sum(self, values: NDArray[Any], which: Any = slice(None)) -> NDArray[np.float64]:
        """Return the sums of the values of some steps, by default of all."""
        return np.asarray(np.bincount(self.episode[which], values, minlength=self.steps.size), np.float64)

    def number(self, which: NDArray[Any]) -> NDArray[np.intp]:
        """Return the numbers of some steps."""
        return np.bincount(self.episode[which], minlength=self.steps.size)

    def mean(self, values: NDArray[Any], which: Any = slice(None)) -> NDArray[np.float64]:
        """Return the means of the values of some steps; NaN for an episode without such a step."""
        number = self.number(which)
        return np.where(number > 0, self.sum(values, which) / np.maximum(number, 1), np.nan)

    def errors(self, poses: NDArray[np.float64], truth: NDArray[np.float64]) -> Errors:
        """Return mean, largest and final errors, as `metrics.errors` of each episode does."""
        numbers: list[NDArray[np.float64]] = []
        for error in (position_error(poses, truth), heading_error(poses, truth)):
            largest = np.zeros(self.steps.size)
            np.maximum.at(largest, self.episode, error)
            numbers += [self.mean(error), largest, error[self.last]]
        return Errors(*numbers)


def _observed(rows: Mapping[str, NDArray[Any]], p: Parameters) -> NDArray[np.float64]:
    """Return the states that the policy observes, shape (n + S, 5)."""
    if p.observed == Observed.TRUTH:
        return rows["true_state"]
    if p.observed == Observed.ODOMETRY:
        return np.concatenate([rows["odometry"], rows["command"]], axis=-1)
    return rows["estimate"]


def _at(
    states: NDArray[np.float64],
    due: NDArray[np.float64],
    away: NDArray[np.float64],
    task: Task,
    rule: Callable[[State, Pose, Task], bool],
) -> NDArray[np.bool_]:
    """Return which states, at some distances from the waypoints, satisfy a rule of the task, shape (S,)."""
    near = np.flatnonzero(away <= task.radius)  # only few are near enough to check
    at = np.zeros(len(states), np.bool_)
    pairs = zip(states[near].tolist(), due[near].tolist(), strict=True)
    at[near] = [rule(State(*state), Pose(*pose), task) for state, pose in pairs]
    return at


def _distance(states: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.hypot(states[..., 0] - points[..., 0], states[..., 1] - points[..., 1])


def _first(flags: NDArray[np.bool_], leg: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return the indices of the first flag of each leg, whose numbers ascend."""
    at = np.flatnonzero(flags)
    return at[np.diff(leg[at], prepend=-1) > 0]
