"""Draw random rooms by counter: the same key gives the same room, alone and in any batch, and each room has a path."""

from __future__ import annotations

import math

import numpy as np

from turtlebot_gym.kernel import kernel, sqrt
from turtlebot_gym.models.angles import PI, TWO_PI, sincos, wrap
from turtlebot_gym.models.random import GOALS, ROOM, sub_key, uniforms
from turtlebot_gym.rooms.geodesic import MARGIN, block, cell_of, is_free, spread
from turtlebot_gym.rooms.rays import distance_to_circle
from turtlebot_gym.rooms.rules import ANYWHERE, CELLULAR, GIVEN, OFFICE, RoomRules
from turtlebot_gym.rooms.scene import UNREACHED, Scene
from turtlebot_gym.rooms.walking import walk
from turtlebot_gym.values import Pose

ATTEMPTS = 64
"""Rooms tried before an empty one is used, and placements tried in a room before the next one is drawn."""
HEAD_START = 1.0
"""Time for which walkers stay away from a robot that stands at a drawn start, s.

A robot needs 0.6 s to see a person come and to stop: two revolutions of a LiDAR of 5 Hz, a control interval of 0.1 s, and 0.1 s
to brake from 0.22 m/s at 2.5 m/s^2. Within that time a person at 1.4 m/s comes 0.84 m nearer.
"""
_NUMBERS = 4096
"""Most draws for a room."""
# First draw of each part of a room.
_COUNTS, _BOXES, _DOORS, _CIRCLES, _CELLS, _PLACES = 0, 16, 128, 256, 1024, 3968

_DOOR = 0.9
"""Width of a door, m."""
_WALL = 0.05
"""Half the thickness of an inner wall, m."""
_END = 0.8
"""Share of the room's length at which its last fifth begins."""
_SHUT = 0.25
"""Share of walled-up doors."""
OFFICE_ROOMS = (3, 2)
"""Rooms of an office along x and y."""
OFFICE_WALLS = 14
"""Most boxes in the walls of an office."""
CELL = 0.15
"""Side of the automaton's cells, m, as in the BARN challenge."""


def capacity(rules: RoomRules) -> tuple[int, int]:
    """Return the most circles and boxes of a room."""
    circles, boxes = int(rules.circles[1]), int(rules.boxes[1])
    if rules.kind == CELLULAR:
        return int(4.0 * rules.half_length * rules.half_width / CELL**2 + 1e-9), 0
    return circles, boxes + (OFFICE_WALLS if rules.kind == OFFICE else 0)


@kernel
def _between(low: float, high: float, share: float) -> float:
    return low + (high - low) * share


@kernel
def _count(low: float, high: float, share: float) -> int:
    """Return a whole number from ``low`` to ``high``, uniformly distributed."""
    return int(low) + int((high - low + 1.0) * share)


@kernel
def _in_room(scene: Scene, key: int, number: int, part: int) -> tuple[float, float]:
    """Return a place in the room, uniformly distributed."""
    walls = scene.room.walls
    u1, u2 = uniforms(key, number, part)
    return walls[0] + (2.0 * u1 - 1.0) * walls[2], walls[1] + (2.0 * u2 - 1.0) * walls[3]


@kernel
def _scatter(scene: Scene, rules: RoomRules, key: int, first: int, boxes_before: int) -> None:
    """Draw circles and boxes at random places; they may overlap."""
    few, many = uniforms(key, first + _COUNTS, 0)
    n_boxes = _count(rules.boxes[0], rules.boxes[1], few)
    n_circles = int(min(_count(rules.circles[0], rules.circles[1], many), rules.total - n_boxes))
    for k in range(n_boxes):
        box, at = scene.room.boxes[boxes_before + k], first + _BOXES + 3 * k
        box[0], box[1] = _in_room(scene, key, at, 0)
        u1, u2 = uniforms(key, at + 1, 0)
        box[2], box[3] = _between(rules.radius[0], rules.radius[1], u1), _between(rules.radius[0], rules.radius[1], u2)
        box[5], box[4] = sincos(PI * uniforms(key, at + 2, 0)[0])
    for k in range(n_circles):
        circle, at = scene.room.circles[k], first + _CIRCLES + 2 * k
        circle[0], circle[1] = _in_room(scene, key, at, 0)
        u1, u2 = uniforms(key, at + 1, 0)
        circle[2], speed = _between(rules.radius[0], rules.radius[1], u1), _between(rules.speed[0], rules.speed[1], u2)
        sine, cosine = sincos(TWO_PI * uniforms(key, at + 1, 1)[0])
        circle[3], circle[4] = speed * cosine, speed * sine
        if rules.people:
            person = scene.room.people[k]
            person[0], person[1] = _in_room(scene, key, at, 2)
            person[2], person[3], person[4] = circle[0], circle[1], speed
            person[5] = 1.0 if uniforms(key, at, 3)[0] >= rules.blind else 0.0
    scene.room.counts[0], scene.room.counts[1] = n_circles, boxes_before + n_boxes


@kernel
def _put_box(scene: Scene, at: int, left: float, right: float, bottom: float, top: float) -> int:
    """Write a box, and return how many were written: none without extent."""
    if right <= left or top <= bottom:
        return at
    box = scene.room.boxes[at]
    box[0], box[1], box[2], box[3] = 0.5 * (left + right), 0.5 * (bottom + top), 0.5 * (right - left), 0.5 * (top - bottom)
    box[4], box[5] = 1.0, 0.0
    return at + 1


@kernel
def _door(key: int, number: int, low: float, high: float) -> float:
    """Return where the door in an inner wall begins: at its end if it is walled up."""
    place, shut = uniforms(key, number, 0)
    return _between(low + _WALL, high - _WALL - _DOOR, place) if shut >= _SHUT else high


@kernel
def _partition(scene: Scene, key: int, first: int) -> int:
    """Draw an office's inner walls and doors; return their number of boxes."""
    walls = scene.room.walls
    across, along = OFFICE_ROOMS
    length, width = 2.0 * walls[2] / across, 2.0 * walls[3] / along
    at = 0
    for column in range(across):
        for row in range(along):
            number = first + _DOORS + 2 * (column * along + row)
            left, bottom = walls[0] - walls[2] + column * length, walls[1] - walls[3] + row * width
            right, top = walls[0] - walls[2] + (column + 1) * length, walls[1] - walls[3] + (row + 1) * width
            if column + 1 < across:
                door = _door(key, number, bottom, top)
                at = _put_box(scene, at, right - _WALL, right + _WALL, bottom, door)
                at = _put_box(scene, at, right - _WALL, right + _WALL, door + _DOOR, top)
            if row + 1 < along:
                door = _door(key, number + 1, left, right)
                at = _put_box(scene, at, left, door, top - _WALL, top + _WALL)
                at = _put_box(scene, at, door + _DOOR, right, top - _WALL, top + _WALL)
    return at


@kernel
def _grow(scene: Scene, rules: RoomRules, key: int, first: int) -> None:
    """Fill cells at random, smooth them four times by the majority of their neighbours, and put a circle into each.

    References:
        Perille, Truong, Xiao, Stone, "Benchmarking metric ground navigation", SSRR (2020): the worlds of the BARN challenge.
    """
    walls = scene.room.walls
    rows, columns = int(2.0 * walls[3] / CELL + 1e-9), int(2.0 * walls[2] / CELL + 1e-9)
    now, then = np.zeros((rows, columns), np.uint8), np.zeros((rows, columns), np.uint8)
    for cell in range(rows * columns):
        u, _ = uniforms(key, first + _CELLS + cell, 0)
        now[cell // columns, cell % columns] = 1 if u < rules.fill else 0
    for _ in range(4):
        for cell in range(rows * columns):
            row, column = cell // columns, cell % columns
            filled = -int(now[row, column])
            for near_row in range(max(row - 1, 0), min(row + 2, rows)):
                for near_column in range(max(column - 1, 0), min(column + 2, columns)):
                    filled += int(now[near_row, near_column])
            then[row, column] = 1 if filled >= 5 or (filled >= 2 and now[row, column] == 1) else 0
        now, then = then, now
    n_circles = 0
    for cell in range(rows * columns):
        row, column = cell // columns, cell % columns
        if now[row, column] == 1 and n_circles < len(scene.room.circles):
            circle = scene.room.circles[n_circles]
            circle[0], circle[1] = walls[0] - walls[2] + (column + 0.5) * CELL, walls[1] - walls[3] + (row + 0.5) * CELL
            circle[2], circle[3], circle[4] = 0.5 * CELL, 0.0, 0.0
            n_circles += 1
    scene.room.counts[0], scene.room.counts[1] = n_circles, 0


@kernel
def _furnish(scene: Scene, rules: RoomRules, key: int, first: int) -> None:
    scene.room.walls[0], scene.room.walls[1] = 0.0, 0.0
    scene.room.walls[2], scene.room.walls[3] = rules.half_length, rules.half_width
    if rules.kind == CELLULAR:
        _grow(scene, rules, key, first)
    else:
        _scatter(scene, rules, key, first, _partition(scene, key, first) if rules.kind == OFFICE else 0)


@kernel
def _place(
    scene: Scene, rules: RoomRules, given: tuple[float, ...], share: float, near: Pose, far: float, key: int, at: int
) -> Pose:
    """Return a given pose, or one drawn: within ``far`` of another one along each axis, in a fifth of the room, or anywhere."""
    walls = scene.room.walls
    u1, u2 = uniforms(key, at, 0)
    u3, _ = uniforms(key, at, 1)
    along = share + 0.2 * u1 if rules.through else u1
    x, y = walls[0] + (2.0 * along - 1.0) * walls[2], walls[1] + (2.0 * u2 - 1.0) * walls[3]
    if far < math.inf:
        x = _between(max(near.x - far, walls[0] - walls[2]), min(near.x + far, walls[0] + walls[2]), u1)
        y = _between(max(near.y - far, walls[1] - walls[3]), min(near.y + far, walls[1] + walls[3]), u2)
    drawn = math.isnan(given[0])
    return Pose(x if drawn else given[0], y if drawn else given[1], wrap(TWO_PI * u3) if drawn else given[2])


@kernel
def _is_beside_a_walker(scene: Scene, x: float, y: float, reach: float) -> bool:
    """Return whether a walker, whom the path grid leaves out, is less than ``reach`` away."""
    beside = False
    for k in range(scene.room.counts[0]):
        circle = scene.room.circles[k]
        walks = circle[3] != 0.0 or circle[4] != 0.0
        beside = beside or (walks and distance_to_circle(circle[0] - x, circle[1] - y, circle[2]) < reach)
    return beside


@kernel
def _is_run_into(scene: Scene, start: Pose, rules: RoomRules, radius: float, dt: float) -> bool:
    """Return whether a walker comes close to a robot that stands at the start within `HEAD_START`."""
    if not _is_beside_a_walker(scene, start.x, start.y, math.inf):
        return False
    circles, people, near = scene.room.circles.copy(), scene.room.people.copy(), False
    for _ in range(math.ceil(HEAD_START / dt - 1e-9)):
        walk(scene, start, start, radius, rules, dt)
        near = near or _is_beside_a_walker(scene, start.x, start.y, radius + MARGIN)
    for k in range(scene.room.counts[0]):
        scene.room.circles[k] = circles[k]
        if rules.people:
            scene.room.people[k] = people[k]
    return near


@kernel
def draw(scene: Scene, rules: RoomRules, radius: float, key: int, dt: float) -> tuple[Pose, Pose]:
    """Draw a room with a path through it, and return the robot's start and goal.

    Rooms and placements are drawn until the robot fits at start and goal, no walker is or comes close to a drawn start within
    `HEAD_START`, and a path connects the two. If all attempts fail, the room is emptied.

    The room is written to the scene, whose contents the kind "given" keeps. The robot's radius is in m; walkers move in control
    intervals of dt, s.
    """
    room_key = sub_key(key, ROOM)
    start, goal = Pose(0.0, 0.0, 0.0), Pose(0.0, 0.0, 0.0)
    nothing_is_drawn = rules.kind == GIVEN and not math.isnan(rules.start[0]) and not math.isnan(rules.goal[0])
    to_be_blocked = True
    for attempt in range(1 if nothing_is_drawn else ATTEMPTS):
        first = attempt * _NUMBERS
        if rules.kind != GIVEN:
            _furnish(scene, rules, room_key, first)
            if attempt == ATTEMPTS - 1:
                scene.room.counts[0], scene.room.counts[1] = 0, 0
        if to_be_blocked:
            block(scene, radius + MARGIN)
        to_be_blocked = rules.kind != GIVEN
        for place in range(ATTEMPTS):
            start = _place(scene, rules, rules.start, 0.0, goal, math.inf, room_key, first + _PLACES + 2 * place)
            at = first + _PLACES + 2 * place + 1
            goal = _place(scene, rules, rules.goal, _END, start, rules.max_distance, room_key, at)
            dx, dy = goal.x - start.x, goal.y - start.y
            far = dx * dx + dy * dy >= rules.min_distance * rules.min_distance
            drawn = math.isnan(rules.start[0])
            is_taken = drawn and _is_beside_a_walker(scene, start.x, start.y, radius + MARGIN)
            fits = far and not is_taken and is_free(scene, start.x, start.y) and is_free(scene, goal.x, goal.y)
            if fits and not (drawn and _is_run_into(scene, start, rules, radius, dt)):
                spread(scene, goal.x, goal.y)
                to_be_blocked = True
                row, column = cell_of(scene, start.x, start.y)
                if scene.room.ways[row, column] < UNREACHED - 1:
                    return start, goal
                break
    block(scene, radius + MARGIN)  # there is no path, so the grid must show none
    return start, goal


@kernel
def draw_next(scene: Scene, rules: RoomRules, before: Pose, key: int, number: int) -> Pose:
    """Draw the goal after another one: far enough from it, and with a path to it, or the farthest of `ATTEMPTS`.

    It depends on the ``number`` of goals before it alone, from 1, and not on where the robot is. In rooms that are driven
    through, goals are at both ends in turn. The scene holds the paths to the goal ``before``.
    """
    goal, farthest, goals_key = before, -1.0, sub_key(key, GOALS)
    for attempt in range(ATTEMPTS):
        at = number * ATTEMPTS + attempt
        share = _END if number % 2 == 0 else 0.0
        drawn = _place(scene, rules, ANYWHERE, share, before, rules.max_distance, goals_key, at)
        row, column = cell_of(scene, drawn.x, drawn.y)
        dx, dy = drawn.x - before.x, drawn.y - before.y
        far = sqrt(dx * dx + dy * dy)
        if scene.room.ways[row, column] < UNREACHED - 1 and far > farthest:
            goal, farthest = drawn, far
        if farthest >= rules.min_distance:
            break
    return goal
