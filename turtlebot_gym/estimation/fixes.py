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
    """Return the number of steps of dt, s, to store for fixes up to an age, s; 0 for those of the present step."""
    return late_by(age, dt)


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


def _put(count: int) -> Callable[[Any, float, Fix], Any]:
    """Return the kernel that puts a fix into one of ``count`` steps."""
    if count == 1:
        return kernel(lambda history, at, fix: (_with_fix(history[0], fix, at == 0),))
    rest = _put(count - 1)
    return kernel(lambda history, at, fix: (_with_fix(history[0], fix, at == 0),) + rest(history[1:], at - 1, fix))  # noqa: RUF005


def _nearest(at: int, depth: int) -> Callable[..., Any]:
    """Return the kernel that goes on from step ``at`` to find the step end nearest to an age, s, and how far off it is, s."""
    if at == depth:
        return kernel(lambda history, count, age, nearest, off, passed: (nearest, off))
    rest = _nearest(at + 1, depth)

    @kernel
    def nearest_of(history, count, age, nearest, off, passed):
        ago = passed + history[at].dt
        is_nearer = (at < count) & (abs(age - ago) < off)
        return rest(history, count, age, at + 1.0 if is_nearer else nearest, abs(age - ago) if is_nearer else off, ago)

    return nearest_of


def _replay(advance: Callable[..., Any], last: int) -> Callable[..., Any]:
    """Return the kernel that repeats the last ``count`` of at most ``last`` steps, without a loop."""
    if last == 0:
        return kernel(lambda estimate, stored, count, tuning, integrator: estimate)
    rest, before = _replay(advance, last - 1), last - 1

    @kernel
    def replay(estimate, stored, count, tuning, integrator):
        moved = estimate
        if last <= count:
            moved = advance(estimate, stored[last], stored[before], tuning, integrator)
        return rest(moved, stored, count, tuning, integrator)

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
    """Return a filter that also takes fixes up to some age, from the sensor "fix"; it goes on reading what it has read.

    Args:
        filter: Any filter.
        depth: Number of stored steps; with 0 it takes fixes of the present step.
    """
    if depth == 0:
        return _in_time(filter)
    (start, remember, advance), fix_in, put = _remembering(filter, depth), filter.fix, _put(depth + 1)
    nearest_of, replay = _nearest(0, depth), _replay(advance, depth)

    @kernel
    def insert(estimate, fix, tuning, integrator):
        stored, oldest, count = estimate.history, estimate.oldest, estimate.steps
        at, off = nearest_of(stored, count, fix.age, 0.0, abs(fix.age), 0.0)
        is_stored = off <= 0.5 * stored[0].dt + 1e-9
        if is_stored & (at == count):
            oldest = fix_in(oldest, fix.pose, fix.R + fix.cross, tuning)
        stored = put(stored, at if is_stored & (at < count) else -1.0, fix)
        newest = replay(oldest, stored, count, tuning, integrator)
        return Remembered(newest.belief, newest.nis, newest, stored, oldest, count)

    @kernel
    def step_on(estimate, before, senses, tuning, dt, integrator):
        now, remembered = senses.fix, remember(estimate, before, senses, tuning, dt, integrator)
        if now.arrived:
            fix = Fix(now.pose, now.R, now.age, now.arrived, now.cross)  # without what a simulated sensor keeps beside it
            remembered = insert(remembered, fix, tuning, integrator)
        return remembered

    return filter._replace(start=start, step=step_on, reads=(*filter.reads, "fix"))


def _in_time(filter: Filter) -> Filter:
    step, fix_in = filter.step, filter.fix

    @kernel
    def step_on(estimate, before, senses, tuning, dt, integrator):
        now, moved = senses.fix, step(estimate, before, senses, tuning, dt, integrator)
        if now.arrived and abs(now.age) <= 0.5 * dt + 1e-9:
            moved = fix_in(moved, now.pose, now.R + now.cross, tuning)
        return moved

    return filter._replace(step=step_on, reads=(*filter.reads, "fix"))
