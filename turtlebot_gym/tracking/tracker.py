"""The tracker: what it remembers, and its steps when odometry or a scan arrives and when a policy looks."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.kernel import kernel, sqrt
from turtlebot_gym.localization.points import remember, rest
from turtlebot_gym.models.angles import sincos, wrap
from turtlebot_gym.observations import NEAREST, TRACK_BOUNDS
from turtlebot_gym.tracking.bodies import COLUMNS, MOST_BODIES, find_bodies, mark_moved
from turtlebot_gym.tracking.sweep import BINS, EVERY, HEAD, PAST, Sweep, keep_scan
from turtlebot_gym.tracking.tracks import (
    CAPACITY,
    FIELDS,
    FRESH,
    MOVES,
    NONE,
    PX,
    PY,
    SIZE,
    STATE,
    TIME,
    VX,
    VY,
    follow,
    predicted,
)
from turtlebot_gym.values import Command, Pose

TAIL = 4
"""Share of a revolution that a body may cover, its inverse."""
_TURNED, _SLOT, _KEPT = range(3)


class TrackerMemory(NamedTuple):
    """What a tracker remembers; of many robots, with a leading axis."""

    trail: Any
    """Shape (T, 4): the odometry of the last steps, see `localization.points.remember`."""
    past: Any
    """Shape (`PAST`, `HEAD` + 4 T + B): scans, see `sweep.keep_scan`."""
    tail: Any
    """Shape (B // `TAIL`,): last ranges of the scan before, m."""
    returns: Any
    """Shape (`BINS`,): 1 where a beam has returned something."""
    bodies: Any
    """Shape (`MOST_BODIES`, `COLUMNS`): those of the newest scan, see `bodies`."""
    tracks: Any
    """Shape (`CAPACITY`, `FIELDS`), see `tracks`."""
    clock: Any
    """Shape (3,): sum of the odometry's turns, rad; next row of ``past``; and time of the newest, s."""
    seen: Any
    """Shape (`NEAREST` * 8,), float32: the numbers of the term `observations.TRACKS`."""


def make_memory(number: int, *, beams: int, poses: int) -> TrackerMemory:
    """Return empty memories of some robots.

    Args:
        number: Number of robots.
        beams: Most beams of a scan.
        poses: Number of odometry poses that reach back to the first beam that is read, see `poses_for`.
    """

    def zeros(*shape: int) -> NDArray[np.float64]:
        return np.zeros((number, *shape))

    return TrackerMemory(
        trail=zeros(poses, 4),
        past=zeros(PAST, HEAD + 4 * poses + beams),
        tail=zeros(beams // TAIL),
        returns=zeros(BINS),
        bodies=zeros(MOST_BODIES, COLUMNS),
        tracks=zeros(CAPACITY, FIELDS),
        clock=zeros(3),
        seen=np.zeros((number, NEAREST * len(TRACK_BOUNDS[0])), np.float32),
    )


def poses_for(revolution: float, dt: float) -> int:
    """Return how many poses, ``dt`` apart, cover a revolution and the tail of the one before; s."""
    return math.ceil((1.0 + 1.0 / TAIL) * revolution / dt - 1e-9) + 2


@kernel
def memory_at(memories: TrackerMemory, index: int) -> TrackerMemory:
    """Return the memory of one robot of many, as views."""
    return TrackerMemory(
        memories.trail[index],
        memories.past[index],
        memories.tail[index],
        memories.returns[index],
        memories.bodies[index],
        memories.tracks[index],
        memories.clock[index],
        memories.seen[index],
    )


@kernel
def begin(memory: TrackerMemory, time: float, pose: Pose) -> None:
    """Begin at rest, with nothing seen; time in s, pose of the odometry."""
    rest(memory.trail, time, pose)
    for slot in range(len(memory.past)):
        memory.past[slot, 0] = 0.0
    for k in range(len(memory.tail)):
        memory.tail[k] = math.nan
    for k in range(len(memory.returns)):
        memory.returns[k] = 0.0
    for k in range(len(memory.tracks)):
        memory.tracks[k, STATE] = 0.0
    memory.clock[_TURNED], memory.clock[_SLOT], memory.clock[_KEPT] = 0.0, 0.0, -math.inf
    for k in range(len(memory.seen)):
        memory.seen[k] = 0.0


@kernel
def on_odometry(memory: TrackerMemory, time: float, pose: Pose) -> None:
    """Take a pose of the odometry, later than those before; s."""
    memory.clock[_TURNED] += abs(wrap(pose.theta - memory.trail[0, 3]))
    remember(memory.trail, time, pose)


@kernel
def on_scan(memory: TrackerMemory, ranges: Any, sweep: Sweep) -> None:
    """Take a scan: update the tracks by what it shows.

    Args:
        memory: The tracker; its odometry must reach from the first beam to the last.
        ranges: Shape (B or more,), m; infinite without a return, NaN where a beam is missing.
        sweep: How beams were measured.
    """
    past, returns, bodies, trail, clock = memory.past, memory.returns, memory.bodies, memory.trail, memory.clock
    count = find_bodies(ranges, memory.tail, returns, sweep, trail, bodies)
    mark_moved(bodies, count, past, returns, sweep, trail, clock[_TURNED])
    follow(memory.tracks, bodies, count, sweep.last)
    if sweep.last - clock[_KEPT] >= EVERY - 1e-6:
        keep_scan(past, int(clock[_SLOT]), ranges, sweep, trail, clock[_TURNED])
        clock[_SLOT], clock[_KEPT] = (clock[_SLOT] + 1.0) % PAST, sweep.last


@kernel
def _write(seen: Any, place: int, track: Any, now: float, pose: Pose, twist: Command, scale: float) -> None:
    """Write the numbers of a track, as `observations.TRACKS` lists them."""
    dt, (sine, cosine) = now - track[TIME], sincos(pose.theta)
    P = predicted(track, dt)
    dx, dy = track[PX] + dt * track[VX] - pose.x, track[PY] + dt * track[VY] - pose.y
    # Ranges that are too long by a share lengthen the way from the robot, and the velocity relative to it, by that share.
    ux, uy = track[VX] - twist.v * cosine, track[VY] - twist.v * sine
    numbers = (
        cosine * dx + sine * dy,
        cosine * dy - sine * dx,
        cosine * track[VX] + sine * track[VY],
        cosine * track[VY] - sine * track[VX],
        sqrt(2.0 * P.pp + scale * scale * (dx * dx + dy * dy)),
        sqrt(2.0 * P.vv + scale * scale * (ux * ux + uy * uy)),
        track[SIZE],
        1.0 if track[STATE] == MOVES else 0.5,
    )
    low, high = TRACK_BOUNDS
    for k in range(len(low)):
        seen[place * len(low) + k] = min(max(numbers[k], low[k]), high[k])


@kernel
def look(memory: TrackerMemory, now: float, pose: Pose, twist: Command, scale: float) -> None:
    """Write the nearest tracks into ``memory.seen``.

    Args:
        memory: The tracker.
        now: Present time, s.
        pose: The odometry's pose.
        twist: The robot's twist.
        scale: Standard deviation of the share by which all ranges may be too long.
    """
    tracks, seen, nearest = memory.tracks, memory.seen, -1.0
    for k in range(len(seen)):
        seen[k] = 0.0
    for place in range(NEAREST):
        least, found = math.inf, -1
        for k in range(len(tracks)):
            dx, dy = tracks[k, PX] - pose.x, tracks[k, PY] - pose.y
            far = dx * dx + dy * dy
            if tracks[k, STATE] > NONE and now - tracks[k, TIME] <= FRESH and nearest < far < least:
                least, found = far, k
        if found < 0:
            break
        _write(seen, place, tracks[found], now, pose, twist, scale)
        nearest = least
