"""What both environments share: spaces, arguments and ``info``."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.error import InvalidAction
from numpy.typing import NDArray

from turtlebot_gym.compiled.batch import Batch
from turtlebot_gym.config import POSITIVE_OR_INFINITE, as_int, short_repr
from turtlebot_gym.estimation.filters import matrix
from turtlebot_gym.observations import bounds_of
from turtlebot_gym.rooms.geodesic import MARGIN
from turtlebot_gym.rooms.worlds import require_a_way
from turtlebot_gym.systems import Options, Outcome, Parameters, Setup, System
from turtlebot_gym.tasks import StartAndGoal, Task, given_pose

PARTS = {
    "true_state": "body.true_state",
    "odometry": "senses.odometry.pose",
    "estimate": "estimate.belief.mean",
    "covariance": "estimate.belief.covariance",
    "reference": "course.reference",
    "command": "body.command",
}
"""Keys of ``info`` that are parts of a world, with their paths in `turtlebot_gym.systems.Snapshot`."""

NUMBERS = {"nis": "estimate.nis", "measured": "senses.odometry.measured", "slipping": "body.slipping"}
"""Single numbers that the vector environment reports: the normalized innovation squared of the last measurement, which
the policy sees clipped; whether a measurement arrived; and whether the wheels slip."""

ROOM_PARTS = {
    "clearance": "room.clearance",
    "path_length": "room.path_length",
    "way_left": "room.way",
    "collision": "room.collided",
}
"""Further ones in a room."""


FIRST_SHARE = Outcome._fields.index("shares")
"""The first row of the reward's shares in outcomes."""


POSES = ("start", "goal")
"""Options of a reset of one environment that are poses."""


def given_poses(options: Mapping[str, Any], task: Task) -> StartAndGoal:
    """Return start and goal that are given to an episode on open ground.

    Raises:
        ValueError: If a pose is malformed, or the task does not draw start and goal.
    """
    given = {name: given_pose(name, options[name]) for name in POSES if name in options}
    if given and not task.random:
        raise ValueError(
            f"{' and '.join(given)} cannot be given at a reset: this task starts at the origin and drives through given "
            "waypoints; make the environment with waypoints=[(x, y, heading), ...]."
        )
    return StartAndGoal(**given)


def reward_terms(system: System) -> tuple[str, ...]:
    """Return the names of the terms of the reward, in the order of their shares."""
    return tuple(term.name for term in system.rewards)


FLAGS = ("measured", "slipping", "collision")
"""Single numbers that are booleans."""


IN_MATRIX = matrix(np.arange(8)).astype(np.intp)
"""Index of the number at each place of a covariance matrix, shape (5, 5); at places without one it means nothing ..."""
IS_NUMBER = matrix(np.ones(8))
"""... and this is 0."""


def indices_of(batch: Batch, key: str, path: str) -> NDArray[np.intp]:
    """Return the indices of a part of a world, or of a number, shape (1,); those of a covariance are `IN_MATRIX`."""
    world = batch.layout.world
    if path in world.names:
        return np.array([world.names.index(path)])
    part = np.arange(len(world.names))[world.slices[path]]
    return part[IN_MATRIX] if key == "covariance" else part


class InfoReader:
    """What ``info`` holds of the worlds of a batch: parts of an array in which each row is a number of all environments.

    Args:
        batch: The batch; it is asked for these numbers from now on.
        parts: Paths of parts and numbers of a world, by key.
    """

    def __init__(self, batch: Batch, parts: Mapping[str, str]) -> None:
        self._slices: list[tuple[str, slice]] = []
        self._numbers: list[tuple[str, int, bool]] = []
        self._covariance: tuple[str, slice] | None = None
        chosen, end = [indices_of(batch, key, path) for key, path in parts.items()], 0
        for (key, path), indices in zip(parts.items(), chosen, strict=True):
            start, end = end, end + indices.size
            if path in batch.layout.world.names:
                self._numbers.append((key, start, key in FLAGS))
            elif key == "covariance":
                self._covariance = key, slice(start, end)
            else:
                self._slices.append((key, slice(start, end)))
        self._batch, self.is_empty = batch, not chosen
        batch.select(*chosen)

    def now(self) -> dict[str, NDArray[Any]]:
        """Return the parts, with environments first, as views where possible."""
        numbers = self._batch.selected()
        info: dict[str, NDArray[Any]] = {key: numbers[part].T for key, part in self._slices}
        if self._covariance:
            key, part = self._covariance
            info[key] = numbers[part].reshape(5, 5, -1).transpose(2, 0, 1) * IS_NUMBER
        for key, at, is_flag in self._numbers:
            info[key] = numbers[at] != 0.0 if is_flag else numbers[at]
        return info


_FLOAT = np.dtype(np.float32)
_FEW = 8192  # a BLAS shares the work on longer arrays among threads, which a step must not wake


def spaces_of(system: System) -> tuple[spaces.Space[NDArray[np.float32]], spaces.Space[NDArray[np.float32]]]:
    """Return new spaces of actions, shares of the robot's limits, and of observations."""
    low, high = (np.array(bounds, np.float32) for bounds in bounds_of(system.terms))
    return spaces.Box(-1.0, 1.0, (2,), np.float32), spaces.Box(low, high)


def make_batch(setup: Setup, num_envs: int, *, shares: bool) -> Batch:
    """Make the batch of an environment, with or without the shares of the reward.

    Raises:
        ValueError: If a given room has no path from start to goal.
    """
    parameters, waypoints, plan, system = setup
    if plan:
        first = Batch(1, parameters, waypoints, system=system, plan=plan)
        first.reset(np.ones(1, np.bool_), *first.empty())
        require_a_way(plan, parameters.robot.radius, float(first.numbers("room.way")[0]))
    return Batch(num_envs, parameters, waypoints, system=system, plan=plan, shares=shares)


def with_limit(options: Options, steps: float | None) -> Setup:
    """Return what options stand for, with a limit of steps instead of the task's own; None for the task's own.

    Raises:
        ValueError: If a task of the caller's own has another limit.
    """
    setup = options.setup()
    max_steps = setup.parameters.task.max_steps
    if steps is None:
        return setup
    limited = options.limits_steps and max_steps < math.inf
    if limited and POSITIVE_OR_INFINITE.check("max_episode_steps", steps) != max_steps:
        raise ValueError(
            f"task ends episodes after {max_steps:g} steps (Task.max_steps), max_episode_steps after {steps:g}: make them "
            "equal, or Task.max_steps infinite."
        )
    return setup._replace(parameters=setup.parameters._replace(task=replace(setup.parameters.task, max_steps=steps)))


def no_way(parameters: Parameters) -> str:
    """Return why a robot cannot reach its goal."""
    radius = parameters.robot.radius
    return f"No way leads from start to goal for a robot of radius {radius:g} m that keeps {MARGIN:g} m to everything."


def read_seeds(seed: Any, num_envs: int) -> list[int | None]:
    """Return the seed of each environment: ``seed + i`` for a whole number, those of a sequence, None where there is none.

    They may be as large as those that Gymnasium draws; only the lowest 63 bits of each are used.

    Raises:
        ValueError: If it is something else, negative, or a sequence of another length.
    """
    if seed is None:
        return [None] * num_envs
    if not isinstance(seed, (list, tuple, np.ndarray)) or getattr(seed, "shape", None) == ():
        first = as_int("seed", seed)
        return [first + row for row in range(num_envs)]
    if len(seed) != num_envs:
        raise ValueError(f"seed must hold {num_envs} seeds, got {len(seed)}.")
    return [None if given is None else as_int(f"seed[{row}]", given) for row, given in enumerate(seed)]


def read_actions(actions: Any) -> NDArray[np.float32]:
    """Return actions as an array of their shape.

    Raises:
        InvalidAction: If they hold something else than real numbers.
    """
    if type(actions) is np.ndarray and actions.dtype is _FLOAT:  # the usual case, in a tenth of a microsecond
        return actions
    try:
        values = np.asarray(actions)
    except ValueError:  # rows of different lengths
        values = np.asarray(None)
    if values.dtype.kind not in "biuf":
        raise InvalidAction(f"An action must hold real numbers, got {short_repr(actions)}.")
    return np.asarray(values, np.float32)


def is_finite(values: NDArray[np.float32]) -> bool:
    """Return whether all actions of an array are finite."""
    few = values.size <= _FEW and values.flags.c_contiguous
    flat = values.reshape(-1)
    # The sum of squares is finite only if all are, and takes a fifth of the time.
    return (few and math.isfinite(flat.dot(flat))) or bool(np.isfinite(values).all())


def read_options(options: Any, known: Sequence[str]) -> dict[str, Any]:
    """Return the options of a reset.

    Raises:
        ValueError: If they are no mapping, or one is unknown.
    """
    if options is not None and not isinstance(options, Mapping):
        raise ValueError(f"options must be a mapping, got {short_repr(options)}.")
    unknown = [short_repr(name) for name in options or () if name not in known]
    if unknown:
        allowed = f"among {', '.join(map(repr, known))}" if known else "empty, as there are none"
        raise ValueError(f"options must be {allowed}, got {', '.join(unknown)}.")
    return dict(options or {})


def reset_mask(options: dict[str, Any] | None, num_envs: int) -> NDArray[np.bool_]:
    """Return the environments that a reset's option ``reset_mask`` selects; all if it is missing.

    Raises:
        ValueError: If it is no boolean array of shape (num_envs,), true somewhere, or there is another option.
    """
    chosen = read_options(options, ["reset_mask"])
    if "reset_mask" not in chosen:
        return np.ones(num_envs, np.bool_)
    mask = chosen["reset_mask"]
    if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_ or mask.shape != (num_envs,):
        raise ValueError(f"reset_mask must be a boolean array of shape ({num_envs},), got {short_repr(mask)}.")
    if not mask.any():
        raise ValueError("reset_mask must be true somewhere.")
    return mask


def of_rows(mask: NDArray[np.bool_], observations: NDArray[np.float32]) -> NDArray[Any]:
    """Return copies of observations where a mask is true, and None elsewhere."""
    last = np.empty(len(mask), object)
    for row, observation in zip(np.flatnonzero(mask).tolist(), observations[mask], strict=True):
        last[row] = observation
    return last
