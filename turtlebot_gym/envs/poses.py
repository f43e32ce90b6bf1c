"""Starts and goals that a reset of a vector environment of rooms has been given."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.compiled.batch import Batch
from turtlebot_gym.rooms.plan import FloorPlan
from turtlebot_gym.rooms.worlds import with_options
from turtlebot_gym.systems import Parameters, make_room
from turtlebot_gym.validation import short_repr

_POSES = ("start", "goal")


class GivenPoses:
    """Exchanges the parameters of rows for one episode each, and restores them when the row's next episode begins.

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
        poses = {name: options[name] for name in _POSES if name in options}
        size = self._batch.num_envs
        for name, value in poses.items():
            if _shape(value) not in ((3,), (size, 3)):
                raise ValueError(f"{name} must be x, y and heading, or those of each of {size}, got {short_repr(value)}.")
        parameters: dict[int, Parameters] = {}
        for row in np.flatnonzero(mask).tolist() if poses else ():
            usual = self._usual.get(row, self._batch.parameters_of(row))
            rules, lidar = usual.room
            own = {name: value[row] if np.ndim(value) == 2 else value for name, value in poses.items()}
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
