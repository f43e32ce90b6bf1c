"""Starts and goals that a reset has been given."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.compiled.batch import Batch
from turtlebot_gym.config import short_repr
from turtlebot_gym.rooms.plan import FloorPlan
from turtlebot_gym.rooms.worlds import with_options
from turtlebot_gym.systems import Parameters, make_room
from turtlebot_gym.tasks import StartAndGoal, Task, given_pose

POSES = ("start", "goal")
"""Options of a reset that are poses."""


def on_open_ground(options: Mapping[str, Any], task: Task) -> StartAndGoal:
    """Return start and goal that are given to an episode on open ground.

    Raises:
        ValueError: If a pose is malformed, or the task does not draw start and goal.
    """
    given = {name: options[name] for name in POSES if name in options}
    if given and not task.random:
        raise ValueError(
            f"{' and '.join(given)} cannot be given at a reset: this task starts at the origin and drives through given "
            "waypoints; make the environment with waypoints=[(x, y, heading), ...]."
        )
    return StartAndGoal(**{name: given_pose(name, value) for name, value in given.items()})


def by_row(options: Mapping[str, Any], mask: NDArray[np.bool_]) -> dict[int, dict[str, Any]]:
    """Return the poses that the options of a vector environment's reset give to each row in a mask; nothing without any.

    Raises:
        ValueError: If they are neither one pose for all rows nor one for each.
    """
    size, poses = len(mask), {name: options[name] for name in POSES if name in options}
    for name, value in poses.items():
        if _shape(value) not in ((2,), (3,), (size, 2), (size, 3)):
            raise ValueError(f"{name} must be x, y and perhaps a heading, or those of each of {size}, got {short_repr(value)}.")
    return {
        row: {name: value[row] if np.ndim(value) == 2 else value for name, value in poses.items()}
        for row in (np.flatnonzero(mask).tolist() if poses else ())
    }


class RoomPoses:
    """Exchanges the parameters of rows in rooms for one episode each, and restores them when the row's next episode begins.

    Args:
        batch: The environments.
        plan: Their floor plan, if it is given.
    """

    def __init__(self, batch: Batch, plan: FloorPlan | None) -> None:
        self._batch, self._plan = batch, plan
        self._usual: dict[int, Parameters] = {}

    def forget(self) -> None:
        """Forget the parameters to restore, because others were set."""
        self._usual = {}

    def read(self, options: Mapping[str, Any], mask: NDArray[np.bool_]) -> dict[int, Parameters]:
        """Return the parameters of an episode for each row in a mask; none where no pose is given.

        Raises:
            ValueError: If a pose is malformed, outside of the room or inside a given obstacle.
        """
        parameters: dict[int, Parameters] = {}
        for row, own in by_row(options, mask).items():
            usual = self._usual.get(row, self._batch.parameters_of(row))
            rules, lidar = usual.room
            parameters[row] = usual._replace(room=make_room(with_options(self._plan or rules, own), lidar, usual.dt))
        return parameters

    def begin(self, mask: NDArray[np.bool_], asked: Mapping[int, Parameters]) -> None:
        """Set the parameters, asked for or usual, of rows whose episodes begin."""
        if not asked and not self._usual:
            return
        parameters = self._batch.parameters
        rows = [parameters] * self._batch.num_envs if isinstance(parameters, Parameters) else list(parameters)
        for row in [row for row in self._usual if mask[row]]:
            rows[row] = self._usual.pop(row)
        for row, own in asked.items():
            self._usual[row], rows[row] = rows[row], own
        self._batch.set_parameters(rows[0] if all(row is rows[0] for row in rows) else rows)


def _shape(value: Any) -> tuple[int, ...] | None:
    """Return the shape of an array or of nested sequences; None where their lengths differ."""
    try:
        return np.shape(value)
    except ValueError:
        return None
