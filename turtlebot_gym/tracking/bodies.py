"""Bodies in a scan: runs of beams as wide as a person or a leg, each with its place, time and variance.

A person is seen as one round body, or as two legs. Neighbouring beams belong to one run unless their ranges differ by more than
noise; what stands before something hides a part of it, so that side of a run says nothing about where it ends.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from turtlebot_gym.kernel import kernel, sqrt
from turtlebot_gym.tracking.sweep import Sweep, bin_of, deviation_at, end_of, goes_round, time_of, was_free

MOST_BODIES, COLUMNS = 64, 10
X, Y, UX, UY, AT, VARIANCE, RADIUS, WHOLE, MOVED, TAKEN = range(COLUMNS)
"""Most bodies of a scan, and their columns: position in the odometry's frame, m; unit vector towards it; time, s; variance of
each coordinate, m^2; radius, m; 1 if no side is hidden; 1 if the place was free before; and 1 if used."""
GAP = 2  # most beams without a return inside of a run
POST = 0.15  # greatest angle of beams in a run that have never returned anything, rad: a post beside the LiDAR hides it
JUMP, LEAST_JUMP = 4.0, 0.15  # difference of ranges that ends a run, in standard deviations of a range and at least, m
TOUCH = 0.05  # how much farther than the least range that can be measured the edge of what is too near may be, m
TOO_NEAR = 0.75  # mean range of what is too near to be measured, as a share of the least that can be
LEAST_BEAMS = 3  # fewest beams of a body
LEAST_RADIUS, MOST_RADIUS, USUAL_RADIUS = 0.02, 0.45, 0.25
"""Radii of what may be a leg or a person, and that of a person of whom a part is hidden, m."""
DEPTH = 0.785  # mean distance of a round body's visible points from its nearest one, in radii, subtracted from 1: pi / 4
SHAPE, HIDDEN, NARROW, LEGS = 0.01, 0.05, 0.12, 0.06
"""Standard deviations of a place since bodies are not round, a part is hidden, all but a narrow part is, and legs swing; m."""
LEG_RADIUS, STRIDE = 0.13, 0.6  # greatest radius of a leg, and distance between two legs of a person, m
TWO = 0.33  # radius from which on a run may be two bodies side by side, m; they meet at the beam of the longest range
MEET, MEET_SHARE = 0.03, 2.0  # by how much ranges on both sides of it are shorter: m, and in standard deviations of a range
BEGUN = 0.08  # least radius of a run that reaches the end of a revolution and counts as a person, m; most legs are narrower
JUST = 1e-6  # subtracted from the time of such a run, s, so that the whole body of the next revolution is later


class Run(NamedTuple):
    """Neighbouring beams that end at one body, or at bodies beside each other; beams below 0 are of the revolution before."""

    first: int
    last: int
    n: int
    """Number of beams with a return, and of those at which it is too near to be measured."""
    total: float
    """Sum of their ranges, m."""
    hidden: int
    """Sum of 1 if the first beam's side is hidden, and 2 if the last beam's is, or 4 if it goes on in the next revolution."""


@kernel
def _radius_of(run: Run, sweep: Sweep) -> float:
    """Return the radius of a round body that the beams of a run meet, m."""
    half = 0.5 * abs(sweep.step) * (run.last - run.first + 1)
    return run.total / run.n * half / max(1.0 - DEPTH * half, 0.3)


@kernel
def _add_body(bodies: Any, count: int, run: Run, sweep: Sweep, trail: Any) -> int:
    """Add the body of a run, if a person or a leg may be as wide; return the number of bodies."""
    first, last, n, total, hidden = run
    goes_on = hidden >= 4
    if n < LEAST_BEAMS or hidden == 3 or hidden == 5 or count >= len(bodies):
        return count
    mean, radius = total / n, _radius_of(run, sweep)
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
    body, unsure = bodies[count], 0.0 if whole else (NARROW if narrow else HIDDEN)
    body[X], body[Y], body[UX], body[UY] = end_of(middle, mean + DEPTH * radius, sweep, trail)
    body[AT] = time_of(min(middle, sweep.number - 1.0), sweep) - (JUST if goes_on else 0.0)
    body[VARIANCE] = variance + unsure * unsure
    body[RADIUS], body[WHOLE], body[MOVED], body[TAKEN] = radius, 1.0 if whole else 0.0, 0.0, 0.0
    return count + 1


@kernel
def _is_return(length: float, sweep: Sweep) -> bool:
    """Return whether a beam ended at something that the LiDAR can measure."""
    return bool(0.0 < length <= sweep.range_max)


@kernel
def _meeting(run: Run, lengths: Any, sweep: Sweep) -> int:
    """Return the beam of a run at which two bodies meet, by means of three ranges; the last one if there is only one body."""
    low, peak, at, before, older = math.inf, 0.0, run.last, 0.0, 0.0
    for beam in range(run.first, run.last + 1):
        length = float(lengths[len(lengths) - sweep.number + beam])
        if not _is_return(length, sweep):
            continue
        mean, smooth, older, before = (length + before + older) / 3.0, older > 0.0, before, length
        if not smooth:
            continue
        least = max(MEET, MEET_SHARE * deviation_at(mean, sweep))
        if at < run.last and mean < peak - least:
            return at
        if mean < low:
            low, peak, at = mean, mean, run.last
        elif mean > peak:
            peak, at = mean, beam - 1 if mean - low > least else run.last
    return run.last


@kernel
def _add_run(bodies: Any, count: int, run: Run, lengths: Any, sweep: Sweep, trail: Any) -> int:
    """Add the bodies of a run: two if a wide one is farther away in between; return the number of bodies."""
    cut = _meeting(run, lengths, sweep) if _radius_of(run, sweep) >= TWO else run.last
    if cut == run.last:
        return _add_body(bodies, count, run, sweep, trail)
    m, part, zero = 0, 0.0, len(lengths) - sweep.number
    for beam in range(run.first, cut + 1):
        length = float(lengths[zero + beam])
        if _is_return(length, sweep):
            m, part = m + 1, part + length
    n, total, hidden = run.n - m, run.total - part, run.hidden
    if not 0 < m < run.n:
        return count
    behind = part * n > total * m  # the nearer one hides a part of the other
    count = _add_body(bodies, count, Run(run.first, cut, m, part, hidden % 2 + (2 if behind else 0)), sweep, trail)
    return _add_body(bodies, count, Run(cut + 1, run.last, n, total, hidden // 2 * 2 + (0 if behind else 1)), sweep, trail)


@kernel
def find_bodies(ranges: Any, tail: Any, returns: Any, sweep: Sweep, trail: Any, bodies: Any) -> int:
    """Write the bodies that a scan shows, and return their number.

    A run at the end of a revolution goes on in the next; until then it is a body of which a part is hidden. ``tail`` and
    ``returns`` of a `TrackerMemory` are brought up to date. Ranges are infinite without a return, and NaN where a beam is
    missing, m.
    """
    number, width = sweep.number, min(len(tail), sweep.number)
    lengths = np.empty(width + number)
    lengths[width:] = ranges[:number]
    lengths[:width] = lengths[number:] if sweep.interval == 0.0 else tail[:width]
    tail[:width] = lengths[number:]
    full = goes_round(number, sweep.step)
    count, run, before = 0, Run(0, -width - 1, 0, 0.0, 1), math.inf
    blind, post = True, True  # since the last return there was a beam that may be blind, or only such
    for beam in range(-width if full else 0, number):
        length = float(lengths[width + beam])
        if not _is_return(length, sweep):
            dead = returns[bin_of(beam, number)] == 0.0
            blind, post = blind or length != math.inf or dead, post and dead
            continue
        if beam >= 0:
            returns[bin_of(beam, number)] = 1.0
        missing, noise = beam - run.last - 1, deviation_at(min(length, before), sweep)
        near, n, more = missing <= GAP, 1, length
        is_same = near or (post and (missing + 1) * abs(sweep.step) <= POST)
        is_same = run.n > 0 and is_same and abs(length - before) <= max(LEAST_JUMP, JUMP * noise)
        if run.n > 0 and not near and max(length, before) <= sweep.lidar.range_min + max(TOUCH, JUMP * noise):
            is_same, n = True, missing + 1  # by what stands nearer than the LiDAR can measure
            more = missing * TOO_NEAR * sweep.lidar.range_min + length
        if not is_same:
            hides = blind and not near
            if run.n > 0 and run.last >= -1 - GAP:
                ended = run._replace(hidden=run.hidden | (2 if (near and length < before) or hides else 0))
                count = _add_run(bodies, count, ended, lengths, sweep, trail)
            run = Run(beam, beam, 0, 0.0, 1 if (near and length > before) or hides else 0)
        run = run._replace(last=beam, n=run.n + n, total=run.total + more)
        before, blind, post = length, False, True
    goes_on = full and run.last >= number - 1 - GAP
    if run.n > 0 and not (goes_on and sweep.interval == 0.0):
        ended = run._replace(hidden=run.hidden | (4 if goes_on else 2 if blind or not full else 0))
        count = _add_run(bodies, count, ended, lengths, sweep, trail)
    return count


@kernel
def mark_moved(bodies: Any, count: int, past: Any, returns: Any, sweep: Sweep, trail: Any, turned: float) -> None:
    """Mark the bodies at places that were free before, and make one body of two legs: the first; the other is taken."""
    for k in range(count):
        body = bodies[k]
        x, y = body[X] - DEPTH * body[RADIUS] * body[UX], body[Y] - DEPTH * body[RADIUS] * body[UY]  # what was measured
        body[MOVED] = 1.0 if was_free(past, returns, x, y, body[AT], sweep, trail, turned) else 0.0
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
