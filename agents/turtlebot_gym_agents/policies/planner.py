"""A policy with memory: VFH+ along the cheapest path over a grid of what it has seen."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from turtlebot_gym.config import FINITE
from turtlebot_gym.observations import ROOM, Observation
from turtlebot_gym.rooms.lidar import SECTORS
from turtlebot_gym_agents.policies.cheapest_way import FREE
from turtlebot_gym_agents.policies.geometric import NonNegative, Positive
from turtlebot_gym_agents.policies.grid import CELL, SIDE, advance, shifted
from turtlebot_gym_agents.policies.policy import numbers_of
from turtlebot_gym_agents.policies.reactive import VectorFieldHistogramPolicy
from turtlebot_gym_agents.policies.sight import Sight, SightMotion, arc, look

_BLOCKED = 400
"""Weight of a cell in which the robot would touch something; finite, since by the evidence it may already be in one."""
_LEAP = 0.5
"""A place this far from the expected one means another goal, m: no robot drives as far in a step."""
_PATIENCE, _LEFT = 4.0, 0.3
"""A robot is stuck if for this time, s, it has stayed within this distance of a place, m ..."""
_PAUSE, _STUCK = 1.2, 0.2
"""... or if its speed, averaged over this time, s, is below this share of the limit."""
_NEAREST = 0.3
"""Least distance of the point to steer to, m: VFH+ ignores obstacles behind it."""


class _Memory(NamedTuple):
    """What each robot remembers; places are complex numbers in the frame of its grid, m, and directions are of length 1."""

    grid: NDArray[np.int8]
    """Evidence for obstacles, shape (n, `SIDE`, `SIDE`)."""
    failed_attempts: NDArray[np.int8]
    """Number of failed attempts to enter a cell, shape (n, `SIDE`, `SIDE`)."""
    ways: NDArray[np.int8]
    """Whether the last path led through a cell or past it, shape (n, `SIDE`, `SIDE`)."""
    since: NDArray[np.complex128]
    """Place within `_LEFT` of which each robot has stayed, shape (n,) ..."""
    idle: NDArray[np.int64]
    """... for this number of steps, shape (n,)."""
    pace: NDArray[np.float64]
    """Mean speed over `_PAUSE`, as a share of the limit, shape (n,)."""
    shares: NDArray[np.float64]
    """The newest scan, shape (n, `SECTORS`)."""
    frame: NDArray[np.complex128]
    """Place and direction of the goal's frame, shape (n, 2)."""
    pose: NDArray[np.complex128]
    """Place and heading that are expected next, shape (n, 2): a grid begins where its robot is."""
    target: NDArray[np.complex128]
    """Point to steer to, shape (n,); NaN for the goal."""
    steps: NDArray[np.int64]
    """Number of steps, shape (n,)."""


_NEW: Any = tuple(
    np.asarray(value)
    for value in (*(np.int8(0),) * 3, complex(np.inf), 0, 1.0, 0.0, (np.inf, 1.0 + 0j), (0.0, 1.0 + 0j), complex(np.nan), 0)
)
"""What a robot remembers at first."""
_SHAPES: Any = (*((SIDE, SIDE),) * 3, (), (), (), (SECTORS,), (2,), (2,), (), ())


@dataclass(eq=False, kw_only=True)
class PlannerPolicy(VectorFieldHistogramPolicy):
    """Remember what was seen, and steer by VFH+ to a point of the cheapest path to the goal.

    Where all directions lead into the margin, only the robot's radius counts. The grid of 16 m moves with the robot. The point
    is the farthest within ``preview`` to which a straight line costs little more than the path. Moving obstacles stay in the
    grid until later beams pass. The defaults are the best of 40 tries in the world "office", except for ``margin``, which is
    the safety layer's, ``lag``, ``doubt``, ``habit`` and ``period``.
    """

    blocked: Positive = 0.122
    """Distance from an occupied cell within which the robot would touch it, m."""
    berth: Positive = 0.123
    """Further distance over which cells cost more, m."""
    fear: NonNegative = 0.68
    """Extra cost of a cell at the least distance, as a multiple of a free one's."""
    preview: Positive = 4.0
    """Length of the path on which the point lies, m."""
    detour: Positive = 1.36
    """Allowed cost of a straight line to the point, as a multiple of the path's."""
    doubt: NonNegative = 0.5
    """Extra cost of a cell that was never seen, as a multiple of a free one's."""
    habit: NonNegative = 0.25
    """Extra cost of a cell off the last path, as a multiple of its own, so that a robot does not turn round with every scan."""
    period: Positive = 0.3
    """Time between plans, s."""
    ahead: Annotated[float, FINITE] = 0.0
    last: Annotated[float, FINITE] = 0.3
    margin: NonNegative = 0.02
    lag: NonNegative = 0.08
    sight: Positive = 0.54
    gain: Positive = 4.4
    focus: NonNegative = 2.3
    caution: Positive = 0.63

    def __post_init__(self) -> None:
        super().__post_init__()
        wide = min(int(np.ceil((self.blocked + self.berth) / CELL)), 8)
        at = CELL * np.arange(-wide, wide + 1)
        away = np.hypot(at[:, None], at)
        near = np.round(FREE * self.fear * np.clip(1.0 - (away - self.blocked) / self.berth, 0.0, 1.0))
        self._unknown = round(FREE * (1.0 + self.doubt))
        self._stamp = np.where(away < self.blocked, _BLOCKED, FREE + near).astype(np.int32)
        self._memory, self._motion = self._forgotten(0), SightMotion(self.dt, self.lag)
        self.stuck: NDArray[np.bool_] = np.zeros((), np.bool_)
        """Whether each robot makes no progress; determined when it plans."""

    @staticmethod
    def _forgotten(count: int) -> _Memory:
        return _Memory._make(np.full((count, *shape), new, new.dtype) for shape, new in zip(_SHAPES, _NEW, strict=True))

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Forget everything where an episode begins."""
        super().reset(mask)
        rows = np.ravel(mask)
        self._motion.reset(rows)
        if len(rows) != len(self._memory.steps):
            self._memory = self._forgotten(len(rows))
        for part, new in zip(self._memory, _NEW, strict=True):
            part[rows] = new

    def _look(self, observations: ArrayLike) -> Sight:
        """Return a policy's view, with the point to steer to instead of the goal."""
        seen = numbers_of(observations, ROOM).astype(np.float64)
        rows = seen.reshape(-1, seen.shape[-1])
        if len(rows) != len(self._memory.steps):
            self._memory, self._motion = self._forgotten(len(rows)), SightMotion(self.dt, self.lag)
        self._motion.note(rows[:, 5] * self._robot.max_linear, rows[:, 6] * self._robot.max_angular)
        since = self._motion.since(rows[:, -1])
        shaped: Any = (
            part.reshape(seen.shape[:-1] + part.shape[1:]) for part in look(rows, self._robot, self.dt, self.lag, since=since)
        )
        to = Sight(*shaped)
        point = self._point(rows, *since).reshape(to.goal.shape)
        self.stuck = self.stuck.reshape(to.goal.shape)
        away = np.abs(point)
        farther = point * (np.maximum(away, _NEAREST) / np.maximum(away, 1e-9))
        return to._replace(goal=np.where(np.isnan(away), to.goal, farther))

    def _blocked(self, to: Sight, margin: float) -> NDArray[np.bool_]:
        """Return which candidates lead nearer to an obstacle than a margin, or than the robot's radius where all do."""
        blocked = super()._blocked(to, margin)
        return np.where(blocked.all(axis=-1, keepdims=True), super()._blocked(to, 0.0), blocked)

    def _point(
        self, rows: NDArray[np.float64], moved: NDArray[np.complex128], turned: NDArray[np.complex128]
    ) -> NDArray[np.complex128]:
        """Return the point to steer to when the next command acts, in the body frame, shape (n,); NaN for the goal.

        ``moved`` and ``turned`` are the current place and heading in the frame of the pose when the beams were measured.
        """
        memory = self._memory
        o: Any = Observation(*rows[:, : len(Observation._fields)].T)
        heading = o.cos_turn - 1j * o.sin_turn  # in the goal's frame
        place = -o.distance * (o.cos_bearing + 1j * o.sin_bearing) * heading
        self._anchor(place, heading)
        place, heading = memory.frame[:, 0] + memory.frame[:, 1] * place, memory.frame[:, 1] * heading
        v, omega = o.v * self._robot.max_linear, o.omega * self._robot.max_angular
        scan_heading = heading * np.conj(turned)
        scan_place = place - scan_heading * moved
        scans = np.stack([scan_place.real, scan_place.imag, np.angle(scan_heading)], axis=-1)
        shares = np.ascontiguousarray(rows[:, len(Observation._fields) : -1])  # one row would be another type: compiled twice
        due = memory.steps % max(round(self.period / self.dt), 1) == 0
        left = np.abs(place - memory.since) > _LEFT
        memory.since[left], memory.idle[:] = place[left], np.where(left, 0, memory.idle + 1)
        memory.pace[:] += (np.abs(o.v) - memory.pace) * self.dt / _PAUSE
        self.stuck = stuck = due & ((memory.idle * self.dt > _PATIENCE) | (memory.pace < _STUCK))
        goals, targets = _pairs(memory.frame[:, 0]), _pairs(memory.target)
        reaches = CELL / np.maximum(0.1 * np.abs(omega), 0.01)  # farther places are blurred by the turn
        new = (shares != memory.shares).any(axis=-1)
        seen, rules = memory[:3], (self._stamp, self.preview, self.detour, self._unknown, round(16.0 * self.habit))
        advance(*seen, scans, reaches, shares, new, _pairs(place), goals, due, stuck, *rules, targets)
        memory.idle[stuck], memory.pace[stuck] = 0, 1.0
        moved, turned = arc(v, omega, self.dt)
        memory.target[:], memory.shares[:] = targets @ (1.0, 1j), shares
        memory.pose[:, 0], memory.pose[:, 1] = place + heading * moved, heading * turned
        memory.steps[:] += 1
        return (memory.target - memory.pose[:, 0]) * np.conj(memory.pose[:, 1])

    def _anchor(self, place: NDArray[np.complex128], heading: NDArray[np.complex128]) -> None:
        """Keep the grid in place when the goal changes, and the robot near its middle; both arguments are in the goal's
        frame.
        """
        memory = self._memory
        frame, (expected, direction) = memory.frame, memory.pose.T
        leap = ~(np.abs(frame[:, 0] + frame[:, 1] * place - expected) < _LEAP)
        # A turn of the frame by more than 1 rad is another goal, too.
        leap |= (frame[:, 1] * heading * np.conj(direction)).real < np.cos(1.0)
        frame[leap, 1] = (direction * np.conj(heading))[leap]
        frame[leap, 0] = (expected - frame[:, 1] * place)[leap]
        for n in np.flatnonzero(np.maximum(np.abs(expected.real), np.abs(expected.imag)) > 0.25 * SIDE * CELL):
            rows, columns = round(expected[n].imag / CELL), round(expected[n].real / CELL)
            for part in (memory.grid, memory.failed_attempts, memory.ways):
                part[n] = shifted(part[n], rows, columns)
            for part in (frame[n, :1], memory.pose[n, :1], memory.target[n : n + 1], memory.since[n : n + 1]):
                part -= CELL * (columns + 1j * rows)


def _pairs(points: NDArray[np.complex128]) -> NDArray[Any]:
    return np.stack([points.real, points.imag], axis=-1)
