"""Tracks of bodies that move: a Kalman filter for each, with constant velocity and white acceleration.

Both coordinates have the same covariance, three numbers: the variance of a body's place is alike in all directions. What
all ranges have in common, the share by which a LiDAR measures too long, is added where tracks are read.

References:
    Bar-Shalom, Li, Kirubarajan, *Estimation with Applications to Tracking and Navigation* (2001), section 6.2: the model.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from turtlebot_gym.kernel import kernel
from turtlebot_gym.tracking.bodies import AT, DEPTH, MOVED, RADIUS, TAKEN, UX, UY, VARIANCE, WHOLE, X, Y

CAPACITY, FIELDS = 12, 14
"""Most tracks, and how many numbers each has."""
STATE, TIME, PX, PY, VX, VY, PP, PV, VV, SIZE, SCORE, SEEN, BEGAN_X, BEGAN_Y = range(FIELDS)
"""Columns of tracks: `NONE`, `TENTATIVE` or `MOVES`; time, s; position and velocity, m and m/s; their variances and covariance;
mean radius, m; evidence; time at which it last was where it had been free, s; and the place where it began, m."""
NONE, TENTATIVE, MOVES = 0.0, 1.0, 2.0
ACCELERATION = 0.5
"""Power spectral density of the acceleration of each coordinate, m^2/s^3."""
FIRST_SPEED = 0.8
"""Standard deviation of each coordinate of a new track's velocity, m/s."""
GATE = 14.0
"""Squared distance in standard deviations up to which a body may be a track's."""
STATIC = 4.0
"""Added to that of a body that may always have been there."""
CONFIRMED, MOST_SCORE, LEAST_SCORE = 3.0, 6.0, -2.0
"""Evidence from which on a track counts, the most, and the least of one that is fast; a scan in which the body moved adds one
..."""
PART = 0.5
"""... one in which a part of it was hidden less ..."""
DOUBT = 0.5
"""... and one in which it may always have been there takes some."""
NARROW, CONFIRMED_NARROW = 0.1, 5.0
"""Mean radius below which a track may be the leg of a chair, m, and the evidence from which on it counts then."""
APART = 0.4
"""Least distance of a new track from others, m: nearer bodies are a person's legs."""
SLOW, WAY = 0.2, 0.25
"""Least speed of a track that begins to count, m/s, and least distance from where it began, m."""
RESIZED, SIZES = 0.03, 0.1
"""Most by which a scan changes the mean radius, m, and its share."""
FORGOTTEN, UNTRIED = 1.0, 0.5
"""Time without a body after which a track ends, and one that does not count yet, s ..."""
FRESH = 0.5
"""... up to which it is reported ..."""
STANDS = 8.0
"""... and without sign of motion."""


class Moments(NamedTuple):
    """Variance of a position, covariance with the velocity, variance of the velocity, each of one coordinate."""

    pp: float
    pv: float
    vv: float


@kernel
def predicted(track: Any, dt: float) -> Moments:
    """Return the covariance of a track after some time, s."""
    pp, pv, vv = track[PP], track[PV], track[VV]
    q = ACCELERATION * dt
    return Moments(pp + dt * (2.0 * pv + dt * (vv + q / 3.0)), pv + dt * (vv + 0.5 * q), vv + q)


@kernel
def _distance(track: Any, body: Any) -> float:
    """Return by how much a body differs from a track: squared, in standard deviations."""
    dt = body[AT] - track[TIME]
    if track[STATE] == NONE or body[TAKEN] > 0.0 or dt <= 0.0:
        return math.inf
    dx, dy = body[X] - track[PX] - dt * track[VX], body[Y] - track[PY] - dt * track[VY]
    far = (dx * dx + dy * dy) / (predicted(track, dt).pp + body[VARIANCE])
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
    P, R = predicted(track, dt), body[VARIANCE] + wider * wider
    x, y = track[PX] + dt * track[VX], track[PY] + dt * track[VY]
    track[SIZE] += max(min(SIZES * wider, RESIZED), -RESIZED)
    back = DEPTH * (wider - SIZES * wider)
    dx, dy, S = body[X] - back * body[UX] - x, body[Y] - back * body[UY] - y, P.pp + R
    k, j = P.pp / S, P.pv / S
    track[TIME], track[PX], track[PY] = body[AT], x + k * dx, y + k * dy
    track[VX], track[VY] = track[VX] + j * dx, track[VY] + j * dy
    track[PP], track[PV], track[VV] = k * R, j * R, P.vv - j * P.pv
    track[SCORE] = min(track[SCORE] + _evidence(body), MOST_SCORE)
    track[SEEN] = body[AT] if body[MOVED] > 0.0 else track[SEEN]
    needed = CONFIRMED if track[SIZE] >= NARROW else CONFIRMED_NARROW
    way_x, way_y = track[PX] - track[BEGAN_X], track[PY] - track[BEGAN_Y]
    walks = _is_fast(track) and way_x * way_x + way_y * way_y >= WAY * WAY
    track[STATE] = MOVES if track[SCORE] >= needed and walks else track[STATE]
    body[TAKEN] = 1.0


@kernel
def _begin(tracks: Any, body: Any) -> None:
    """Begin a track at a body in a free row, unless there is none, or another track is too near."""
    for k in range(len(tracks)):
        track = tracks[k]
        dt = body[AT] - track[TIME]
        dx, dy = body[X] - track[PX] - dt * track[VX], body[Y] - track[PY] - dt * track[VY]
        if track[STATE] > NONE and dx * dx + dy * dy < APART * APART:
            return
    for k in range(len(tracks)):
        track = tracks[k]
        if track[STATE] == NONE:
            track[STATE], track[TIME], track[PX], track[PY], track[VX], track[VY] = (
                TENTATIVE,
                body[AT],
                body[X],
                body[Y],
                0.0,
                0.0,
            )
            track[PP], track[PV], track[VV] = body[VARIANCE], 0.0, FIRST_SPEED * FIRST_SPEED
            track[SIZE], track[SCORE], track[SEEN] = body[RADIUS], _evidence(body), body[AT]
            track[BEGAN_X], track[BEGAN_Y] = body[X], body[Y]
            return


@kernel
def follow(tracks: Any, bodies: Any, count: int, now: float) -> None:
    """Update tracks by the bodies of a scan: the nearest two first, until none are near enough; begin and end tracks.

    Args:
        tracks: Shape (`CAPACITY`, `FIELDS`); all zeros at the beginning.
        bodies: See `bodies.find_bodies`.
        count: Their number.
        now: Time of the scan's last beam, s.
    """
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
