"""Rooms whose fields are known, and exact scans of them."""

import math
from typing import Any, NamedTuple

import numpy as np

from turtlebot_gym.localization.information import ScanPoints
from turtlebot_gym.rooms.field import field_of_cells, sample

SIDE = 0.05


class Room(NamedTuple):
    """A map, as field and frame, and its occupied cells."""

    occupied: Any
    field: Any
    frame: Any


def make_room(occupied, yaw=0.0, corner=(0.0, 0.0)):
    """Return the room of some occupied cells, turned about its corner."""
    field = np.empty(occupied.shape, np.float32)
    field_of_cells(occupied, SIDE, field)
    return Room(occupied, field, np.array([*corner, math.cos(yaw), math.sin(yaw), SIDE]))


def sight(room, points):
    """Return a scan, and the map of the room in which it is sought."""
    return ScanPoints(room.field, room.frame, points, points.shape[1])


def off(located, pose):
    """Return by how much a belief is off a pose, m and rad."""
    mean = located.belief.mean
    return math.hypot(mean.x - pose[0], mean.y - pose[1]), abs(math.remainder(mean.theta - pose[2], 2.0 * math.pi))


def nonsense(rng, low, high, number=40):
    """Return a scan that no pose explains."""
    angles, lengths = np.linspace(0.0, 2.0 * math.pi, number, endpoint=False), rng.uniform(low, high, number)
    return np.array([lengths * np.cos(angles), lengths * np.sin(angles), np.cos(angles), np.sin(angles), lengths])


def empty_hall():
    """Return a hall of 5 m by 4 m of which each half looks like the other."""
    occupied = np.ones((92, 112), np.bool_)
    occupied[6:86, 6:106] = False
    return occupied


def hall():
    """Return that hall with an inner wall and a pillar: no pose in it looks like another."""
    occupied = empty_hall()
    occupied[6:50, 60:66] = True
    occupied[60:70, 20:28] = True
    return occupied


def corridor():
    """Return a corridor of 2 m without ends, along the rows."""
    occupied = np.zeros((60, 400), np.bool_)
    occupied[:10], occupied[50:] = True, True
    return occupied


def scan_of(room, pose, number=40, reach=20.0):
    """Return exact points, shape (5, n), by small steps along each beam to where the field is zero."""
    x, y, theta = pose
    points = []
    for angle in np.linspace(0.1, 0.1 + 2.0 * math.pi, number, endpoint=False):
        dx, dy, length, known = math.cos(theta + angle), math.sin(theta + angle), 0.0, True
        while length < reach:
            known, d, _, _ = sample(room.field, room.frame, x + length * dx, y + length * dy)
            if not known or abs(d) < 1e-9:
                break
            length += 0.9 * d if abs(d) > 1e-6 else d
        if known and length < reach:
            points.append((length * math.cos(angle), length * math.sin(angle), math.cos(angle), math.sin(angle), length))
    return np.array(points).T.copy()
