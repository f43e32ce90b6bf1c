"""LiDAR measurements of a robot in a room, and its clearance."""

from __future__ import annotations

import numpy as np

from turtlebot_gym.kernel import exactly, is_plain, kernel
from turtlebot_gym.models.angles import TWO_PI, sincos, wrap
from turtlebot_gym.rooms.lidar import Lidar, bias_of, reading, time_of_beam
from turtlebot_gym.rooms.rays import (
    FAR,
    distance_to_box,
    distance_to_cells,
    distance_to_circle,
    distance_to_walls,
    inverse,
    ray_to_box,
    ray_to_cells,
    ray_to_circle,
    ray_to_walls,
    to_cells,
)
from turtlebot_gym.rooms.scene import GROUP, Scene, whole_groups
from turtlebot_gym.rooms.sectors import pool
from turtlebot_gym.values import Pose

CLEAR = 1.0
"""Greatest clearance reported on a map, m; cells farther away are not examined."""
BLOCK = 128
"""Most rays cast at a time."""
NARROW = 2.5
"""Greatest angle between the first and the last of some rays at which they are compared as a whole, rad; less than pi."""
FEW = 40
"""Above this many rays, groups of them are compared with each obstacle first."""
_SLACK = 1e-6
"""Distance by which rays must pass an obstacle to be left out, m: much more than rounding."""
_X, _Y, _DX, _DY, _LENGTH = range(0, 5 * BLOCK, BLOCK)
_ALL, _RUN = BLOCK // GROUP, BLOCK // GROUP + GROUP  # of the groups, and then of all rays together
_AT_X, _AT_Y, _RIGHT_X, _RIGHT_Y, _LEFT_X, _LEFT_Y, _BEHIND_X, _BEHIND_Y, _PAST = range(5 * BLOCK, 5 * BLOCK + 9 * _RUN, _RUN)
ROOM = 5 * BLOCK + 9 * _RUN
"""Numbers that `cast` works on."""


@kernel
def _is_near(x: float, y: float, radius: float, reach: float) -> bool:
    """Return whether any part of a circle with its centre at (x, y) is within ``reach``."""
    far = reach + radius
    return x * x + y * y <= far * far


@kernel
def _bound(rays, at: int, first: int, last: int, turn: float) -> None:
    """Write the outward normals of what the rays from one to another can meet, which point between these two, or beside it.

    All of that lies on the inner sides of the two, and ahead of their sum.
    """
    rays[_AT_X + at], rays[_AT_Y + at] = rays[_X + first], rays[_Y + first]
    rays[_RIGHT_X + at], rays[_RIGHT_Y + at] = turn * rays[_DY + first], -turn * rays[_DX + first]
    rays[_LEFT_X + at], rays[_LEFT_Y + at] = -turn * rays[_DY + last], turn * rays[_DX + last]
    rays[_BEHIND_X + at] = -0.5 * (rays[_DX + first] + rays[_DX + last])
    rays[_BEHIND_Y + at] = -0.5 * (rays[_DY + first] + rays[_DY + last])


@kernel
def _group(rays, n: int, sweep: float) -> int:
    """Prepare the comparison of groups of rays, and of all together, and return the number of groups."""
    groups, turn = whole_groups(n) // GROUP, 1.0 if sweep >= 0.0 else -1.0
    for ray in range(n, groups * GROUP):
        rays[_X + ray], rays[_Y + ray] = rays[_X + n - 1], rays[_Y + n - 1]
        rays[_DX + ray], rays[_DY + ray] = rays[_DX + n - 1], rays[_DY + n - 1]
    for group in range(groups):
        _bound(rays, group, group * GROUP, group * GROUP + GROUP - 1, turn)
    _bound(rays, _ALL, 0, n - 1, turn)
    return groups


@kernel
def _past_circle(rays, at: int, x: float, y: float) -> float:
    """Return the distance of a point from what some rays can meet, at least; negative inside."""
    to_x, to_y = x - rays[_AT_X + at], y - rays[_AT_Y + at]
    right = to_x * rays[_RIGHT_X + at] + to_y * rays[_RIGHT_Y + at]
    left = to_x * rays[_LEFT_X + at] + to_y * rays[_LEFT_Y + at]
    return max(max(right, left), to_x * rays[_BEHIND_X + at] + to_y * rays[_BEHIND_Y + at])


@kernel
def _beyond(x: float, y: float, out_x: float, out_y: float, box) -> float:
    """Return how far all of a box centred at (x, y) lies in a direction, at least."""
    along, aside = out_x * box[4] + out_y * box[5], out_y * box[4] - out_x * box[5]
    return x * out_x + y * out_y - (box[2] * abs(along) + box[3] * abs(aside))


@kernel
def _past_box(rays, at: int, box) -> float:
    """Return how far a box, a row of `RoomShape.boxes`, is at least from what some rays can meet; negative if they may."""
    to_x, to_y = box[0] - rays[_AT_X + at], box[1] - rays[_AT_Y + at]
    right = _beyond(to_x, to_y, rays[_RIGHT_X + at], rays[_RIGHT_Y + at], box)
    left = _beyond(to_x, to_y, rays[_LEFT_X + at], rays[_LEFT_Y + at], box)
    return max(max(right, left), _beyond(to_x, to_y, rays[_BEHIND_X + at], rays[_BEHIND_Y + at], box))


@kernel
def _next_run(rays, first: int, groups: int, apart: float) -> tuple[int, int]:
    """Return the first of the next groups in a row that may meet an obstacle, and the one after the last.

    Their rays are cast in one loop: the compiler unrolls a loop over one group, whose length it knows, into single numbers.
    """
    while first < groups and apart < FAR and rays[_PAST + first] > apart:
        first += 1
    end = first if apart < FAR else groups
    while end < groups and rays[_PAST + end] <= apart:
        end += 1
    return first, end


@kernel
def cast(scene: Scene, rays, n: int, reach: float, sweep: float, drift: float) -> None:
    """Compute the lengths of rays: obstacles in the outer loop, rays in the inner one, which LLVM vectorizes.

    An obstacle that a whole group of rays must miss is left out for it: most are.
    The rays are in one array at offsets that the compiler knows, so that it needs no check for overlapping arrays.

    Args:
        scene: The room.
        rays: Shape (`ROOM`,): five runs of up to `BLOCK` numbers: x and y of the n rays' origins, close to each other, m; x
            and y of their directions, unit vectors; and their lengths, the output, m. The rest is scratch space.
        n: Number of rays.
        reach: Distance from the first origin beyond which obstacles may be missed, m.
        sweep: Angle from each ray to the next, rad; infinite if they are not ordered.
        drift: Greatest distance from the origin of a ray to that of the next one, m.
    """
    x, y, walls, boxes = rays[_X], rays[_Y], scene.room.walls, scene.room.boxes
    at_x, at_y, half_length, half_width = walls[0], walls[1], walls[2], walls[3]
    groups = _group(rays, n, sweep)
    # How far an obstacle must be past some rays to be left out: farther than their origins are apart. Few rays are cast in less
    # time than they are compared.
    apart = (GROUP - 1.0) * drift + _SLACK if abs(sweep) * (GROUP - 1.0) <= NARROW and n > FEW else FAR
    all_apart = (n - 1.0) * drift + _SLACK if abs(sweep) * (n - 1.0) <= NARROW else FAR
    for ray in range(groups * GROUP):
        to_x, to_y, ahead, aside = at_x - rays[_X + ray], at_y - rays[_Y + ray], rays[_DX + ray], rays[_DY + ray]
        rays[_LENGTH + ray] = ray_to_walls(to_x, to_y, inverse(ahead), inverse(aside), half_length, half_width)
    for k in range(scene.room.counts[0]):
        at_x, at_y, radius = scene.room.circles[k, 0], scene.room.circles[k, 1], scene.room.circles[k, 2]
        if _is_near(at_x - x, at_y - y, radius, reach) and _past_circle(rays, _ALL, at_x, at_y) <= radius + all_apart:
            for group in range(whole_groups(groups) if apart < FAR else 0):
                rays[_PAST + group] = _past_circle(rays, group, at_x, at_y) - radius
            first, end = _next_run(rays, 0, groups, apart)
            while first < end:
                some = rays[first * GROUP :]
                for ray in range((end - first) * GROUP):
                    to_x, to_y, dx, dy = at_x - some[_X + ray], at_y - some[_Y + ray], some[_DX + ray], some[_DY + ray]
                    some[_LENGTH + ray] = min(some[_LENGTH + ray], ray_to_circle(to_x, to_y, dx, dy, radius * radius))
                first, end = _next_run(rays, end, groups, apart)
    for k in range(scene.room.counts[1]):
        at_x, at_y, half_length, half_width = boxes[k, 0], boxes[k, 1], boxes[k, 2], boxes[k, 3]
        cosine, sine = boxes[k, 4], boxes[k, 5]
        is_near = _is_near(at_x - x, at_y - y, half_length + half_width, reach)
        if is_near and _past_box(rays, _ALL, boxes[k]) <= all_apart:
            for group in range(whole_groups(groups) if apart < FAR else 0):
                rays[_PAST + group] = _past_box(rays, group, boxes[k])
            first, end = _next_run(rays, 0, groups, apart)
            while first < end:
                some = rays[first * GROUP :]
                for ray in range((end - first) * GROUP):
                    to_x, to_y, dx, dy = at_x - some[_X + ray], at_y - some[_Y + ray], some[_DX + ray], some[_DY + ray]
                    ahead, aside = inverse(dx * cosine + dy * sine), inverse(dy * cosine - dx * sine)
                    to_x, to_y = to_x * cosine + to_y * sine, to_y * cosine - to_x * sine
                    length = ray_to_box(to_x, to_y, ahead, aside, half_length, half_width)
                    some[_LENGTH + ray] = min(some[_LENGTH + ray], length)
                first, end = _next_run(rays, end, groups, apart)
    if scene.room.squares.shape[1] > 0:
        cosine, sine, resolution = scene.room.frame[2], scene.room.frame[3], scene.room.frame[4]
        for ray in range(n):
            column, row = to_cells(scene.room.frame, rays[_X + ray], rays[_Y + ray])
            dx, dy = rays[_DX + ray], rays[_DY + ray]
            ahead, aside = dx * cosine + dy * sine, dy * cosine - dx * sine
            length = resolution * ray_to_cells(scene.room.squares, column, row, ahead, aside, reach / resolution)
            rays[_LENGTH + ray] = min(rays[_LENGTH + ray], length)


@kernel
def clearance(scene: Scene, x: float, y: float) -> float:
    """Return the distance from a point to the nearest surface in the room, m; negative inside of an obstacle.

    On a map it is at most `CLEAR`.
    """
    walls = scene.room.walls
    nearest = distance_to_walls(walls[0] - x, walls[1] - y, walls[2], walls[3])
    for k in range(scene.room.counts[0]):
        circle = scene.room.circles[k]
        nearest = min(nearest, distance_to_circle(circle[0] - x, circle[1] - y, circle[2]))
    for k in range(scene.room.counts[1]):
        box = scene.room.boxes[k]
        nearest = min(nearest, distance_to_box(box[0] - x, box[1] - y, box))
    if scene.room.squares.shape[1] > 0:
        column, row = to_cells(scene.room.frame, x, y)
        side = scene.room.frame[4]
        nearest = min(nearest, side * distance_to_cells(scene.room.squares, column, row, CLEAR / side))
    return nearest


@kernel
def measure(
    scene: Scene, before: Pose, now: Pose, first: int, last: int, start: float, key: int, lidar: Lidar, dt: float
) -> None:
    """Measure beams while the robot moves from one pose to another, and publish scans in the scene as they complete.

    The interval begins at ``start``, s, and lasts dt; beams are measured from the number ``first`` up to ``last``, with draws
    by the key of the episode's scans.
    """
    revolution, turn = int(lidar.beams), wrap(now.theta - before.theta)
    bias, sweeping, newest = bias_of(key, lidar), scene.lidar.ranges[0], scene.lidar.ranges[1]
    rays = np.zeros(ROOM) if is_plain() else np.empty(ROOM)
    share = 1.0 / (lidar.beams * lidar.rate * dt) if lidar.turning else 0.0  # of the interval, from one beam to the next
    sweep, arm = TWO_PI / lidar.beams + share * turn, abs(lidar.x) + abs(lidar.y)
    drift = share * (abs(now.x - before.x) + abs(now.y - before.y) + arm * abs(turn))
    while first < last:  # in parts within one revolution
        begin = first % revolution
        beams = scene.lidar.beams
        cosines, sines, least = beams[0, begin:], beams[1, begin:], beams[2, begin:]
        n = min(min(last - first, revolution - begin), BLOCK)
        for ray in range(whole_groups(n)):
            share = (time_of_beam(float(first) + exactly(ray), lidar) - start) / dt
            sine, cosine = sincos(before.theta + share * turn)
            rays[_X + ray] = before.x + share * (now.x - before.x) + lidar.x * cosine - lidar.y * sine
            rays[_Y + ray] = before.y + share * (now.y - before.y) + lidar.x * sine + lidar.y * cosine
            rays[_DX + ray] = cosine * cosines[ray] - sine * sines[ray]
            rays[_DY + ray] = sine * cosines[ray] + cosine * sines[ray]
        cast(scene, rays, n, lidar.range_max + 1.0, sweep, drift)
        lengths = rays[_LENGTH:]
        if lidar.deviation > 0.0 or lidar.deviation_share > 0.0 or lidar.dropout > 0.0:
            for ray in range(whole_groups(n)):
                lengths[ray] = reading(lengths[ray], least[ray], first + ray, bias, key, lidar)
        else:
            for ray in range(whole_groups(n)):
                lengths[ray] = reading(lengths[ray], least[ray], first + ray, bias, key, lidar, False)
        for ray in range(n):
            sweeping[begin + ray] = lengths[ray]
        if begin + n == revolution:
            for beam in range(revolution):
                newest[beam] = sweeping[beam]
            pool(newest, scene.lidar.spans, revolution, scene.lidar.sectors)
        first += n
