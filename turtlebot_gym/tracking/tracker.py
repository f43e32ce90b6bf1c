"""The tracker: what it remembers, its steps when odometry or a scan arrives, and the tracks, also as a message has them.

A track of a body that moves is a Kalman filter with constant velocity and white acceleration. Both coordinates have the same
covariance, three numbers: the variance of a body's place is alike in all directions. What all ranges have in common, the
share by which a LiDAR measures too long, is added where tracks are read.

References:
    Bar-Shalom, Li, Kirubarajan, *Estimation with Applications to Tracking and Navigation* (2001), section 6.2: the model.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.kernel import kernel, sqrt
from turtlebot_gym.localization.points import remember, rest
from turtlebot_gym.models.angles import sincos, wrap
from turtlebot_gym.observations import NEAREST, TRACK_BOUNDS, TRACKS
from turtlebot_gym.tracking import bodies as found
from turtlebot_gym.tracking.bodies import AT, COLUMNS, DEPTH, MOST_BODIES, MOVED, RADIUS, TAKEN, UX, UY, VARIANCE, WHOLE, X, Y
from turtlebot_gym.tracking.sweep import BINS, EVERY, HEAD, NUMBER, PAST, Sweep, keep_scan
from turtlebot_gym.values import Command, Pose

TAIL = 4  # share of a revolution that a body may cover, its inverse
_TURNED, _SLOT, _KEPT = range(3)
CAPACITY, FIELDS = 12, 14  # most tracks, and how many numbers each has
STATE, TIME, PX, PY, VX, VY, PP, PV, VV, SIZE, SCORE, SEEN, BEGAN_X, BEGAN_Y = range(FIELDS)
"""Columns of tracks: `NONE`, `TENTATIVE` or `MOVES`; time, s; position and velocity, m and m/s; their variances and covariance;
mean radius, m; evidence; time at which it last was where it had been free, s; and the place where it began, m."""
NONE, TENTATIVE, MOVES = 0.0, 1.0, 2.0
ACCELERATION = 0.5  # power spectral density of the acceleration of each coordinate, m^2/s^3
FIRST_SPEED = 0.8  # standard deviation of each coordinate of a new track's velocity, m/s
GATE, STATIC = 14.0, 4.0
"""Squared distance of a track's body, in standard deviations; added for one that may always have been there."""
CONFIRMED, MOST_SCORE, LEAST_SCORE = 3.0, 6.0, -2.0  # evidence from which a track counts, the most, the least of a fast one
PART, DOUBT = 0.5, 0.5
"""Evidence of a body that moved, of which a part was hidden, instead of 1; and against one that may always have been there."""
NARROW, CONFIRMED_NARROW = 0.1, 5.0  # radius below which a track may be a chair's leg, m, and the evidence that it needs then
APART = 0.4  # least distance of a new track from others, m: nearer bodies are a person's legs
SLOW, WAY = 0.2, 0.25  # least speed of a track that begins to count, m/s, and least distance from where it began, m
RESIZED, SIZES = 0.03, 0.1  # most by which a scan changes the mean radius, m, and its share
FORGOTTEN, UNTRIED, FRESH, STANDS = 1.0, 0.5, 0.5, 8.0
"""Times without a body after which a track ends, ends if it does not count yet, and is not reported; and without motion, s."""
POINT_FIELDS = ("x", "y", "vx", "vy", "position_deviation", "velocity_deviation", "radius", "certainty", "z")
"""Fields of a track as a point: the numbers of the term "tracks", and a height of zero, without which viewers show nothing."""
FLOAT32 = 7  # type of each field, as in ``sensor_msgs/PointField``


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
    """Shape (`CAPACITY`, `FIELDS`), see `STATE`."""
    clock: Any
    """Shape (3,): sum of the odometry's turns, rad; next row of ``past``; and time of the newest, s."""
    seen: Any
    """Shape (`NEAREST` * 8,), float32: the numbers of the term `observations.TRACKS`."""


def make_memory(number: int, *, beams: int, poses: int) -> TrackerMemory:
    """Return empty memories of some robots, for so many beams of a scan, and poses of the odometry, see `poses_for`."""
    shapes = (poses, 4), (PAST, HEAD + 4 * poses + beams), (beams // TAIL,), (BINS,), (MOST_BODIES, COLUMNS), (CAPACITY, FIELDS)
    seen = np.zeros((number, NEAREST * len(TRACK_BOUNDS[0])), np.float32)
    return TrackerMemory(*(np.zeros((number, *shape)) for shape in (*shapes, (3,))), seen=seen)


def poses_for(revolution: float, dt: float) -> int:
    """Return how many poses, ``dt`` apart, cover a revolution and the tail of the one before; s."""
    return math.ceil((1.0 + 1.0 / TAIL) * revolution / dt - 1e-9) + 2


@kernel
def memory_at(memories: TrackerMemory, index: int) -> TrackerMemory:
    """Return the memory of one robot of many, as views."""
    return TrackerMemory(*[part[index] for part in memories])


@kernel
def begin(memory: TrackerMemory, time: float, pose: Pose) -> None:
    """Begin at rest, with nothing seen; time in s, pose of the odometry."""
    rest(memory.trail, time, pose)
    memory.past[:, NUMBER] = 0.0
    memory.tail.fill(math.nan)
    memory.returns.fill(0.0)
    memory.tracks[:, STATE] = NONE
    memory.clock[_TURNED], memory.clock[_SLOT], memory.clock[_KEPT] = 0.0, 0.0, -math.inf
    memory.seen.fill(0.0)


@kernel
def on_odometry(memory: TrackerMemory, time: float, pose: Pose) -> None:
    """Take a pose of the odometry, later than those before; s."""
    memory.clock[_TURNED] += abs(wrap(pose.theta - memory.trail[0, 3]))
    remember(memory.trail, time, pose)


@kernel
def predicted(track: Any, dt: float) -> tuple[float, float, float]:
    """Return variance of position, covariance and variance of velocity, of each coordinate of a track after a time, s."""
    pp, pv, vv = track[PP], track[PV], track[VV]
    q = ACCELERATION * dt
    return pp + dt * (2.0 * pv + dt * (vv + q / 3.0)), pv + dt * (vv + 0.5 * q), vv + q


@kernel
def _distance(track: Any, body: Any) -> float:
    """Return by how much a body differs from a track: squared, in standard deviations."""
    dt = body[AT] - track[TIME]
    if track[STATE] == NONE or body[TAKEN] > 0.0 or dt <= 0.0:
        return math.inf
    dx, dy = body[X] - track[PX] - dt * track[VX], body[Y] - track[PY] - dt * track[VY]
    far = (dx * dx + dy * dy) / (predicted(track, dt)[0] + body[VARIANCE])
    return far if body[MOVED] > 0.0 else far + STATIC


@kernel
def _evidence(body: Any) -> float:
    return -DOUBT if body[MOVED] == 0.0 else 1.0 if body[WHOLE] > 0.0 else PART


@kernel
def _is_fast(track: Any) -> bool:
    return bool(track[VX] * track[VX] + track[VY] * track[VY] >= SLOW * SLOW)


@kernel
def _update(track: Any, body: Any) -> None:
    """Condition a track on a body.

    Only its front is seen: its middle is as far behind as the track's radius says, and a body that is wider or narrower may
    be another one in part.
    """
    dt, wider = body[AT] - track[TIME], body[RADIUS] - track[SIZE] if body[WHOLE] > 0.0 else 0.0
    (pp, pv, vv), R = predicted(track, dt), body[VARIANCE] + wider * wider
    x, y = track[PX] + dt * track[VX], track[PY] + dt * track[VY]
    track[SIZE] += max(min(SIZES * wider, RESIZED), -RESIZED)
    back = DEPTH * (wider - SIZES * wider)
    dx, dy, S = body[X] - back * body[UX] - x, body[Y] - back * body[UY] - y, pp + R
    k, j = pp / S, pv / S
    track[TIME], track[PX], track[PY] = body[AT], x + k * dx, y + k * dy
    track[VX], track[VY] = track[VX] + j * dx, track[VY] + j * dy
    track[PP], track[PV], track[VV] = k * R, j * R, vv - j * pv
    track[SCORE] = min(track[SCORE] + _evidence(body), MOST_SCORE)
    track[SEEN] = body[AT] if body[MOVED] > 0.0 else track[SEEN]
    needed = CONFIRMED if track[SIZE] >= NARROW else CONFIRMED_NARROW
    way_x, way_y = track[PX] - track[BEGAN_X], track[PY] - track[BEGAN_Y]
    walks = _is_fast(track) and way_x * way_x + way_y * way_y >= WAY * WAY
    track[STATE] = MOVES if track[SCORE] >= needed and walks else track[STATE]
    body[TAKEN] = 1.0


@kernel
def _begin(tracks: Any, body: Any) -> None:
    """Begin a track at a body in the first free row, unless there is none, or another track is too near."""
    free = -1
    for k in range(len(tracks) - 1, -1, -1):
        track = tracks[k]
        dt = body[AT] - track[TIME]
        dx, dy = body[X] - track[PX] - dt * track[VX], body[Y] - track[PY] - dt * track[VY]
        if track[STATE] == NONE:
            free = k
        elif dx * dx + dy * dy < APART * APART:
            return
    if free >= 0:
        track = tracks[free]
        track[STATE], track[TIME], track[SEEN] = TENTATIVE, body[AT], body[AT]
        track[PX], track[PY], track[BEGAN_X], track[BEGAN_Y] = body[X], body[Y], body[X], body[Y]
        track[VX], track[VY], track[PP], track[PV], track[VV] = 0.0, 0.0, body[VARIANCE], 0.0, FIRST_SPEED * FIRST_SPEED
        track[SIZE], track[SCORE] = body[RADIUS], _evidence(body)


@kernel
def follow(tracks: Any, bodies: Any, count: int, now: float) -> None:
    """Update, begin and end tracks by the bodies of a scan, the nearest two first; ``now`` is the time of its last beam, s."""
    while True:
        best, track_of, body_of = GATE, -1, -1
        for k in range(len(tracks)):
            for b in range(count if tracks[k, STATE] > NONE else 0):
                far = _distance(tracks[k], bodies[b])
                if far < best:
                    best, track_of, body_of = far, k, b
        if track_of < 0:
            break
        _update(tracks[track_of], bodies[body_of])
    for k in range(len(tracks)):
        track = tracks[k]
        lasts = FORGOTTEN if track[STATE] == MOVES else UNTRIED
        is_doubtful = track[SCORE] <= 0.0 if track[STATE] == TENTATIVE else track[SCORE] <= LEAST_SCORE and _is_fast(track)
        if now - track[TIME] > lasts or now - track[SEEN] > STANDS or is_doubtful:
            track[STATE] = NONE
    for b in range(count):
        if bodies[b, TAKEN] == 0.0 and bodies[b, MOVED] > 0.0:
            _begin(tracks, bodies[b])


@kernel
def on_scan(memory: TrackerMemory, ranges: Any, sweep: Sweep) -> None:
    """Update the tracks by the ranges of a scan, m; infinite without a return, NaN where a beam is missing.

    The odometry must reach from its first beam to the last.
    """
    past, returns, bodies, trail, clock = memory.past, memory.returns, memory.bodies, memory.trail, memory.clock
    count = found.find_bodies(ranges, memory.tail, returns, sweep, trail, bodies)
    found.mark_moved(bodies, count, past, returns, sweep, trail, clock[_TURNED])
    follow(memory.tracks, bodies, count, sweep.last)
    if sweep.last - clock[_KEPT] >= EVERY - 1e-6:
        keep_scan(past[int(clock[_SLOT])], ranges, sweep, trail, clock[_TURNED])
        clock[_SLOT], clock[_KEPT] = (clock[_SLOT] + 1.0) % PAST, sweep.last


@kernel
def _write(seen: Any, place: int, track: Any, now: float, pose: Pose, twist: Command, scale: float) -> None:
    """Write the numbers of a track."""
    dt, (sine, cosine) = now - track[TIME], sincos(pose.theta)
    pp, _, vv = predicted(track, dt)
    dx, dy = track[PX] + dt * track[VX] - pose.x, track[PY] + dt * track[VY] - pose.y
    # Ranges too long by a share lengthen way and relative velocity by it; ``scale`` is its standard deviation.
    ux, uy = track[VX] - twist.v * cosine, track[VY] - twist.v * sine
    numbers = (
        cosine * dx + sine * dy,
        cosine * dy - sine * dx,
        cosine * track[VX] + sine * track[VY],
        cosine * track[VY] - sine * track[VX],
        sqrt(2.0 * pp + scale * scale * (dx * dx + dy * dy)),
        sqrt(2.0 * vv + scale * scale * (ux * ux + uy * uy)),
        track[SIZE],
        1.0 if track[STATE] == MOVES else 0.5,
    )
    low, high = TRACK_BOUNDS
    for k in range(len(low)):
        seen[place * len(low) + k] = min(max(numbers[k], low[k]), high[k])


@kernel
def look(tracks: Any, seen: Any, now: float, pose: Pose, twist: Command, scale: float) -> None:
    """Write the nearest tracks as the term `observations.TRACKS` has them, at a time, s, and the odometry's pose and twist."""
    nearest = -1.0
    seen.fill(0.0)
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


def tracks_of(message: Any) -> NDArray[np.float64]:
    """Return the tracks in a ``sensor_msgs/PointCloud2``, shape (`NEAREST`, 8), see `observations.TRACKS`.

    A ``ValueError`` refuses anything but `NEAREST` points with the fields `POINT_FIELDS` of finite numbers.
    """
    fields = [(field.name, field.offset, field.datatype, field.count) for field in message.fields]
    expected = [(name, 4 * at, FLOAT32, 1) for at, name in enumerate(POINT_FIELDS)]
    size = NEAREST * 4 * len(POINT_FIELDS)
    if fields != expected or message.is_bigendian or len(message.data) != size:
        raise ValueError(f"tracks must be {NEAREST} points of the fields {', '.join(POINT_FIELDS)} in float32")
    rows = np.frombuffer(bytes(message.data), "<f4").reshape(NEAREST, -1)[:, :-1]
    return np.reshape(TRACKS.read(rows.ravel()), rows.shape)
