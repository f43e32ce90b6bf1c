"""Absolute fixes for any filter: an external pose measurement is applied at its stamp, however late it arrives.

This one keeps the inputs of the last steps and its estimate from before them. It inserts a fix into the step to which it
belongs, and replays the inputs since then. The result is bit-identical to that of a fix in time.

References:
    Bar-Shalom, "Update with out-of-sequence measurements in tracking: exact solution", *IEEE Transactions on Aerospace and
    Electronic Systems* 38 (2002), for the problem; over such a short history a replay is exact and simple.
"""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

from turtlebot_gym.estimation.interface import Filter
from turtlebot_gym.kernel import kernel
from turtlebot_gym.values import ORIGIN, Belief, Fix, senses_of


class StoredStep(NamedTuple):
    """Inputs of a filter in one step: what it reads of the senses, and the fix that was measured at its end."""

    senses: Any
    fix: Fix
    dt: float


class Remembered(NamedTuple):
    """State that the filter keeps between steps."""

    belief: Belief
    nis: float
    newest: Any
    """The filter's own estimate, with that belief and NIS."""
    history: tuple[StoredStep, ...]
    """Inputs of the last steps, newest first."""
    oldest: Any
    """Estimate from before the stored steps, with the fixes that were measured then."""
    steps: float
    """Number of steps from the oldest estimate to the newest."""


NO_FIX = Fix(ORIGIN, (1.0, 1.0, 1.0), 0.0, False)


@cache
def with_fixes(filter: Filter, depth: int, *, all_late: bool = False) -> Filter:
    """Return a filter that also takes fixes, from the sensor "fix": those of the present step, and of ``depth`` stored ones.

    With ``all_late`` each comes ``depth`` steps late: no stored step holds a fix to be repeated, which takes less time.
    """
    if depth == 0:
        return _in_time(filter)
    begin, step, fix_in, reads, *_ = filter
    Read, places = senses_of(reads), tuple(range(depth + 1))

    @kernel
    def stored_step(senses, dt):
        return StoredStep(Read(*(getattr(senses, name) for name in reads)), NO_FIX, dt)

    @kernel
    def remember(newest, stored, oldest, steps):
        return Remembered(newest.belief, newest.nis, newest, stored, oldest, steps)

    @kernel
    def advance(estimate, before, now, tuning, integrator):
        moved, fix = step(estimate, before.senses, now.senses, tuning, now.dt, integrator), now.fix
        return moved if all_late or not fix.arrived else fix_in(moved, fix.pose, fix.R + fix.cross, tuning)

    @kernel
    def start(senses, tuning):
        first, stored = begin(senses, tuning), stored_step(senses, 0.0)
        return remember(first, tuple(stored for _ in places), first, 0.0)

    @kernel
    def insert(estimate, fix, tuning, integrator):
        """Put a fix into the step that ended nearest to its measurement, and repeat all steps."""
        stored, oldest, count = estimate.history, estimate.oldest, estimate.steps
        at, off, ago = 0.0, abs(fix.age), 0.0
        for place in places[:-1]:
            ago = ago + stored[place].dt
            is_nearer = (place < count) & (abs(fix.age - ago) < off)
            at, off = place + 1.0 if is_nearer else at, abs(fix.age - ago) if is_nearer else off
        is_stored = off <= 0.5 * stored[0].dt + 1e-9
        if is_stored & (at == count):
            oldest = fix_in(oldest, fix.pose, fix.R + fix.cross, tuning)
        at = at if is_stored & (at < count) & (not all_late) else -1.0
        stored = tuple(each._replace(fix=fix if at == place else each.fix) for place, each in zip(places, stored, strict=True))
        newest = oldest
        for place in places[:0:-1]:
            if place <= count:
                newest = advance(newest, stored[place], stored[place - 1], tuning, integrator)
        return remember(newest, stored, oldest, count)

    @kernel
    def step_on(estimate, before, senses, tuning, dt, integrator):
        old, oldest, now = estimate.history, estimate.oldest, senses.fix
        if estimate.steps >= depth:
            oldest = advance(oldest, old[depth], old[depth - 1], tuning, integrator)
        newest, stored = step(estimate.newest, before, senses, tuning, dt, integrator), (stored_step(senses, dt), *old[:-1])
        remembered = remember(newest, stored, oldest, min(estimate.steps + 1.0, 1.0 * depth))
        if now.arrived:
            fix = Fix(now.pose, now.R, now.age, now.arrived, now.cross)  # without what a simulated sensor keeps beside it
            remembered = insert(remembered, fix, tuning, integrator)
        return remembered

    return filter._replace(start=start, step=step_on, reads=(*reads, "fix"))


def _in_time(filter: Filter) -> Filter:
    step, fix_in = filter.step, filter.fix

    @kernel
    def step_on(estimate, before, senses, tuning, dt, integrator):
        now, moved = senses.fix, step(estimate, before, senses, tuning, dt, integrator)
        is_now = now.arrived and abs(now.age) <= 0.5 * dt + 1e-9
        return fix_in(moved, now.pose, now.R + now.cross, tuning) if is_now else moved

    return filter._replace(step=step_on, reads=(*filter.reads, "fix"))
