"""Circles that walk: straight on from wall to wall, or as people, by the social force model.

References:
    Helbing, Molnár, "Social force model for pedestrian dynamics", *Physical Review E* 51 (1995), equations 2 to 10.
"""

from __future__ import annotations

from typing import Any

from turtlebot_gym.kernel import kernel, sqrt
from turtlebot_gym.rooms.scene import Scene
from turtlebot_gym.values import Pose

STANDS = 1e-3
"""Greatest distance that a standing robot moves in a control interval, m."""
# The numbers of the paper.
_RELAXATION = 0.5
"""Time in which people take up their pace, s."""
_OTHERS, _OTHERS_WIDTH = 2.1, 0.3
"""Strength (m^2/s^2) and width (m) of the repulsion by others."""
_WALLS, _WALLS_WIDTH = 10.0, 0.2
"""The same for walls and boxes."""
_STRIDE = 2.0
"""Time for which the steps of others are anticipated, s."""
_BESIDE = -0.17364817766693033
"""Cosine of half the angle of sight, 100 degrees ..."""
_UNSEEN = 0.5
"""... and weight of what is outside of it."""
_HASTE = 1.3
"""Greatest speed as a multiple of the pace."""
# Where people turn round, which the paper leaves open.
_THERE = 0.5
"""Distance at which they have reached their place, m."""
_STUCK = 0.05
"""Speed below which they give it up, m/s."""


@kernel
def _decay(x: float) -> float:
    """Return exp(-x) for x >= 0, to 1e-11; the same bits everywhere, unlike the function of the C library."""
    y = min(x, 60.0) * -0.015625  # exp(-x) = exp(-x / 64)^64
    term, value = 1.0, 1.0
    for n in range(1, 12):
        term = term * y / n
        value += term
    for _ in range(6):
        value *= value
    return value


@kernel
def _repulsion(dx: float, dy: float, ahead_x: float, ahead_y: float) -> tuple[float, float]:
    """Return the repulsion by another at an offset (dx, dy) behind us, who will walk (ahead_x, ahead_y); m/s^2."""
    then_x, then_y = dx - ahead_x, dy - ahead_y
    now, then = max(sqrt(dx * dx + dy * dy), 1e-3), max(sqrt(then_x * then_x + then_y * then_y), 1e-3)
    both, stride = now + then, ahead_x * ahead_x + ahead_y * ahead_y
    axis = max(0.5 * sqrt(max(both * both - stride, 0.0)), 0.05)  # of the ellipse
    force = _OTHERS / _OTHERS_WIDTH * _decay(axis / _OTHERS_WIDTH) * both / (4.0 * axis)
    return force * (dx / now + then_x / then), force * (dy / now + then_y / then)


@kernel
def _seen(force: tuple[float, float], to_x: float, to_y: float) -> tuple[float, float]:
    """Return a force, weaker if what exerts it is behind somebody who looks along the unit vector (to_x, to_y)."""
    fx, fy = force
    weight = 1.0 if -(to_x * fx + to_y * fy) >= _BESIDE * sqrt(fx * fx + fy * fy) else _UNSEEN
    return weight * fx, weight * fy


@kernel
def _by_box(x: float, y: float, box: Any) -> tuple[float, float]:
    """Return the repulsion by a turned box at a point, m/s^2."""
    dx, dy, cosine, sine = x - box[0], y - box[1], box[4], box[5]
    ahead, aside = dx * cosine + dy * sine, dy * cosine - dx * sine
    off_ahead, off_aside = ahead - min(max(ahead, -box[2]), box[2]), aside - min(max(aside, -box[3]), box[3])
    away = sqrt(off_ahead * off_ahead + off_aside * off_aside)
    force = _WALLS / _WALLS_WIDTH * _decay(away / _WALLS_WIDTH)
    if away == 0.0:  # inside: away from its middle
        off_ahead, off_aside, away = ahead, aside, max(sqrt(ahead * ahead + aside * aside), 1e-3)
    off_ahead, off_aside = force * off_ahead / away, force * off_aside / away
    return off_ahead * cosine - off_aside * sine, off_ahead * sine + off_aside * cosine


@kernel
def _acceleration(scene: Scene, k: int, robot: Pose, vx: float, vy: float) -> tuple[float, float]:
    """Return the acceleration of a person, m/s^2; the robot moves at (vx, vy), m/s."""
    circle, person, walls, wide = scene.room.circles[k], scene.room.people[k], scene.room.walls, _WALLS_WIDTH
    x, y = circle[0], circle[1]
    to_x, to_y = person[0] - x, person[1] - y
    far = max(sqrt(to_x * to_x + to_y * to_y), 1e-3)
    to_x, to_y = to_x / far, to_y / far
    ax, ay = (person[4] * to_x - circle[3]) / _RELAXATION, (person[4] * to_y - circle[4]) / _RELAXATION
    left, right = _decay(max(x - walls[0] + walls[2], 0.0) / wide), _decay(max(walls[0] + walls[2] - x, 0.0) / wide)
    below, above = _decay(max(y - walls[1] + walls[3], 0.0) / wide), _decay(max(walls[1] + walls[3] - y, 0.0) / wide)
    ax, ay = ax + _WALLS / wide * (left - right), ay + _WALLS / wide * (below - above)
    for j in range(scene.room.counts[1]):
        fx, fy = _by_box(x, y, scene.room.boxes[j])
        ax, ay = ax + fx, ay + fy
    for j in range(scene.room.counts[0]):
        other = scene.room.circles[j]
        if j != k:
            fx, fy = _seen(_repulsion(x - other[0], y - other[1], _STRIDE * other[3], _STRIDE * other[4]), to_x, to_y)
            ax, ay = ax + fx, ay + fy
    if person[5] > 0.0:
        fx, fy = _seen(_repulsion(x - robot.x, y - robot.y, _STRIDE * vx, _STRIDE * vy), to_x, to_y)
        ax, ay = ax + fx, ay + fy
    return ax, ay


@kernel
def _stroll(scene: Scene, robot: Pose, vx: float, vy: float, radius: float, dt: float) -> None:
    """Move people by a control interval; each walks back and forth between two places."""
    for k in range(scene.room.counts[0]):
        circle, person = scene.room.circles[k], scene.room.people[k]
        dx, dy, speed = person[0] - circle[0], person[1] - circle[1], circle[3] * circle[3] + circle[4] * circle[4]
        if dx * dx + dy * dy < _THERE * _THERE or speed < _STUCK * _STUCK:
            person[0], person[1], person[2], person[3] = person[2], person[3], person[0], person[1]
        if person[4] != 0.0:
            ax, ay = _acceleration(scene, k, robot, vx, vy)
            walk_x, walk_y = circle[3] + ax * dt, circle[4] + ay * dt
            slower = min(1.0, _HASTE * person[4] / max(sqrt(walk_x * walk_x + walk_y * walk_y), 1e-9))
            circle[3], circle[4] = walk_x * slower, walk_y * slower
        circle[0] += circle[3] * dt
        circle[1] += circle[4] * dt
        if (vx * vx + vy * vy) * dt * dt <= STANDS * STANDS:  # nobody walks through a robot that stands
            dx, dy, reach = circle[0] - robot.x, circle[1] - robot.y, circle[2] + radius
            near = max(sqrt(dx * dx + dy * dy), 1e-3)
            if near < reach:
                circle[0], circle[1] = robot.x + dx * reach / near, robot.y + dy * reach / near


@kernel
def walk(scene: Scene, before: Pose, robot: Pose, radius: float, rules: Any, dt: float) -> None:
    """Move the walkers by a control interval.

    A walker that walks straight on turns back at the walls; one whose edge is within ``rules.courtesy`` of the robot's centre
    waits instead of coming nearer. People walk by the social force model; a person without sight of the robot may run into it.
    A person with a pace of 0 walks straight on at the velocity in ``scene.room.circles``, which another model may set.

    The robot, whose radius is in m, moves from the pose ``before`` to ``robot`` in the interval, s.
    """
    if rules.people:
        _stroll(scene, robot, (robot.x - before.x) / dt, (robot.y - before.y) / dt, radius, dt)
        return
    walls, courtesy = scene.room.walls, rules.courtesy
    for k in range(scene.room.counts[0]):
        circle = scene.room.circles[k]
        if circle[3] == 0.0 and circle[4] == 0.0:
            continue
        dx, dy, reach = before.x - circle[0], before.y - circle[1], circle[2] + courtesy
        if circle[3] * dx + circle[4] * dy > 0.0 and dx * dx + dy * dy < reach * reach:
            continue
        for axis in range(2):
            room = max(walls[2 + axis] - circle[2], 0.0)
            offset = circle[axis] + circle[3 + axis] * dt - walls[axis]
            outside = (offset > room and circle[3 + axis] > 0.0) or (offset < -room and circle[3 + axis] < 0.0)
            circle[3 + axis] = -circle[3 + axis] if outside else circle[3 + axis]
            circle[axis] += circle[3 + axis] * dt
