"""What the environments share: spaces, arguments, and where ``info`` lies in a world."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.error import InvalidAction
from numpy.typing import NDArray

from turtlebot_gym.compiled.batch import Batch
from turtlebot_gym.config import POSITIVE_OR_INFINITE, as_int, refusal, short_repr, split
from turtlebot_gym.estimation.filters import matrix
from turtlebot_gym.observations.columns import bounds_of
from turtlebot_gym.systems import Options, Outcome, Setup, System
from turtlebot_gym.tasks import Task

PARTS = {"true_state": "body.true_state", "odometry": "senses.odometry.pose", "estimate": "estimate.belief.mean"}
PARTS |= {"covariance": "estimate.belief.covariance", "reference": "course.reference", "command": "body.command"}
"""Keys of ``info`` that are parts of a world, with their paths in `turtlebot_gym.systems.Snapshot`."""

ROOM_PARTS = {"clearance": "room.clearance", "path_length": "room.path_length", "way_left": "room.way"}
ROOM_PARTS |= {"collision": "room.collided"}
"""Further ones in a room, single numbers."""

FLAGS = ("measured", "slipping", "collision")
"""Single numbers that are booleans."""

FIRST_SHARE = Outcome._fields.index("shares")
"""The first row of the reward's shares in outcomes."""

_FLOAT = np.dtype(np.float32)


def indices_of(batch: Batch, key: str, path: str) -> NDArray[np.intp]:
    """Return the indices of a part of a world in its shape, (3, 3) for a covariance and () for a number."""
    world = batch.layout.world
    if path in world.names:
        return np.array(world.names.index(path))
    part = np.arange(len(world.names))[world.slices[path]]
    return matrix(part) if key == "covariance" else part


def spaces_of(system: System) -> tuple[spaces.Space[NDArray[np.float32]], spaces.Space[NDArray[np.float32]]]:
    """Return new spaces of actions, shares of the robot's limits, and of observations."""
    low, high = (np.array(bounds, np.float32) for bounds in bounds_of(system.terms))
    return spaces.Box(-1.0, 1.0, (2,), np.float32), spaces.Box(low, high)


def with_limit(options: Options, steps: float) -> Setup:
    """Return what options stand for, with a limit of steps; that of a task of the caller's own counts, too."""
    setup, steps = options.setup(), POSITIVE_OR_INFINITE.check("max_episode_steps", steps)
    task, (based_on, given) = setup.parameters.task, split(options.task)
    has_own = isinstance(based_on, Task) or "max_steps" in given
    task = replace(task, max_steps=min(steps, task.max_steps) if has_own else steps)
    return setup._replace(parameters=setup.parameters._replace(task=task))


def read_seeds(seed: Any, num_envs: int) -> list[int | None]:
    """Return the seed of each environment: ``seed + i`` for a whole number, those of a sequence, None where there is none.

    They may be as large as those that Gymnasium draws; only the lowest 63 bits of each are used.
    """
    if seed is None:
        return [None] * num_envs
    if not isinstance(seed, (list, tuple, np.ndarray)) or getattr(seed, "shape", None) == ():
        first = as_int("seed", seed)
        return [first + row for row in range(num_envs)]
    if len(seed) != num_envs:
        raise ValueError(f"seed must hold {num_envs} seeds, got {len(seed)}.")
    return [None if given is None else as_int(f"seed[{row}]", given) for row, given in enumerate(seed)]


def read_actions(actions: Any, shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Return actions as an array, whose numbers may be infinite; an `InvalidAction` says why it cannot be one of a shape."""
    if type(actions) is np.ndarray and actions.dtype is _FLOAT and actions.shape == shape:
        return actions
    try:
        values = np.asarray(actions)
    except ValueError:  # rows of different lengths
        values = np.asarray(None)
    if values.dtype.kind not in "biuf":
        raise InvalidAction(f"An action must hold real numbers, got {short_repr(actions)}.")
    if values.shape != shape:
        raise InvalidAction(f"Actions have shape {shape}, got {values.shape}.")
    return np.asarray(values, np.float32)


def read_options(options: Any, known: Sequence[str]) -> dict[str, Any]:
    """Return the options of a reset, or raise the `refusal` of what is no mapping and of an unknown one."""
    if options is not None and not isinstance(options, Mapping):
        raise refusal("options", "a mapping", options)
    for name in options or ():
        if name not in known:
            raise refusal("options", f"among {', '.join(map(repr, known))}", name)
    return dict(options or {})
