"""Bodies in a scan: runs of beams as wide as a person or a leg, each with its place, time and variance.

A person is seen as one round body, or as two legs. Neighbouring beams belong to one run unless their ranges differ by more than
noise; what stands before something hides a part of it, so that side of a run says nothing about where it ends.
"""

from __future__ import annotations

import math
from typing import Any

from turtlebot_gym.kernel import kernel, sqrt
from turtlebot_gym.tracking.sweep import Sweep, bin_of, deviation_at, end_of, goes_round, time_of, was_free

MOST_BODIES, COLUMNS = 64, 10
"""Most bodies of a scan."""
X, Y, UX, UY, AT, VARIANCE, RADIUS, WHOLE, MOVED, TAKEN = range(COLUMNS)
"""Columns of bodies: position in the odometry's frame, m; unit vector towards it; time, s; variance of each coordinate, m^2;
radius, m; 1 if no side is hidden; 1 if the place was free before; and 1 if used."""
GAP = 2
"""Most beams without a return inside of a run."""
POST = 0.15
"""Greatest angle of beams that have never returned anything inside of a run, rad: a post beside the LiDAR hides it."""
JUMP, LEAST_JUMP = 4.0, 0.15
"""Difference of neighbouring ranges that ends a run, in standard deviations of a range and at least, m."""
TOUCH = 0.05
"""How much farther than the least range that can be measured the edge of what is too near may be, m."""
TOO_NEAR = 0.75
"""Mean range of what is too near to be measured, as a share of the least that can be."""
LEAST_BEAMS = 3
"""Fewest beams of a body."""
LEAST_RADIUS, MOST_RADIUS, USUAL_RADIUS = 0.02, 0.45, 0.25
"""Radii of what may be a leg or a person, and that of a person of whom a part is hidden, m."""
DEPTH = 0.785
"""Mean distance of a round body's visible points from its nearest one, in radii, subtracted from 1: pi / 4."""
SHAPE = 0.01
"""Standard deviation of a body's place since bodies are not round, m ..."""
HIDDEN = 0.05
"""... since a part is hidden ..."""
NARROW = 0.12
"""... since all but a narrow part is ..."""
LEGS = 0.06
"""... and since legs swing."""
LEG_RADIUS, STRIDE = 0.13, 0.6
"""Greatest radius of a leg, and distance between two legs of a person, m."""
TWO = 0.33
"""Radius from which on a run may be two bodies side by side, m; they meet at the beam of the longest range."""
MEET, MEET_SHARE = 0.03, 2.0
"""Least amount by which the ranges on both sides of that beam are shorter: m, and standard deviations of a range."""
BEGUN = 0.08
"""Least radius of a run that reaches the end of a revolution and counts as a person, m; most legs are narrower."""
JUST = 1e-6
"""Subtracted from the time of such a run, s, so that the whole body of the next revolution is later."""


@kernel
def _radius_of(mean: float, beams: int, sweep: Sweep) -> float:
    """Return the radius of a round body that some beams meet at a mean range, m."""
    half = 0.5 * abs(sweep.step) * beams
    return mean * half / max(1.0 - DEPTH * half, 0.3)


@kernel
def _add_body(
    bodies: Any, count: int, first: int, last: int, n: int, total: float, hidden: int, sweep: Sweep, trail: Any
) -> int:
    """Add the body of a run, if a person or a leg may be as wide; return the number of bodies.

    Args:
        bodies: Shape (`MOST_BODIES`, `COLUMNS`).
        count: Their number.
        first: First beam of the run ...
        last: ... and the last.
        n: Number of those with a return.
        total: Sum of their ranges, m.
        hidden: Sum of 1 if the first beam's side is hidden, and 2 if the last beam's side is, or 4 if the run goes on in the
            next revolution.
        sweep: How beams were measured.
        trail: The odometry.
    """
    goes_on = hidden >= 4
    if n < LEAST_BEAMS or hidden == 3 or hidden == 5 or count >= len(bodies):
        return count
    mean, radius = total / n, _radius_of(total / n, last - first + 1, sweep)
    if not (BEGUN if goes_on else LEAST_RADIUS) <= radius <= MOST_RADIUS:
        return count
    middle, noise = 0.5 * (first + last), deviation_at(mean, sweep)
    variance = noise * noise / n + mean * mean * sweep.step * sweep.step / 12.0 + SHAPE * SHAPE
    narrow = 0 < hidden < 4 and radius < LEG_RADIUS  # a leg, or little of a person
    if hidden != 0 and not narrow:
        radius = max(radius, USUAL_RADIUS)
        beams = radius / (mean + radius) / abs(sweep.step)
        middle = last + 0.5 - beams if hidden == 1 else first - 0.5 + beams
    whole = hidden == 0 and mean + radius < sweep.range_max
    body = bodies[count]
    body[X], body[Y], body[UX], body[UY] = end_of(middle, mean + DEPTH * radius, sweep, trail)
    unsure = 0.0 if whole else (NARROW if narrow else HIDDEN)
    body[AT] = time_of(min(middle, sweep.number - 1.0), sweep) - (JUST if goes_on else 0.0)
    body[VARIANCE] = variance + unsure * unsure
    body[RADIUS], body[WHOLE], body[MOVED], body[TAKEN] = radius, 1.0 if whole else 0.0, 0.0, 0.0
    return count + 1


@kernel
def _length_of(beam: int, ranges: Any, tail: Any, sweep: Sweep) -> float:
    """Return what a beam measured, m; beams below 0 are those of the revolution before."""
    return float(ranges[beam]) if beam >= 0 else float(tail[min(len(tail), sweep.number) + beam])


@kernel
def _is_return(length: float, sweep: Sweep) -> bool:
    """Return whether a beam ended at something that the LiDAR can measure."""
    return bool(0.0 < length <= sweep.range_max)


@kernel
def _meeting(first: int, last: int, ranges: Any, tail: Any, sweep: Sweep) -> int:
    """Return the beam of a run at which two bodies meet, by means of three ranges; the last one if there is only one body."""
    low, peak, at, found, before, older = math.inf, 0.0, last, last, 0.0, 0.0
    for beam in range(first, last + 1):
        length = _length_of(beam, ranges, tail, sweep)
        if found < last or not _is_return(length, sweep):
            continue
        mean, smooth, older, before = (length + before + older) / 3.0, older > 0.0, before, length
        if not smooth:
            continue
        least = max(MEET, MEET_SHARE * deviation_at(mean, sweep))
        if at < last and mean < peak - least:
            found = at
        elif mean < low:
            low, peak, at = mean, mean, last
        elif mean > peak:
            peak, at = mean, beam - 1 if mean - low > least else last
    return found


@kernel
def _add_run(
    bodies: Any,
    count: int,
    first: int,
    last: int,
    n: int,
    total: float,
    hidden: int,
    ranges: Any,
    tail: Any,
    sweep: Sweep,
    trail: Any,
) -> int:
    """Add the bodies of a run, see `_add_body`: two if a wide one is farther away in between; return their number."""
    cut = last
    if _radius_of(total / n, last - first + 1, sweep) >= TWO:
        cut = _meeting(first, last, ranges, tail, sweep)
    if cut == last:
        return _add_body(bodies, count, first, last, n, total, hidden, sweep, trail)
    m, part = 0, 0.0
    for beam in range(first, cut + 1):
        length = _length_of(beam, ranges, tail, sweep)
        if _is_return(length, sweep):
            m, part = m + 1, part + length
    if not 0 < m < n:
        return count
    behind = part * (n - m) > (total - part) * m  # the nearer one hides a part of the other
    count = _add_body(bodies, count, first, cut, m, part, hidden % 2 + (2 if behind else 0), sweep, trail)
    return _add_body(bodies, count, cut + 1, last, n - m, total - part, hidden // 2 * 2 + (0 if behind else 1), sweep, trail)


@kernel
def _join_legs(bodies: Any, count: int) -> None:
    """Make one body of two legs beside each other: the first becomes their middle, the other is taken."""
    for a in range(count):
        for b in range(a + 1, count):
            one, other = bodies[a], bodies[b]
            small = one[RADIUS] < LEG_RADIUS and other[RADIUS] < LEG_RADIUS and one[TAKEN] + other[TAKEN] == 0.0
            dx, dy = other[X] - one[X], other[Y] - one[Y]
            apart = sqrt(dx * dx + dy * dy)
            if small and apart < STRIDE and abs(other[AT] - one[AT]) < 0.1:
                one[X], one[Y], one[AT] = one[X] + 0.5 * dx, one[Y] + 0.5 * dy, 0.5 * (one[AT] + other[AT])
                one[VARIANCE] = 0.25 * (one[VARIANCE] + other[VARIANCE]) + LEGS * LEGS
                one[RADIUS], one[WHOLE] = 0.5 * apart + one[RADIUS], min(one[WHOLE], other[WHOLE])
                one[MOVED], other[TAKEN] = max(one[MOVED], other[MOVED]), 1.0


@kernel
def find_bodies(ranges: Any, tail: Any, returns: Any, sweep: Sweep, trail: Any, bodies: Any) -> int:
    """Write the bodies that a scan shows, and return their number.

    A LiDAR that turns measures the last beam of a revolution just before the first of the next. A run that has begun there is
    continued; until then it is a body of which a part is hidden.

    Args:
        ranges: Shape (B,), m; infinite without a return, NaN where a beam is missing.
        tail: Shape (W,): last ranges of the revolution before, W at most B; replaced by those of this one. NaN for none.
        returns: Shape (`BINS`,), see `sweep.was_free`; completed.
        sweep: How beams were measured.
        trail: The odometry, back to the first beam of the tail.
        bodies: Output, shape (`MOST_BODIES`, `COLUMNS`).
    """
    number, width = sweep.number, min(len(tail), sweep.number)
    full = goes_round(number, sweep.step)
    if sweep.interval == 0.0:
        for k in range(width):
            tail[k] = float(ranges[number - width + k])
    count, n, first, last, hidden, total, before = 0, 0, 0, -width - 1, 1, 0.0, math.inf
    blind, post = True, True  # since the last return there was a beam that may be blind, or only such
    for beam in range(-width if full else 0, number):
        length = _length_of(beam, ranges, tail, sweep)
        if not _is_return(length, sweep):
            dead = returns[bin_of(beam, number)] == 0.0
            blind, post = blind or length != math.inf or dead, post and dead
            continue
        if beam >= 0:
            returns[bin_of(beam, number)] = 1.0
        noise = deviation_at(min(length, before), sweep)
        near = beam - last <= GAP + 1
        if n > 0 and not near and max(length, before) <= sweep.range_min + max(TOUCH, JUMP * noise):
            missing = beam - last - 1  # by what stands nearer than the LiDAR can measure
            n, last, before, blind, post = n + missing + 1, beam, length, False, True
            total += missing * TOO_NEAR * sweep.range_min + length
            continue
        is_same = near or (post and (beam - last) * abs(sweep.step) <= POST)
        if n > 0 and is_same and abs(length - before) <= max(LEAST_JUMP, JUMP * noise):
            n, last, total, before, blind, post = n + 1, beam, total + length, length, False, True
            continue
        if n > 0 and last >= -1 - GAP:
            behind = 2 if (near and length < before) or (blind and not near) else 0
            count = _add_run(bodies, count, first, last, n, total, hidden | behind, ranges, tail, sweep, trail)
        hidden = 1 if (near and length > before) or (blind and not near) else 0
        n, first, last, total, before, blind, post = 1, beam, beam, length, length, False, True
    goes_on = full and last >= number - 1 - GAP
    if n > 0 and not (goes_on and sweep.interval == 0.0):
        behind = 4 if goes_on else 2 if blind or not full else 0
        count = _add_run(bodies, count, first, last, n, total, hidden | behind, ranges, tail, sweep, trail)
    for k in range(width):
        tail[k] = float(ranges[number - width + k])
    return count


@kernel
def mark_moved(bodies: Any, count: int, past: Any, returns: Any, sweep: Sweep, trail: Any, turned: float) -> None:
    """Mark the bodies at places that were free before, and make one body of two legs."""
    for k in range(count):
        body = bodies[k]
        x, y = body[X] - DEPTH * body[RADIUS] * body[UX], body[Y] - DEPTH * body[RADIUS] * body[UY]  # what was measured
        body[MOVED] = 1.0 if was_free(past, returns, x, y, body[AT], sweep, trail, turned) else 0.0
    _join_legs(bodies, count)
