"""LiDAR measurements of a robot in a room, and its clearance."""

from __future__ import annotations

import numpy as np

from turtlebot_gym.kernel import kernel
from turtlebot_gym.models.angles import sincos, wrap
from turtlebot_gym.rooms.cells import distance_to_cells, ray_to_cells, to_cells
from turtlebot_gym.rooms.lidar import Lidar, bias_of, is_drawn, pool, reading, reading_of, time_of_beam
from turtlebot_gym.rooms.rays import (
    distance_to_circle,
    distance_to_turned_box,
    distance_to_walls,
    inverse,
    ray_to_box,
    ray_to_circle,
    ray_to_walls,
)
from turtlebot_gym.rooms.scene import Scene
from turtlebot_gym.values import Pose

CLEAR = 1.0
"""Greatest clearance reported on a map, m; cells farther away are not examined."""


BLOCK = 128
"""Most rays cast at a time."""
_X, _Y, _DX, _DY, _LENGTH = range(0, 5 * BLOCK, BLOCK)


@kernel
def _is_near(x: float, y: float, radius: float, reach: float) -> bool:
    """Return whether any part of a circle with its centre at (x, y) is within ``reach``."""
    far = reach + radius
    return x * x + y * y <= far * far


@kernel
def cast(scene: Scene, rays, n: int, reach: float) -> None:
    """Compute the lengths of rays: obstacles in the outer loop, rays in the inner one, which LLVM vectorizes.

    The rays are in one array at offsets that the compiler knows, so that it needs no check for overlapping arrays.

    Args:
        scene: The room.
        rays: Shape (5 * `BLOCK`,): five runs of up to `BLOCK` numbers: x and y of the rays' origins, close to each other, m; x
            and y of their directions, unit vectors; and their lengths, the output, m.
        n: Number of rays.
        reach: Distance from the first origin beyond which obstacles may be missed, m.
    """
    x, y = rays[_X], rays[_Y]
    at_x, at_y, half_length, half_width = scene.walls[0], scene.walls[1], scene.walls[2], scene.walls[3]
    for ray in range(n):
        rays[_LENGTH + ray] = ray_to_walls(
            at_x - rays[_X + ray], at_y - rays[_Y + ray], inverse(rays[_DX + ray]), inverse(rays[_DY + ray]),
            half_length, half_width,
        )  # fmt: skip
    for k in range(scene.counts[0]):
        at_x, at_y, radius = scene.circles[k, 0], scene.circles[k, 1], scene.circles[k, 2]
        if _is_near(at_x - x, at_y - y, radius, reach):
            for ray in range(n):
                to_x, to_y, dx, dy = at_x - rays[_X + ray], at_y - rays[_Y + ray], rays[_DX + ray], rays[_DY + ray]
                rays[_LENGTH + ray] = min(rays[_LENGTH + ray], ray_to_circle(to_x, to_y, dx, dy, radius * radius))
    for k in range(scene.counts[1]):
        at_x, at_y, half_length, half_width = scene.boxes[k, 0], scene.boxes[k, 1], scene.boxes[k, 2], scene.boxes[k, 3]
        cosine, sine = scene.boxes[k, 4], scene.boxes[k, 5]
        if _is_near(at_x - x, at_y - y, half_length + half_width, reach):
            for ray in range(n):
                to_x, to_y, dx, dy = at_x - rays[_X + ray], at_y - rays[_Y + ray], rays[_DX + ray], rays[_DY + ray]
                ahead, aside = inverse(dx * cosine + dy * sine), inverse(dy * cosine - dx * sine)
                to_x, to_y = to_x * cosine + to_y * sine, to_y * cosine - to_x * sine
                length = ray_to_box(to_x, to_y, ahead, aside, half_length, half_width)
                rays[_LENGTH + ray] = min(rays[_LENGTH + ray], length)
    if scene.squares.shape[1] > 0:
        cosine, sine, resolution = scene.frame[2], scene.frame[3], scene.frame[4]
        for ray in range(n):
            column, row = to_cells(scene.frame, rays[_X + ray], rays[_Y + ray])
            dx, dy = rays[_DX + ray], rays[_DY + ray]
            ahead, aside = dx * cosine + dy * sine, dy * cosine - dx * sine
            length = resolution * ray_to_cells(scene.squares, column, row, ahead, aside, reach / resolution)
            rays[_LENGTH + ray] = min(rays[_LENGTH + ray], length)


@kernel
def clearance(scene: Scene, x: float, y: float) -> float:
    """Return the distance from a point to the nearest surface in the room, m; negative inside of an obstacle.

    On a map it is at most `CLEAR`.
    """
    walls = scene.walls
    nearest = distance_to_walls(walls[0] - x, walls[1] - y, walls[2], walls[3])
    for k in range(scene.counts[0]):
        circle = scene.circles[k]
        nearest = min(nearest, distance_to_circle(circle[0] - x, circle[1] - y, circle[2]))
    for k in range(scene.counts[1]):
        box = scene.boxes[k]
        nearest = min(nearest, distance_to_turned_box(box[0] - x, box[1] - y, box))
    if scene.squares.shape[1] > 0:
        column, row = to_cells(scene.frame, x, y)
        nearest = min(nearest, scene.frame[4] * distance_to_cells(scene.squares, column, row, CLEAR / scene.frame[4]))
    return nearest


@kernel
def walk(scene: Scene, robot: Pose, courtesy: float, dt: float) -> None:
    """Move the walkers by a control interval; they turn back at the walls.

    A walker whose edge is within the courtesy distance of the robot's centre, m, waits instead of coming nearer.
    """
    walls = scene.walls
    for k in range(scene.counts[0]):
        circle = scene.circles[k]
        dx, dy, reach = robot.x - circle[0], robot.y - circle[1], circle[2] + courtesy
        if circle[3] * dx + circle[4] * dy > 0.0 and dx * dx + dy * dy < reach * reach:
            continue
        for axis in range(2):
            room = max(walls[2 + axis] - circle[2], 0.0)
            offset = circle[axis] + circle[3 + axis] * dt - walls[axis]
            outside = (offset > room and circle[3 + axis] > 0.0) or (offset < -room and circle[3 + axis] < 0.0)
            circle[3 + axis] = -circle[3 + axis] if outside else circle[3 + axis]
            circle[axis] += circle[3 + axis] * dt


@kernel
def measure(
    scene: Scene, before: Pose, now: Pose, first: int, last: int, start: float, key: int, lidar: Lidar, dt: float
) -> None:
    """Measure beams while the robot moves from one pose to another, and publish scans as they complete.

    Args:
        scene: The room; receives the ranges and the sectors of the scan.
        before: Pose at the start of the interval.
        now: Pose at its end.
        first: Number of the first beam to measure.
        last: Number after the last beam to measure.
        start: Time at the start of the interval, s.
        key: Key of the episode's scans.
        lidar: The LiDAR.
        dt: The interval, s.
    """
    revolution, turn = int(lidar.beams), wrap(now.theta - before.theta)
    bias, sweeping, newest = bias_of(key, lidar), scene.ranges[0], scene.ranges[1]
    rays = np.empty(5 * BLOCK)
    while first < last:  # in parts within one revolution
        begin = first % revolution
        n = min(min(last - first, revolution - begin), BLOCK)
        cosines, sines, least = scene.beams[0, begin:], scene.beams[1, begin:], scene.beams[2, begin:]
        for ray in range(n):
            share = (time_of_beam(float(first + ray), lidar) - start) / dt
            sine, cosine = sincos(before.theta + share * turn)
            rays[_X + ray] = before.x + share * (now.x - before.x) + lidar.x * cosine - lidar.y * sine
            rays[_Y + ray] = before.y + share * (now.y - before.y) + lidar.x * sine + lidar.y * cosine
            rays[_DX + ray] = cosine * cosines[ray] - sine * sines[ray]
            rays[_DY + ray] = sine * cosines[ray] + cosine * sines[ray]
        cast(scene, rays, n, lidar.range_max + 1.0)
        lengths = rays[_LENGTH:]
        if is_drawn(lidar):
            for ray in range(n):
                lengths[ray] = reading(lengths[ray], least[ray], first + ray, bias, key, lidar)
        else:  # the same numbers in less time
            for ray in range(n):
                lengths[ray] = reading_of(lengths[ray], least[ray], 0.0, 1.0, bias, lidar)
        for ray in range(n):
            sweeping[begin + ray] = lengths[ray]
        if begin + n == revolution:
            for beam in range(revolution):
                newest[beam] = sweeping[beam]
            pool(newest, scene.spans, revolution, scene.sectors)
        first += n
