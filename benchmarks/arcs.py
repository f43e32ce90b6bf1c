"""Drive around what is tracked: of some arcs, the one that ends nearest to where a policy wants to be, or a stop.

References:
    Fox, Burgard, Thrun, "The dynamic window approach to collision avoidance" (1997): arcs of constant speeds, sampled.
"""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.observations import ROOM
from turtlebot_gym.observations.columns import slices_of
from turtlebot_gym.robots import Robot
from turtlebot_gym.rooms.lidar import SIGHT
from turtlebot_gym_agents.policies.sight import DIRECTIONS, arc

STEP = 0.1
"""Time between the poses of an arc that are compared, s."""
SAMPLES = np.array(list(itertools.product((1.0, 0.5), (-0.8, -0.4, 0.0, 0.4, 0.8))))
"""Actions that are tried beside the policy's own, and half of its speed."""
ASIDE = 0.03
"""Least distance from what the scan shows, m."""
TURNS = 0.05
"""Length that counts as much as a difference of 1 rad/s, m."""
SCAN = slices_of(ROOM)["scan"]


def around(
    actions: NDArray[np.float64],
    observations: NDArray[np.float32],
    tracks: NDArray[np.float64],
    robot: Robot,
    horizon: float,
    gap: float,
) -> NDArray[np.float64]:
    """Return actions whose arcs keep away from tracks that move on straight.

    Args:
        actions: Actions of a policy, shape (n, 2).
        observations: Observations that begin with those of rooms, shape (n, ...).
        tracks: Shape (n, tracks, 8), see `turtlebot_gym.observations.TRACKS`.
        robot: The robot.
        horizon: Time that is looked ahead, s.
        gap: Least clearance of the robot from a track, m.
    """
    number = len(actions)
    own = np.stack((actions, actions * (0.5, 1.0)), 1)
    tried = np.concatenate((own, np.broadcast_to(SAMPLES, (number, *SAMPLES.shape))), 1)
    times = STEP * np.arange(1, round(horizon / STEP) + 1)
    poses, _ = arc(tried[..., :1] * robot.max_linear, tried[..., 1:] * robot.max_angular, times)
    free = np.ones(tried.shape[:2], np.bool_)
    for track in np.moveaxis(tracks, 1, 0):
        place = (track[:, 0] + 1j * track[:, 1])[:, None] + (track[:, 2] + 1j * track[:, 3])[:, None] * times
        comes = (abs(place[:, None] - poses) < robot.radius + gap + track[:, 6, None, None]).any(axis=-1)
        free &= ~(comes & (track[:, 7] > 0.0)[:, None])
    ranges = observations[:, SCAN].astype(float)
    points = DIRECTIONS * ranges * SIGHT + robot.lidar.x
    for sector in range(points.shape[1]):
        hits = (abs(points[:, sector, None, None] - poses) < robot.radius + ASIDE).any(axis=-1)
        free[:, len(own[0]) :] &= ~(hits & (ranges[:, sector] < 1.0)[:, None])[:, len(own[0]) :]
    turning = TURNS * robot.max_angular * abs(tried[..., 1] - actions[:, None, 1])
    cost = np.where(free, abs(poses[..., -1] - poses[:, :1, -1]) + turning, np.inf)
    stands = abs(poses[:, :1, -1])
    best = np.concatenate((cost, stands), 1).argmin(axis=1)
    chosen = np.concatenate((tried, np.zeros((number, 1, 2))), 1)[np.arange(number), best]
    return np.asarray(chosen)
