"""Rewards: sums of named terms with weights, computed in one place for open ground, rooms and missions.

A term is a kernel of the worlds before and after a step. The option ``reward`` sets weights by name, and adds terms of one's
own. Distances are true ones, whatever the policy observes.
"""

from __future__ import annotations

from collections import namedtuple
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, NamedTuple

from turtlebot_gym.files import source_of
from turtlebot_gym.kernel import kernel
from turtlebot_gym.tasks import arrived, by_time, distance_to, remaining

NEAR = 0.15
"""Clearance below which the term "nearness" counts, m."""


class RewardTerm(NamedTuple):
    """A term of the reward."""

    name: str
    """Its name among the weights, and in ``info``."""
    of: Callable[..., Any]
    """``of(before, after, outcome, p)``, a kernel, returns its value in a step: it takes `systems.Snapshot` before and after,
    `systems.Outcome` without a reward, and `systems.Parameters`. A waypoint that is reached is still the one to reach in
    ``after``."""
    weight: float
    """Its weight if the option ``reward`` states no other."""

    @property
    def spelled(self) -> str:
        """How the option ``reward`` names a term of one's own: MODULE:NAME, or its name if none of its module is this term."""
        return source_of(self, self.of.__module__, "__main__") or self.name


@kernel
def _progress(before, after, outcome, p):
    """Progress along the path through the waypoints, as a share of what full speed allows in a step."""
    course, truth = before.course, after.body.true_state
    ahead = remaining(truth, course.reference, course.following, outcome.reached and not by_time(p.task))
    return (distance_to(before.body.true_state, course.reference) - ahead) / (p.robot.max_linear * p.dt)


@kernel
def _progress_in_room(before, after, outcome, p):
    """The same along the shortest path through a room."""
    return (before.room.way - after.room.way) / (p.robot.max_linear * p.dt)


@kernel
def _time(before, after, outcome, p):
    return -1.0


@kernel
def _effort(before, after, outcome, p):
    """Minus the sum of the squared speed and turning rate of the command, as shares of their limits."""
    command = after.body.command
    v, omega = command.v / p.robot.max_linear, command.omega / p.robot.max_angular
    return -(v * v + omega * omega)


@kernel
def _success(before, after, outcome, p):
    return 1.0 if outcome.is_success else 0.0


@kernel
def _collision(before, after, outcome, p):
    return -1.0 if after.room.collided else 0.0


@kernel
def _nearness(before, after, outcome, p):
    """Minus the share of `NEAR` that the clearance lacks."""
    return -max(1.0 - after.room.clearance / NEAR, 0.0) if not after.room.collided else 0.0


@kernel
def _goal(before, after, outcome, p):
    """1 when the robot is at a goal that is not the last one."""
    there = outcome.reached and not outcome.is_success and not after.room.collided
    return 1.0 if there and arrived(after.body.true_state, before.course.reference, p.task) else 0.0


NEARNESS = RewardTerm("nearness", _nearness, 0.5)
_ALWAYS = RewardTerm("time", _time, 0.1), RewardTerm("effort", _effort, 0.01), RewardTerm("success", _success, 10.0)
ON_GROUND = RewardTerm("progress", _progress, 1.0), *_ALWAYS
IN_ROOMS = RewardTerm("progress", _progress_in_room, 1.0), *_ALWAYS, RewardTerm("collision", _collision, 50.0), NEARNESS
ON_MISSIONS = *IN_ROOMS, RewardTerm("goal", _goal, 10.0)


@cache
def _shares_of(names: tuple[str, ...]) -> Any:
    """Return the type of a number for each term: of their weights, and of what each adds to the reward of a step."""
    return namedtuple("Shares", names)  # noqa: PYI024  # a type for each set of names


def default_weights(terms: Sequence[RewardTerm]) -> Any:
    """Return the terms' own weights."""
    return _shares_of(tuple(term.name for term in terms))(*(float(term.weight) for term in terms))


@cache
def rewarding(terms: tuple[RewardTerm, ...]) -> tuple[Callable[..., Any], Any]:
    """Return the kernel of a step's reward and of each term's share in it, and the shares where nothing happens."""
    parts, Shares = tuple((term.name, term.of) for term in terms), type(default_weights(terms))

    @kernel
    def reward_of(before, after, outcome, p):
        shares = tuple(getattr(p.reward, name) * of(before, after, outcome, p) for name, of in parts)
        reward = shares[0]
        for share in shares[1:]:
            reward = reward + share
        return reward, Shares(*shares)

    return reward_of, Shares(*(0.0 for _ in terms))
