"""Tracks of bodies that move: a Kalman filter for each, with constant velocity and white acceleration.

Both coordinates have the same covariance, three numbers: the variance of a body's place is alike in all directions. What
all ranges have in common, the share by which a LiDAR measures too long, is added where tracks are read.

References:
    Bar-Shalom, Li, Kirubarajan, *Estimation with Applications to Tracking and Navigation* (2001), section 6.2: the model.
"""

from __future__ import annotations

import math
from typing import Any

from turtlebot_gym.kernel import kernel, sqrt
from turtlebot_gym.models.angles import sincos
from turtlebot_gym.observations import NEAREST, TRACK_BOUNDS
from turtlebot_gym.tracking.bodies import AT, DEPTH, MOVED, RADIUS, TAKEN, UX, UY, VARIANCE, WHOLE, X, Y
from turtlebot_gym.values import Command, Pose

CAPACITY, FIELDS = 12, 14  # most tracks, and how many numbers each has
STATE, TIME, PX, PY, VX, VY, PP, PV, VV, SIZE, SCORE, SEEN, BEGAN_X, BEGAN_Y = range(FIELDS)
"""Columns of tracks: `NONE`, `TENTATIVE` or `MOVES`; time, s; position and velocity, m and m/s; their variances and covariance;
mean radius, m; evidence; time at which it last was where it had been free, s; and the place where it began, m."""
NONE, TENTATIVE, MOVES = 0.0, 1.0, 2.0
ACCELERATION = 0.5  # power spectral density of the acceleration of each coordinate, m^2/s^3
FIRST_SPEED = 0.8  # standard deviation of each coordinate of a new track's velocity, m/s
GATE, STATIC = 14.0, 4.0
"""Squared distance in standard deviations up to which a body may be a track's; added to that of a body that may always have
been there."""
CONFIRMED, MOST_SCORE, LEAST_SCORE = 3.0, 6.0, -2.0
"""Evidence from which on a track counts, the most, and the least of one that is fast."""
PART, DOUBT = 0.5, 0.5
"""Evidence of a body that moved, of which a part was hidden, instead of 1; and against one that may always have been there."""
NARROW, CONFIRMED_NARROW = 0.1, 5.0
"""Mean radius below which a track may be the leg of a chair, m, and the evidence from which on it counts then."""
APART = 0.4  # least distance of a new track from others, m: nearer bodies are a person's legs
SLOW, WAY = 0.2, 0.25  # least speed of a track that begins to count, m/s, and least distance from where it began, m
RESIZED, SIZES = 0.03, 0.1  # most by which a scan changes the mean radius, m, and its share
FORGOTTEN, UNTRIED, FRESH, STANDS = 1.0, 0.5, 0.5, 8.0
"""Times after which a track ends without a body, and if it does not count yet; without a body, after which it is not reported;
and after which it ends without sign of motion; s."""


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
    """Return the evidence of a body that what it belongs to moves."""
    return -DOUBT if body[MOVED] == 0.0 else 1.0 if body[WHOLE] > 0.0 else PART


@kernel
def _is_fast(track: Any) -> bool:
    """Return whether a track is too fast for something that stands."""
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
def _write(seen: Any, place: int, track: Any, now: float, pose: Pose, twist: Command, scale: float) -> None:
    """Write the numbers of a track."""
    dt, (sine, cosine) = now - track[TIME], sincos(pose.theta)
    pp, _, vv = predicted(track, dt)
    dx, dy = track[PX] + dt * track[VX] - pose.x, track[PY] + dt * track[VY] - pose.y
    # Ranges that are too long by a share lengthen the way from the robot, and the velocity relative to it, by that share.
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
    """Write the nearest tracks as the term `observations.TRACKS` lists them, at a time, s, and the odometry's pose and twist.

    ``scale`` is the standard deviation of the share by which all ranges may be too long.
    """
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
