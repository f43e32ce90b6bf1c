"""The oracle, which knows map and true pose, and follows the shortest path."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.compiled.program import in_machine_code
from turtlebot_gym.envs.navigation_vector import NavigationVectorEnv
from turtlebot_gym.kernel import kernel, sqrt
from turtlebot_gym.rooms.geodesic import UNREACHED, cell_of, centre_of, extent
from turtlebot_gym.rooms.scene import RESOLUTION, scene_at
from turtlebot_gym.rooms.sensing import clearance
from turtlebot_gym_agents.policies import BearingPolicy
from turtlebot_gym_agents.policies.fit import parameters_of
from turtlebot_gym_agents.policies.sight import arc

LOOK = 20
"""Number of path cells that the oracle looks ahead."""
KEPT = 0.04
"""Clearance around the robot where the oracle leaves the path's cells to drive straight, m."""


class Oracle:
    """Drive towards the farthest point of the shortest path that a straight line reaches, in rooms only; observations are
    not used.
    """

    def __init__(self, envs: Any) -> None:
        bare = envs.unwrapped
        if not isinstance(bare, NavigationVectorEnv) or not parameters_of(bare).room:
            raise ValueError(f"the oracle needs a room: there is no map of {bare.spec.id if bare.spec else bare}.")
        self._envs, self._p = bare, parameters_of(bare)
        self._drive = BearingPolicy(self._p.robot, self._p.dt, tolerance=0.0)

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Do nothing: it remembers nothing, but drives all environments in each step."""

    def __call__(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return actions (n, 2) of all environments; the observations are ignored."""
        scenes, states, goals = self._envs.truth()
        targets = np.empty((len(states), 2))
        _find_targets(scenes, states, goals, self._p.robot.radius + KEPT, targets)
        moved, turned = arc(states[:, 3], states[:, 4], self._p.dt)
        # Into the body frame, as complex numbers.
        to = (targets - states[:, :2]) @ np.array([1.0, 1j]) * np.exp(-1j * states[:, 2])
        return self._drive.steer((to - moved) * np.conj(turned))


@kernel
def _follow(scene, x, y, distance, target):
    """Write the farthest point that a straight line reaches, or the nearest."""
    row, column = _best_near(scene, *cell_of(scene, x, y))
    target[0], target[1] = centre_of(scene, row, column)
    for _ in range(LOOK):
        row, column = _best_near(scene, row, column)
        to_x, to_y = centre_of(scene, row, column)
        if _is_clear(scene, x, y, to_x, to_y, distance):
            target[0], target[1] = to_x, to_y


@kernel
def _best_near(scene, row, column):
    """Return the cell with the shortest path among a cell and its eight neighbours."""
    rows, columns = extent(scene)
    best_row, best_column, best = row, column, UNREACHED - 1
    for near_row in range(max(row - 1, 0), min(row + 2, rows)):
        for near_column in range(max(column - 1, 0), min(column + 2, columns)):
            if scene.room.ways[near_row, near_column] < best:
                best_row, best_column, best = near_row, near_column, scene.room.ways[near_row, near_column]
    return best_row, best_column


@kernel
def _is_clear(scene, x, y, to_x, to_y, distance):
    dx, dy = to_x - x, to_y - y
    parts = int(sqrt(dx * dx + dy * dy) / (0.5 * RESOLUTION)) + 1
    nearest = distance
    for part in range(1, parts + 1):
        nearest = min(nearest, clearance(scene, x + dx * part / parts, y + dy * part / parts))
    return nearest >= distance


@in_machine_code("targets of the oracle")
def _find_targets(scenes, states, goals, distance, targets):
    for at in range(len(states)):
        scene = scene_at(scenes, at)
        x, y = states[at, 0], states[at, 1]
        targets[at] = goals[at, :2]
        if not _is_clear(scene, x, y, goals[at, 0], goals[at, 1], distance):
            _follow(scene, x, y, distance, targets[at])
