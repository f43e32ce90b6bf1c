"""What the LiDAR of a robot in a room measures, and how near the room is to the robot."""

from __future__ import annotations

import numpy as np

from turtlebot_gym.kernel import kernel
from turtlebot_gym.models.angles import sincos, wrap
from turtlebot_gym.rooms.cells import distance_to_cells, ray_to_cells, to_cells
from turtlebot_gym.rooms.lidar import Lidar, bias_of, pool, reading, time_of_beam
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
"""Clearance on a map at most, m: farther cells are not looked at."""


@kernel
def cast(scene: Scene, x, y, dx, dy, lengths, reach: float) -> None:
    """Find the lengths of rays: obstacles in the outer loop, rays in the inner one, which LLVM turns into vectors.

    Args:
        scene: The room.
        x: Shape (n,): origins of the rays, near to each other, m.
        y: And their other coordinates.
        dx: Shape (n,): directions, unit vectors.
        dy: And their other coordinates.
        lengths: Shape (n,): where the lengths are written to, m.
        reach: Distance from the first origin beyond which obstacles may be missed, m.
    """
    n, walls = len(lengths), scene.walls
    for ray in range(n):
        lengths[ray] = ray_to_walls(
            walls[0] - x[ray], walls[1] - y[ray], inverse(dx[ray]), inverse(dy[ray]), walls[2], walls[3]
        )
    for k in range(scene.counts[0]):
        at_x, at_y, radius = scene.circles[k, 0], scene.circles[k, 1], scene.circles[k, 2]
        if distance_to_circle(at_x - x[0], at_y - y[0], radius) <= reach:
            for ray in range(n):
                length = ray_to_circle(at_x - x[ray], at_y - y[ray], dx[ray], dy[ray], radius * radius)
                lengths[ray] = min(lengths[ray], length)
    for k in range(scene.counts[1]):
        at_x, at_y, half_length, half_width = scene.boxes[k, 0], scene.boxes[k, 1], scene.boxes[k, 2], scene.boxes[k, 3]
        cosine, sine = scene.boxes[k, 4], scene.boxes[k, 5]
        if distance_to_circle(at_x - x[0], at_y - y[0], half_length + half_width) <= reach:
            for ray in range(n):
                to_x, to_y = at_x - x[ray], at_y - y[ray]
                ahead = inverse(dx[ray] * cosine + dy[ray] * sine)
                aside = inverse(dy[ray] * cosine - dx[ray] * sine)
                to_x, to_y = to_x * cosine + to_y * sine, to_y * cosine - to_x * sine
                lengths[ray] = min(lengths[ray], ray_to_box(to_x, to_y, ahead, aside, half_length, half_width))
    if scene.squares.shape[1] > 0:
        cosine, sine, resolution = scene.frame[2], scene.frame[3], scene.frame[4]
        for ray in range(n):
            column, row = to_cells(scene.frame, x[ray], y[ray])
            ahead, aside = dx[ray] * cosine + dy[ray] * sine, dy[ray] * cosine - dx[ray] * sine
            length = resolution * ray_to_cells(scene.squares, column, row, ahead, aside, reach / resolution)
            lengths[ray] = min(lengths[ray], length)


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
def walk(scene: Scene, dt: float) -> None:
    """Move the circles that walk by a control interval; they turn back at the walls."""
    walls = scene.walls
    for k in range(scene.counts[0]):
        circle = scene.circles[k]
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
    """Measure beams while the robot moves from a pose to another, and publish the scans that become complete.

    Args:
        scene: The room; the ranges and the sectors of the scan are written there.
        before: Pose at the start of the interval.
        now: Pose at its end.
        first: Number of the first beam to measure.
        last: Number of the one after the last.
        start: Time at the start of the interval, s.
        key: Key of the episode's scans.
        lidar: The LiDAR.
        dt: The interval, s.
    """
    revolution, turn = int(lidar.beams), wrap(now.theta - before.theta)
    bias, sweeping, newest = bias_of(key, lidar), scene.ranges[0], scene.ranges[1]
    while first < last:  # in parts that lie in one revolution
        begin = first % revolution
        n = min(last - first, revolution - begin)
        cosines, sines, least = scene.beams[0, begin:], scene.beams[1, begin:], scene.beams[2, begin:]
        rays = np.empty((5, n))
        x, y, dx, dy, lengths = rays[0], rays[1], rays[2], rays[3], rays[4]
        for ray in range(n):
            share = (time_of_beam(float(first + ray), lidar) - start) / dt
            sine, cosine = sincos(before.theta + share * turn)
            x[ray] = before.x + share * (now.x - before.x) + lidar.x * cosine - lidar.y * sine
            y[ray] = before.y + share * (now.y - before.y) + lidar.x * sine + lidar.y * cosine
            dx[ray] = cosine * cosines[ray] - sine * sines[ray]
            dy[ray] = sine * cosines[ray] + cosine * sines[ray]
        cast(scene, x, y, dx, dy, lengths, lidar.range_max + 1.0)
        for ray in range(n):
            lengths[ray] = reading(lengths[ray], least[ray], first + ray, bias, key, lidar)
        for ray in range(n):
            sweeping[begin + ray] = lengths[ray]
        if begin + n == revolution:
            for beam in range(revolution):
                newest[beam] = sweeping[beam]
            pool(newest, scene.spans, revolution, scene.sectors)
        first += n
