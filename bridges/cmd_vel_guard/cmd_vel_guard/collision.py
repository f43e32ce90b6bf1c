"""Limits on commands by LiDAR measurements: the mathematics of the guard's collision monitor.

Frames: x ahead, y to the left, the origin in the middle of the wheels' axle, about which the
robot turns.

The robot is a circle around ``center_x``, which may lie behind the axle. Each point that the LiDAR saw is an obstacle. A
constant command moves the circle along an arc, on which the time until it touches a point has a closed form, see
`times_to_contact`.

**Two zones.** Around each point is the stop zone: the robot's radius, the margin, and the error of the point's range. Outside
it, a command is scaled down, on the same arc, to a speed at which the stop zone is at least ``time`` away. Inside it, motion
towards the point is stopped, and motion away from it is limited to ``escape_speed``.

**Gaps.** Where a scan says nothing, see `beams.gaps_of`, space is solid from a range on. In a narrow gap that is the shorter of
the ranges beside it: whatever is as wide as the robot shows at an edge of the gap before the robot must brake, so only thinner
things can hide there, as they can between two beams. A wider gap, also between two beams, is unknown: it is solid from the stop
zone on, but for the ``room`` that `monitor` leaves, so the robot enters it slowly and then stops. A gap behind does not hold up
a robot that drives ahead. If the missing beams had returned any ranges beyond where a gap is taken for solid, no command would
pass more slowly.

**Why it stops in time.** At a speed ``s`` the stop zone is at least ``d >= s time`` away. A command is held for one period of
the guard, ``h``, before it is judged again, and then the wheels brake with a deceleration ``a``. That takes ``s h + s^2 / (2
a)``, which is at most ``d`` if ``h + s / (2 a) <= time``: with 0.04 s, 0.3 m/s and ``time`` = 0.5 s, its least value, for
decelerations from 0.33 m/s^2. The points include pending commands and the motion since the scan, see `monitor`. With a constant
command the speed falls with the distance, and the robot comes to rest before the stop zone.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmd_vel_guard.values import STOP, Command, Mount
from turtlebot_gym.beams import Beams, beams_of, gaps_of

GRAIN = 0.02
"""Distance between the points that stand for the border of a solid gap, m."""
COVER = 0.6 * GRAIN
"""Width by which the stop zones of such points are wider, m: so they hold those of all points between them."""
SLOWEST = 0.01
"""Speed below which a robot that must slow down stops instead, m/s; firmware truncates commands to multiples of it."""
MOST = 2000
"""Most beams of a gap that are told apart."""
_STRAIGHT = 1e-9
"""Turning rate below which an arc is a straight line, rad/s."""


class Footprint(NamedTuple):
    """The robot's footprint, its radius and its centre ahead of the axle, m, and the mount of its LiDAR."""

    radius: float
    center_x: float
    scan: Mount


class Limits(NamedTuple):
    """What the robot keeps from points: ``collision_margin``, ``scan_error``, ``collision_time`` and ``escape_speed``."""

    margin: float
    error: float
    time: float
    escape_speed: float


class RawScan(NamedTuple):
    """The numbers of a LaserScan, unprocessed."""

    ranges: Sequence[float]
    angle_min: float
    angle_increment: float
    range_min: float
    range_max: float
    frame: str


class View(NamedTuple):
    """What a scan says: points seen, with the borders of narrow gaps, and the unknown's, with those of wide ones.

    Of shape (3, n): x and y in the robot's frame, and the radius of the stop zone around it; m.
    """

    seen: NDArray[np.float64]
    unknown: NDArray[np.float64]


def read(scan: RawScan, body: Footprint, limits: Limits) -> Beams:
    """Return the beams of a scan, or raise `ValueError` with one line if it cannot be read, or is of another frame.

    A LiDAR reports that nothing returned for objects nearer than its ``range_min`` too, so that distance must lie inside the
    stop zone: on a Burger, 0.12 m of an LDS-01 do, since its stop zone begins at 0.155 m.
    """
    mount = body.scan
    if mount.frame not in (scan.frame, scan.frame.rsplit("/", 1)[-1]):  # without a configured prefix, any is accepted
        raise ValueError(f"its frame is {scan.frame!r}, not {mount.frame!r}: is the mount that of another LiDAR?")
    beams = beams_of(
        scan.ranges, first=scan.angle_min, increment=scan.angle_increment, range_min=scan.range_min, range_max=scan.range_max
    )
    away = math.hypot(mount.x - body.center_x, mount.y)
    blind = away + scan.range_min * (1.0 - limits.error)
    if scan.range_min > 0.0 and blind > body.radius + limits.margin:
        raise ValueError(
            f"it sees nothing below range_min, {scan.range_min:g} m, so the margin must be at least {blind - body.radius:.3f} m"
        )
    return beams


def view_of(beams: Beams, body: Footprint, limits: Limits, *, reach: float, narrow: float, room: float) -> View:
    """Return what the beams of a scan say.

    Stop zones beyond ``reach`` from the footprint's centre, m, are left out. A gap is narrow up to an angle, rad, see
    `beams.narrow_gap`; before the stop zone of a wider one, ``room`` is free, m.
    """
    away = math.hypot(body.scan.x - body.center_x, body.scan.y)
    returned = np.isfinite(beams.ranges)
    seen = _points(beams.directions[returned], beams.ranges[returned].astype(np.float64), body, limits)
    gaps_there = gaps_of(beams, narrow)
    wide = gaps_there[:, 2] > narrow
    # Where the stop zone, which grows with the range, is out of reach whatever the direction.
    far = (reach + away + body.radius + limits.margin + COVER) / (1.0 - limits.error)
    solid = partial(_solid, spacing=beams.spacing, far=far, body=body, limits=limits)
    fills = [solid(first, last, partial(np.full_like, fill_value=shorter)) for first, last, _, shorter in gaps_there[~wide]]
    borders = [
        solid(first, last, partial(_edge, body=body, limits=limits, room=room)) for first, last, _, _ in gaps_there[wide]
    ]
    near = (places[:, gaps(places, body.center_x) <= reach] for places in (_joined([seen, *fills]), _joined(borders)))
    return View(*near)


def _joined(parts: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    return np.concatenate([np.empty((3, 0)), *parts], axis=1)


def _points(angles: NDArray[np.float64], ranges: NDArray[np.float64], body: Footprint, limits: Limits) -> NDArray[np.float64]:
    """Return points at ranges in directions of the LiDAR's frame, with their stop zones."""
    mount, angles = body.scan, angles + body.scan.yaw
    radius = body.radius + limits.margin + limits.error * ranges
    return np.stack((mount.x + ranges * np.cos(angles), mount.y + ranges * np.sin(angles), radius))


def _edge(angles: NDArray[np.float64], body: Footprint, limits: Limits, room: float) -> NDArray[np.float64]:
    """Return the ranges in directions of the LiDAR's frame at which the stop zone of a wide gap is ``room`` away."""
    x, y = body.scan.x - body.center_x, body.scan.y
    away = math.hypot(x, y)
    wider = COVER - 0.5 * GRAIN * (1.0 - limits.error)  # of the points just behind the border
    distance = (body.radius + limits.margin + wider + room + limits.error * away) / (1.0 - limits.error)
    across = x * np.cos(angles + body.scan.yaw) + y * np.sin(angles + body.scan.yaw)
    # Where a LiDAR outside the stop zone looks past it, the gap is solid from its nearest place on, or from the LiDAR on.
    return np.maximum(np.sqrt(np.maximum(across * across + distance * distance - away * away, 0.0)) - across, 0.0)


def _solid(
    first: float,
    last: float,
    border: Callable[..., NDArray[np.float64]],
    *,
    spacing: float,
    far: float,
    body: Footprint,
    limits: Limits,
) -> NDArray[np.float64]:
    """Return points for a gap that is solid from a border on: on the border, just behind it, and on both edges.

    Their stop zones hold those of all points in the gap: on the way to one, the border or an edge is crossed, and the error, a
    share of the range, grows more slowly than the range. ``first`` and ``last`` are the directions of the missing beams at its
    ends, rad; nothing counts beyond ``far``, m.
    """
    missing = min(round((last - first) / spacing), MOST)
    at_beams = border(np.linspace(first, last, missing + 1))
    nearest, farthest = float(at_beams.min()), float(at_beams.max())
    if not nearest < far:
        return np.empty((3, 0))
    beams = missing * math.ceil(spacing * farthest / GRAIN)  # the missing ones, and between
    across = np.linspace(first, last, beams + 1)
    ranges = border(across)
    behind = np.arange(1.5 * GRAIN, far - nearest + GRAIN, GRAIN)
    angles = np.concatenate((across, np.full_like(behind, first), np.full_like(behind, last)))
    depths = np.concatenate((ranges + 0.5 * GRAIN, ranges[0] + behind, ranges[-1] + behind))
    inside = _points(angles, depths, body, limits)
    inside[2] += COVER
    return np.concatenate((_points(across, ranges, body, limits), inside), axis=1)


def times_to_contact(points: NDArray[np.float64], command: Command, center_x: float) -> NDArray[np.float64]:
    """Return the time at which a circle on an arc first touches each point; infinite if it never does.

    Seen from the circle's centre, a point ``u`` turns about the centre of the arc. Its squared distance less the squared radius
    is a quadratic in ``T = tan(omega t / 2) / (omega / 2)``::

        a T^2 - 2 h T + A = 0,   A = u u - r^2,   h = u . velocity of the centre,   a = (omega q)(omega g) + A omega^2 / 4

    where ``q`` and ``g`` lead from the arc's centre to the point and to the circle's centre. There is no division by the
    turning rate, so arcs may be arbitrarily straight: with ``omega = 0`` it is the quadratic of a straight line. From inside,
    the time is 0 if the circle's centre comes nearer to the point, else infinite.
    """
    v, omega = command
    x, y, radius = points
    ahead = x - center_x
    outside = ahead * ahead + y * y - radius * radius
    nearing = ahead * v + y * (omega * center_x)
    a = v * (v - omega * y) + omega * x * omega * center_x + 0.25 * omega * omega * outside
    discriminant = nearing * nearing - a * outside
    root, half = np.sqrt(np.maximum(discriminant, 0.0)), 0.5 * abs(omega)
    # The first root, as a quotient whose terms do not cancel; before it comes nearer, the point turns away by half a turn.
    up = np.where(nearing > 0.0, outside, root - nearing)
    down = np.where(nearing > 0.0, nearing + root, -a)
    if half > _STRAIGHT:
        times = np.arctan2(half * up, down) / half
    else:
        with np.errstate(over="ignore"):  # an overflow means never
            times = np.divide(up, down, out=np.full_like(up, np.inf), where=nearing > 0.0)
    times = np.where(discriminant < 0.0, np.inf, times)
    return np.where(outside > 0.0, times, np.where(nearing > 0.0, 0.0, np.inf))


def limited(points: NDArray[np.float64], command: Command, center_x: float, limits: Limits) -> Command:
    """Return a command slowed down on the same arc as obstacles require, shape (3, n), see `View`.

    Turning on the spot does not move a footprint that is round about the axle, so it is always allowed.
    """
    speed = math.hypot(command.v, command.omega * center_x)
    away = gaps(points, center_x)
    near = away <= speed * limits.time  # farther points are reached later, on any arc
    if speed == 0.0 or not near.any():
        return command
    share = min(float(times_to_contact(points[:, near], command, center_x).min()) / limits.time, 1.0)
    if share < 1.0 and share * speed < SLOWEST:
        return STOP
    if away.min() <= 0.0:
        share = min(share, limits.escape_speed / speed)
    return STOP if share == 0.0 else Command(command.v * share, command.omega * share)


def turns_freely(points: NDArray[np.float64], center_x: float, margin: float) -> bool:
    """Return whether all points, shape (3, n), are outside the disc about the axle that the footprint of a turn sweeps."""
    return bool((np.hypot(points[0], points[1]) > points[2] - margin + abs(center_x)).all())


def gaps(points: NDArray[np.float64], center_x: float) -> NDArray[np.float64]:
    """Return the distance of the footprint's centre from each stop zone, m; not positive inside."""
    x, y, radius = points
    return np.hypot(x - center_x, y) - radius
