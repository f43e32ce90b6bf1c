"""Let the people of rooms walk by ORCA instead of the social force model: people whom no policy has seen.

Some do not see the robot, some stop for it, and in half of the rooms two walk side by side.

References:
    van den Berg, Guy, Lin, Manocha, "Reciprocal n-body collision avoidance" (2011), sections 4 and 5.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.vector import VectorEnv, VectorWrapper
from numpy.typing import NDArray

from half_planes import NEVER, Plane, Reals, dot, least_penetrating, nearest
from turtlebot_gym.rooms.scene import RoomShape
from turtlebot_gym.rooms.walking import STANDS

Flags = NDArray[np.bool_]
PERIOD = 0.1
"""Control period, s."""
AHEAD, WALLS_AHEAD = 2.0, 1.0
"""Times for which people avoid each other and the robot, and walls and boxes, s."""
APART = 0.08
"""Gap that people keep between each other, m."""
ASKEW = 0.02
"""Angle by which people prefer to walk to the right of their place, rad: two who meet head on would stand before each other."""
HASTE = 1.3
"""Greatest speed as a multiple of the pace."""
THERE, STUCK, PATIENCE = 0.5, 0.05, 1.0
"""Distance at which people have reached their place, m; speed below which they are stuck, m/s, and the time after which they
turn round then, s."""
STOPS, STOP = 1.0 / 3.0, 0.5
"""Share of those who see the robot, a quarter of all, who stop for it, and the gap to a robot ahead below which they do, m."""
PAIRS, ASIDE = 0.5, 0.6
"""Share of rooms where two people are a pair, and the distance of their places, m."""
RIGID = 1e-3
"""How far walls and boxes give way, as a share of how far people do, if no velocity keeps all apart."""


def between(to: Plane, closing: Plane, reach: Reals, ahead: Reals) -> tuple[Plane, Reals]:
    """Return normals, and by how much their relative velocity must change along them, m/s, for circles not to meet.

    Args:
        to: Offsets to the others, m.
        closing: Own velocities relative to the others', m/s.
        reach: Sums of the radii, m.
        ahead: Times for which they must not meet, s; circles that overlap get a control interval to part.
    """
    square, overlap = dot(to, to), abs(to) < reach
    until = np.where(overlap, PERIOD, ahead)
    off = closing - to / until
    size, toward = np.maximum(abs(off), 1e-9), dot(off, to)
    leg = np.sqrt(np.maximum(square - reach**2, 0.0))
    is_left = to.real * off.imag - to.imag * off.real > 0.0
    edge = to * np.where(is_left, leg + 1j * reach, -leg + 1j * reach) / np.maximum(square, 1e-9)
    is_round = overlap | ((toward < 0.0) & (toward**2 > reach**2 * size**2))
    normals = np.where(is_round, off / size, 1j * edge)
    return normals, np.where(is_round, reach / until - size, -dot(closing, normals))


def obstacles(at: Plane, radii: Reals, walls: Reals, boxes: Reals, counts: NDArray[np.int64]) -> tuple[Plane, Reals]:
    """Return the half planes of walls and of each box's nearest point: their normals and bounds, m/s, shape (n, 4 + B).

    Args:
        at: Places of persons, m, shape (n,).
        radii: Their radii, m, shape (n,).
        walls: The walls around each, shape (n, 4), see `turtlebot_gym.rooms.scene.RoomShape`.
        boxes: The boxes around each, shape (n, B, 6).
        counts: Numbers of boxes, shape (n,).
    """
    turn, halves = boxes[..., 4] + 1j * boxes[..., 5], boxes[..., 2:4]
    local = (at[:, None] - boxes[..., 0] - 1j * boxes[..., 1]) * turn.conj()
    beyond = np.stack((abs(local.real), abs(local.imag)), -1) - halves
    depth = beyond.max(axis=-1)
    outside = depth > 0.0
    beyond = np.where(outside[..., None], beyond.clip(0.0), beyond == depth[..., None])  # inside: to the nearest side
    off = np.copysign(beyond[..., 0], local.real) + 1j * np.copysign(beyond[..., 1], local.imag)
    gaps = np.where(outside, abs(off), depth)
    gaps[np.arange(boxes.shape[1]) >= counts[:, None]] = -NEVER
    x, y = at.real - walls[:, 0], at.imag - walls[:, 1]
    sides = np.stack((x + walls[:, 2], walls[:, 2] - x, y + walls[:, 3], walls[:, 3] - y), -1)
    normals = np.concatenate((np.broadcast_to([1.0, -1.0, 1j, -1j], sides.shape), off / abs(off) * turn), 1)
    return normals, (radii[:, None] - np.concatenate((sides, gaps), 1)) / WALLS_AHEAD


class Orca(VectorWrapper):
    """Rooms of the world ``people`` whose people walk by ORCA.

    People are drawn anew where an episode begins, also by autoreset. The numbers of the drawn room seed their generator, so the
    environment's seed gives both, alone and in any batch.

    Args:
        envs: Vector environment of this package, of the world ``people``, at 10 Hz.
        share: Share of the avoidance that everybody takes over.

    Raises:
        ValueError: If the rooms have no people.
    """

    def __init__(self, envs: VectorEnv, *, share: float = 0.5) -> None:
        super().__init__(envs)
        self._rooms: Any = envs.unwrapped
        self._share, room = share, self._rooms.truth()[0].room
        shape = room.people.shape[:2]
        if not shape[1]:
            raise ValueError("envs must have people in its rooms, as in the world people, got rooms without.")
        self.paces: Reals = np.zeros(shape)
        """Pace of each person, m/s, shape (n, P); the scene has 0."""
        self.stops: Flags = np.zeros(shape, np.bool_)
        """Who stops for the robot, shape (n, P)."""
        self.pairs: Flags = np.zeros(len(room.people), np.bool_)
        """Rooms whose first two people are a pair, shape (n,): the second has the places of the first, to the side."""
        self._goals, self._back = np.zeros(shape, np.complex128), np.zeros(shape, np.complex128)
        self._slow: Reals = np.zeros(shape)  # how long each has been stuck, s

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        observations, info = self.env.reset(seed=seed, options=options)
        self._draw(self._rooms.truth()[0].room)
        return observations, info

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        scenes, robots, _ = self._rooms.truth()
        self._draw(scenes.room)
        self._walk(scenes.room, robots)
        return self.env.step(actions)

    def _draw(self, room: RoomShape) -> None:
        """Draw the people of rooms that have begun anew since the last step: in the scene they have a pace."""
        for row in np.flatnonzero(room.people[..., 4].any(axis=1)).tolist():
            people, count = room.people[row], room.counts[row, 0]
            random = np.random.default_rng(people[:count].view(np.uint64).ravel())
            self.pairs[row] = random.random() < PAIRS and count > 1
            self.stops[row] = (random.random(len(people)) < STOPS) & (people[:, 5] > 0.0)
            self.paces[row], self._slow[row] = people[:, 4], 0.0
            self._goals[row], self._back[row] = people[:, 0] + 1j * people[:, 1], people[:, 2] + 1j * people[:, 3]
            people[:, 4] = 0.0
            if self.pairs[row]:
                self._pair(row, room.walls[row], room.circles[row, 1, 2])

    def _pair(self, row: int, walls: Reals, radius: float) -> None:
        """Give the second person the pace and the places of the first, moved to the side of the room's middle."""
        middle, far = complex(walls[0], walls[1]), walls[2:] - radius
        goal, back = self._goals[row, 0] - middle, self._back[row, 0] - middle
        aside = 1j * ASIDE * (goal - back) / max(abs(goal - back), 1e-9)
        aside = -aside if dot(aside, goal + back) > 0.0 else aside
        for places, place in ((self._goals, goal + aside), (self._back, back + aside)):
            places[row, 1] = middle + complex(np.clip(place.real, -far[0], far[0]), np.clip(place.imag, -far[1], far[1]))
        self.paces[row, 1] = self.paces[row, 0]

    def _wanted(self, at: Plane, walks: Plane, gaps: Reals, to_robot: Plane) -> Plane:
        """Turn who has reached a place or is stuck, a pair as its first does, and return preferred velocities, m/s."""
        self._slow = np.where(abs(walks) < STUCK, self._slow + PERIOD, 0.0)
        turns = (abs(self._goals - at) < THERE) | (self._slow > PATIENCE - 0.5 * PERIOD)
        turns[self.pairs, 1:2] = turns[self.pairs, :1]
        self._goals, self._back = np.where(turns, self._back, self._goals), np.where(turns, self._goals, self._back)
        self._slow[turns] = 0.0
        to = self._goals - at
        wanted = self.paces * to * np.exp(-1j * ASKEW) / np.maximum(abs(to), THERE)  # at the place: waits for the other one
        return np.where(self.stops & (gaps < STOP) & (dot(to, to_robot) > 0.0), 0.0, wanted)

    def _walk(self, room: RoomShape, robots: Reals) -> None:
        """Set the velocities of all people for a control interval; the robots have the true states, shape (n, 5)."""
        circles, there = room.circles, np.arange(room.circles.shape[1]) < room.counts[:, :1]
        robot, moves = robots[:, 0] + 1j * robots[:, 1], robots[:, 3] * np.exp(1j * robots[:, 2])
        at, walks = circles[..., 0] + 1j * circles[..., 1], circles[..., 3] + 1j * circles[..., 4]
        radius = self._rooms.parameters.robot.radius
        to_robot = robot[:, None] - at
        wanted = self._wanted(at, walks, abs(to_robot) - circles[..., 2] - radius, to_robot)
        rows, who = np.nonzero(there)
        own, walk, radii = at[rows, who], walks[rows, who], circles[rows, who, 2]
        others = np.concatenate((at, robot[:, None]), 1)[rows] - own[:, None]
        closing = walk[:, None] - np.concatenate((walks, moves[:, None]), 1)[rows]
        reach = radii[:, None] + np.pad(circles[..., 2] + APART, ((0, 0), (0, 1)), constant_values=radius)[rows]
        met, ahead, share = (
            np.pad(there[rows], ((0, 0), (0, 1))),
            np.full(reach.shape, AHEAD),
            np.full(reach.shape, self._share),
        )
        met[np.arange(len(rows)), who] = False
        sees, stands = room.people[rows, who, 5] > 0.0, abs(moves[rows]) * PERIOD <= STANDS
        met[:, -1] = sees | stands
        ahead[~sees, -1], share[~sees, -1] = PERIOD, 1.0  # only a robot that stands holds up who does not see it, at its edge
        normals, change = between(others, closing, reach, ahead)
        bounds = dot(normals, walk[:, None]) + share * change
        normals[~met], bounds[~met] = 1.0, NEVER
        rigid = obstacles(own, radii, room.walls[rows], room.boxes[rows], room.counts[rows, 1])
        normals, bounds = np.concatenate((rigid[0], normals), 1), np.concatenate((rigid[1], bounds), 1)
        fastest = HASTE * self.paces[rows, who]
        found, failed = nearest(normals, bounds, fastest, wanted[rows, who])
        if (crowded := failed < normals.shape[1]).any():
            gives = np.where(np.arange(normals.shape[1]) < rigid[0].shape[1], RIGID, 1.0)
            tight = normals[crowded], bounds[crowded], gives, fastest[crowded], found[crowded], failed[crowded]
            found[crowded] = least_penetrating(*tight)
        circles[rows, who, 3], circles[rows, who, 4] = found.real, found.imag
