"""Absolute fixes for any filter: an external pose measurement is applied at its stamp, however late it arrives.

A filter that treated a late fix as current would pull the belief back to where the robot was. This one keeps the inputs of the
last steps and its estimate from before them. It inserts a fix into the step to which it belongs, and replays the inputs since
then. The result is bit-identical to that of a fix in time.

References:
    Bar-Shalom, "Update with out-of-sequence measurements in tracking: exact solution", *IEEE Transactions on Aerospace and
    Electronic Systems* 38 (2002), for the problem; over such a short history a replay is exact and simple.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

from turtlebot_gym.estimation.interface import Filter
from turtlebot_gym.kernel import kernel
from turtlebot_gym.parameters import MAX_FIX_AGE
from turtlebot_gym.values import Belief, Fix, Pose, senses_of


class _Told(NamedTuple):
    """Inputs of a filter in one step."""

    senses: Any
    """Values of the sensors that the filter reads."""
    fix: Fix
    """Fix that was measured at the end of the step, whenever it arrived."""
    dt: float
    """Length of the step, s."""


class _Remembered(NamedTuple):
    """State that the filter keeps between steps."""

    belief: Belief
    nis: float
    """Normalized innovation squared of the odometry's last measurement."""
    newest: Any
    """The filter's own estimate."""
    oldest: Any
    """Estimate from before the stored steps, before that step's own fix."""
    told: tuple[_Told, ...]
    """Inputs of the last steps, newest first."""
    steps: float
    """Number of steps from the oldest estimate to the newest."""


def depth_of(dt: float, age: float = MAX_FIX_AGE) -> int:
    """Return the number of steps of dt, s, to store for fixes up to an age, s."""
    return max(1, round(age / dt))


@kernel
def no_fix() -> Fix:
    """Return the placeholder for no fix."""
    return Fix(Pose(0.0, 0.0, 0.0), (1.0, 1.0, 1.0), 0.0, False)


@kernel
def _with_fix(told: _Told, fix: Fix, here: bool) -> _Told:
    return _Told(told.senses, fix if here else told.fix, told.dt)


def filled(count: int) -> Callable[[Any], Any]:
    """Return the kernel that makes a tuple of ``count`` equal values."""
    if count == 1:
        return kernel(lambda value: (value,))
    rest = filled(count - 1)
    return kernel(lambda value: (value,) + rest(value))  # noqa: RUF005  # compiled code has no star expressions


def _values_of(names: tuple[str, ...]) -> Callable[[Any], Any]:
    """Return the kernel that takes the values of some sensors, as a tuple."""
    name, rest = names[0], _values_of(names[1:]) if names[1:] else None
    if rest is None:
        return kernel(lambda senses: (getattr(senses, name),))
    return kernel(lambda senses: (getattr(senses, name),) + rest(senses))  # noqa: RUF005


def _put(count: int) -> Callable[[Any, int, Fix], Any]:
    """Return the kernel that puts a fix into one of ``count`` steps."""
    if count == 1:
        return kernel(lambda told, at, fix: (_with_fix(told[0], fix, at == 0),))
    rest = _put(count - 1)
    return kernel(lambda told, at, fix: (_with_fix(told[0], fix, at == 0),) + rest(told[1:], at - 1, fix))  # noqa: RUF005


@kernel
def _step_at(told: Any, count: float, age: float) -> int:
    """Return how many steps ago an age, s, is: that of the nearest step end; -1 if that step is no longer stored."""
    nearest, off, passed = 0, abs(age), 0.0
    for steps in range(int(count)):
        passed += told[steps].dt
        is_nearer = abs(age - passed) < off
        nearest = steps + 1 if is_nearer else nearest
        off = abs(age - passed) if is_nearer else off
    return nearest if off <= 0.5 * told[0].dt + 1e-9 else -1


@cache
def with_fixes(filter: Filter, depth: int) -> Filter:
    """Return a filter that also takes fixes, from the sensor "fix"; the filter goes on reading what it has read.

    Args:
        filter: Any filter.
        depth: Number of stored steps.
    """
    begin, step, fix_in, reads, _, _ = filter
    Read, values_of = senses_of(reads), _values_of(reads)  # only these are stored, for as many steps as a fix may be late
    fill, put, last = filled(depth + 1), _put(depth + 1), depth

    @kernel
    def fixed(estimate, told, tuning):
        return fix_in(estimate, told.fix.pose, told.fix.R, tuning) if told.fix.arrived else estimate

    @kernel
    def advance(estimate, before, now, tuning, middle):
        return step(fixed(estimate, before, tuning), before.senses, now.senses, tuning, now.dt, middle)

    @kernel
    def start(senses, tuning):
        first = begin(senses, tuning)
        told = _Told(Read(*values_of(senses)), no_fix(), 0.0)
        return _Remembered(first.belief, first.nis, first, first, fill(told), 0.0)

    @kernel
    def step_on(estimate, before, senses, tuning, dt, middle):
        oldest, old = estimate.oldest, estimate.told
        if estimate.steps >= last:
            oldest = advance(oldest, old[last], old[last - 1], tuning, middle)
        count = min(estimate.steps + 1.0, 1.0 * last)
        told = (_Told(Read(*values_of(senses)), no_fix(), dt),) + old[:-1]  # noqa: RUF005
        newest = step(estimate.newest, before, senses, tuning, dt, middle)
        now = senses.fix
        if now.arrived:
            fix = Fix(now.pose, now.R, now.age, now.arrived)  # without what a simulated sensor keeps beside it
            told = put(told, _step_at(told, count, fix.age), fix)
            newest = oldest
            for ago in range(int(count), 0, -1):
                newest = advance(newest, told[ago], told[ago - 1], tuning, middle)
            newest = fixed(newest, told[0], tuning)
        return _Remembered(newest.belief, newest.nis, newest, oldest, told, count)

    return filter._replace(start=start, step=step_on, reads=(*reads, "fix"))
