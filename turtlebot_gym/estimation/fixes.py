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


class StoredStep(NamedTuple):
    """Inputs of a filter in one step."""

    senses: Any
    """Values of the sensors that the filter reads."""
    fix: Fix
    """Fix that was measured at the end of the step, whenever it arrived."""
    dt: float
    """Length of the step, s."""


class Remembered(NamedTuple):
    """State that the filter keeps between steps."""

    belief: Belief
    nis: float
    """Normalized innovation squared of the odometry's last measurement."""
    newest: Any
    """The filter's own estimate."""
    history: tuple[StoredStep, ...]
    """Inputs of the last steps, newest first."""
    oldest: Any
    """Estimate from before the stored steps, with the fixes that were measured then."""
    steps: float
    """Number of steps from the oldest estimate to the newest."""


def late_by(age: float, dt: float) -> int:
    """Return how many steps of dt, s, a fix of an age, s, is late."""
    return round(age / dt)


def depth_of(dt: float, age: float = MAX_FIX_AGE) -> int:
    """Return the number of steps of dt, s, to store for fixes up to an age, s."""
    return max(1, late_by(age, dt))


@kernel
def no_fix() -> Fix:
    """Return the placeholder for no fix."""
    return Fix(Pose(0.0, 0.0, 0.0), (1.0, 1.0, 1.0), 0.0, False, (0.0, 0.0, 0.0))


@kernel
def _with_fix(stored: StoredStep, fix: Fix, here: bool) -> StoredStep:
    return StoredStep(stored.senses, fix if here else stored.fix, stored.dt)


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
        return kernel(lambda history, at, fix: (_with_fix(history[0], fix, at == 0),))
    rest = _put(count - 1)
    return kernel(lambda history, at, fix: (_with_fix(history[0], fix, at == 0),) + rest(history[1:], at - 1, fix))  # noqa: RUF005


@kernel
def _step_at(history: Any, count: float, age: float) -> int:
    """Return how many steps ago an age, s, is: that of the nearest step end; -1 if that step is no longer stored."""
    nearest, off, passed = 0, abs(age), 0.0
    for steps in range(int(count)):
        passed += history[steps].dt
        is_nearer = abs(age - passed) < off
        nearest = steps + 1 if is_nearer else nearest
        off = abs(age - passed) if is_nearer else off
    return nearest if off <= 0.5 * history[0].dt + 1e-9 else -1


def _replay(advance: Callable[..., Any], count: int) -> Callable[..., Any]:
    """Return the kernel that repeats the last ``count`` steps, without a loop."""
    if count == 0:
        return kernel(lambda estimate, stored, tuning, integrator: estimate)
    rest, before = _replay(advance, count - 1), count - 1

    @kernel
    def replay(estimate, stored, tuning, integrator):
        return rest(advance(estimate, stored[count], stored[before], tuning, integrator), stored, tuning, integrator)

    return replay


class _Memory(NamedTuple):
    """The parts of a filter that remembers its last steps."""

    start: Callable[..., Remembered]
    remember: Callable[..., Remembered]
    """``remember(estimate, before, senses, tuning, dt, integrator)`` returns the estimate after a step without a fix."""
    advance: Callable[..., Any]
    """``advance(estimate, before, now, tuning, integrator)`` repeats a stored step."""


def _remembering(filter: Filter, depth: int) -> _Memory:
    begin, step, fix_in, reads, _, _ = filter
    Read, values_of = senses_of(reads), _values_of(reads)  # only these are stored, for as many steps as a fix may be late
    fill, last = filled(depth + 1), depth

    @kernel
    def advance(estimate, before, now, tuning, integrator):
        moved = step(estimate, before.senses, now.senses, tuning, now.dt, integrator)
        if now.fix.arrived:
            moved = fix_in(moved, now.fix.pose, now.fix.R + now.fix.cross, tuning)
        return moved

    @kernel
    def start(senses, tuning):
        first = begin(senses, tuning)
        stored = StoredStep(Read(*values_of(senses)), no_fix(), 0.0)
        return Remembered(first.belief, first.nis, first, fill(stored), first, 0.0)

    @kernel
    def remember(estimate, before, senses, tuning, dt, integrator):
        old, oldest = estimate.history, estimate.oldest
        if estimate.steps >= last:
            oldest = advance(oldest, old[last], old[last - 1], tuning, integrator)
        stored = (StoredStep(Read(*values_of(senses)), no_fix(), dt),) + old[:-1]  # noqa: RUF005
        newest = step(estimate.newest, before, senses, tuning, dt, integrator)
        return Remembered(newest.belief, newest.nis, newest, stored, oldest, min(estimate.steps + 1.0, 1.0 * last))

    return _Memory(start, remember, advance)


@cache
def with_fixes(filter: Filter, depth: int) -> Filter:
    """Return a filter that also takes fixes of any age, from the sensor "fix"; it goes on reading what it has read.

    Args:
        filter: Any filter.
        depth: Number of stored steps.
    """
    (start, remember, advance), fix_in, put = _remembering(filter, depth), filter.fix, _put(depth + 1)

    @kernel
    def insert(estimate, fix, tuning, integrator):
        stored, oldest, count = estimate.history, estimate.oldest, estimate.steps
        at = _step_at(stored, count, fix.age)
        if at == count:
            oldest = fix_in(oldest, fix.pose, fix.R + fix.cross, tuning)
        else:
            stored = put(stored, at, fix)
        newest = oldest
        for ago in range(int(count), 0, -1):
            newest = advance(newest, stored[ago], stored[ago - 1], tuning, integrator)
        return Remembered(newest.belief, newest.nis, newest, stored, oldest, count)

    @kernel
    def step_on(estimate, before, senses, tuning, dt, integrator):
        now, remembered = senses.fix, remember(estimate, before, senses, tuning, dt, integrator)
        if now.arrived:
            fix = Fix(now.pose, now.R, now.age, now.arrived, now.cross)  # without what a simulated sensor keeps beside it
            remembered = insert(remembered, fix, tuning, integrator)
        return remembered

    return filter._replace(start=start, step=step_on, reads=(*filter.reads, "fix"))


@cache
def with_fixes_of_age(filter: Filter, late: int) -> Filter:
    """Return a filter that also takes fixes, from the sensor "fix", which all come ``late`` steps late.

    Each such fix belongs to the oldest estimate, from which the stored steps are repeated; one in time needs no stored step.
    The results are those of `with_fixes` to the bit. The filter leaves out fixes of another age: `with_fixes` takes all.
    """
    fix_in, step, (start, remember, advance) = filter.fix, filter.step, _remembering(filter, max(late, 1))
    replay = _replay(advance, late)

    @kernel
    def is_expected(age, dt):
        return abs(age - late * dt) <= 0.5 * dt + 1e-9

    @kernel
    def step_in_time(estimate, before, senses, tuning, dt, integrator):
        now, moved = senses.fix, step(estimate, before, senses, tuning, dt, integrator)
        if now.arrived and is_expected(now.age, dt):
            moved = fix_in(moved, now.pose, now.R + now.cross, tuning)
        return moved

    @kernel
    def step_late(estimate, before, senses, tuning, dt, integrator):
        now, after = senses.fix, remember(estimate, before, senses, tuning, dt, integrator)
        if now.arrived and is_expected(now.age, dt):
            oldest = fix_in(after.oldest, now.pose, now.R + now.cross, tuning)
            newest = replay(oldest, after.history, tuning, integrator)
            after = Remembered(newest.belief, newest.nis, newest, after.history, oldest, after.steps)
        return after

    reads = (*filter.reads, "fix")
    return (
        filter._replace(start=start, step=step_late, reads=reads) if late else filter._replace(step=step_in_time, reads=reads)
    )
