"""Absolute fixes for any filter: a pose measured from outside is put in at its stamp, however late it comes.

A filter that treated a late fix as current would pull the belief back to where the robot was. This one keeps the inputs of the
last steps and its estimate from before them. It inserts a fix into the step to which it belongs, and replays the inputs since
then. The result is bit-identical to that of a fix in time.

References:
    Bar-Shalom, "Update with out-of-sequence measurements in tracking: exact solution", *IEEE Transactions on Aerospace and
    Electronic Systems* 38 (2002), for the problem; over so short a history telling all again is exact, and simple.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

from turtlebot_gym.estimation.interface import Filter
from turtlebot_gym.kernel import kernel
from turtlebot_gym.parameters import MAX_FIX_AGE
from turtlebot_gym.values import Belief, Command, Fix, Pose, Senses


class FixedSenses(NamedTuple):
    """What the robot's odometry says, and a fix where one has come."""

    odometry: Pose
    twist: Command
    measured: bool
    fix: Fix


class Told(NamedTuple):
    """What a filter was told in a step."""

    senses: Senses
    fix: Fix
    """The one that was measured at the end of the step, whenever it came."""
    dt: float
    """The step's length, s."""


class Remembered(NamedTuple):
    """All that the filter remembers from step to step."""

    belief: Belief
    nis: float
    """Normalized innovation squared of the odometry's last measurement."""
    newest: Any
    """The filter's own estimate."""
    oldest: Any
    """The one from before what is remembered, and before that step's own fix."""
    told: tuple[Told, ...]
    """What was told in the last steps, the newest first."""
    steps: float
    """Steps from the oldest estimate to the newest."""


def depth_of(dt: float, age: float = MAX_FIX_AGE) -> int:
    """Return the number of steps of dt, s, that are to be remembered for fixes of an age, s."""
    return max(1, round(age / dt))


@kernel
def no_fix() -> Fix:
    """Return what stands where there is no fix."""
    return Fix(Pose(0.0, 0.0, 0.0), (1.0, 1.0, 1.0), 0.0, False)


@kernel
def _with_fix(told: Told, fix: Fix, here: bool) -> Told:
    return Told(told.senses, fix if here else told.fix, told.dt)


def filled(count: int) -> Callable[[Any], Any]:
    """Return the kernel that makes a tuple of so many times the same."""
    if count == 1:
        return kernel(lambda value: (value,))
    rest = filled(count - 1)
    return kernel(lambda value: (value,) + rest(value))  # noqa: RUF005  # compiled code knows no stars


def _put(count: int) -> Callable[[Any, int, Fix], Any]:
    """Return the kernel that puts a fix into one of so many steps."""
    if count == 1:
        return kernel(lambda told, at, fix: (_with_fix(told[0], fix, at == 0),))
    rest = _put(count - 1)
    return kernel(lambda told, at, fix: (_with_fix(told[0], fix, at == 0),) + rest(told[1:], at - 1, fix))  # noqa: RUF005


@kernel
def _step_at(told: Any, count: float, age: float) -> int:
    """Return how many steps ago was what is so old, s: the nearest step's end; -1 where that is no longer remembered."""
    nearest, off, passed = 0, abs(age), 0.0
    for steps in range(int(count)):
        passed += told[steps].dt
        is_nearer = abs(age - passed) < off
        nearest = steps + 1 if is_nearer else nearest
        off = abs(age - passed) if is_nearer else off
    return nearest if off <= 0.5 * told[0].dt + 1e-9 else -1


@cache
def with_fixes(filter: Filter, depth: int) -> Filter:
    """Return a filter that takes fixes besides, in the senses that it is told; see `FixedSenses`.

    Args:
        filter: Any.
        depth: How many steps are remembered.
    """
    begin, step, fix_in = filter
    fill, put, last = filled(depth + 1), _put(depth + 1), depth

    @kernel
    def fixed(estimate, told):
        return fix_in(estimate, told.fix.pose, told.fix.R) if told.fix.arrived else estimate

    @kernel
    def advance(estimate, before, now, tuning, middle):
        return step(fixed(estimate, before), before.senses, now.senses, tuning, now.dt, middle)

    @kernel
    def start(odometry, tuning):
        first = begin(odometry, tuning)
        told = Told(Senses(odometry, Command(0.0, 0.0), True), no_fix(), 0.0)
        return Remembered(first.belief, first.nis, first, first, fill(told), 0.0)

    @kernel
    def step_on(estimate, before, senses, tuning, dt, middle):
        plain = Senses(senses.odometry, senses.twist, senses.measured)
        oldest, old = estimate.oldest, estimate.told
        if estimate.steps >= last:
            oldest = advance(oldest, old[last], old[last - 1], tuning, middle)
        count = min(estimate.steps + 1.0, 1.0 * last)
        told = (Told(plain, no_fix(), dt),) + old[:-1]  # noqa: RUF005
        newest = step(estimate.newest, Senses(before.odometry, before.twist, before.measured), plain, tuning, dt, middle)
        if senses.fix.arrived:
            at = _step_at(told, count, senses.fix.age)
            told = put(told, at, senses.fix)
            newest = oldest
            for ago in range(int(count), 0, -1):
                newest = advance(newest, told[ago], told[ago - 1], tuning, middle)
            newest = fixed(newest, told[0])
        return Remembered(newest.belief, newest.nis, newest, oldest, told, count)

    return Filter(start, step_on, fix_in)
