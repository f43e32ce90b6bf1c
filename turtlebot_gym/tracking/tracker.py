"""The tracker: what it remembers, and its steps when odometry or a scan arrives; and the tracks as a message has them."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.kernel import kernel
from turtlebot_gym.localization.points import remember, rest
from turtlebot_gym.models.angles import wrap
from turtlebot_gym.observations import NEAREST, TRACK_BOUNDS, TRACKS
from turtlebot_gym.tracking.bodies import COLUMNS, MOST_BODIES, find_bodies, mark_moved
from turtlebot_gym.tracking.sweep import BINS, EVERY, HEAD, NUMBER, PAST, Sweep, keep_scan
from turtlebot_gym.tracking.tracks import CAPACITY, FIELDS, NONE, STATE, follow
from turtlebot_gym.values import Pose

TAIL = 4  # share of a revolution that a body may cover, its inverse
_TURNED, _SLOT, _KEPT = range(3)
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
    """Shape (`CAPACITY`, `FIELDS`), see `tracks`."""
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
def on_scan(memory: TrackerMemory, ranges: Any, sweep: Sweep) -> None:
    """Update the tracks by the ranges of a scan, m; infinite without a return, NaN where a beam is missing.

    The odometry must reach from its first beam to the last.
    """
    past, returns, bodies, trail, clock = memory.past, memory.returns, memory.bodies, memory.trail, memory.clock
    count = find_bodies(ranges, memory.tail, returns, sweep, trail, bodies)
    mark_moved(bodies, count, past, returns, sweep, trail, clock[_TURNED])
    follow(memory.tracks, bodies, count, sweep.last)
    if sweep.last - clock[_KEPT] >= EVERY - 1e-6:
        keep_scan(past[int(clock[_SLOT])], ranges, sweep, trail, clock[_TURNED])
        clock[_SLOT], clock[_KEPT] = (clock[_SLOT] + 1.0) % PAST, sweep.last


def tracks_of(message: Any) -> NDArray[np.float64]:
    """Return the tracks in a ``sensor_msgs/PointCloud2``, shape (`NEAREST`, 8), see `observations.TRACKS`.

    Raises:
        ValueError: If there are not `NEAREST` points with the fields `POINT_FIELDS`, or a number is not finite.
    """
    fields = [(field.name, field.offset, field.datatype, field.count) for field in message.fields]
    expected = [(name, 4 * at, FLOAT32, 1) for at, name in enumerate(POINT_FIELDS)]
    size = NEAREST * 4 * len(POINT_FIELDS)
    if fields != expected or message.is_bigendian or len(message.data) != size:
        raise ValueError(f"tracks must be {NEAREST} points of the fields {', '.join(POINT_FIELDS)} in float32")
    rows = np.frombuffer(bytes(message.data), "<f4").reshape(NEAREST, -1)[:, :-1]
    return np.reshape(TRACKS.read(rows.ravel()), rows.shape)
