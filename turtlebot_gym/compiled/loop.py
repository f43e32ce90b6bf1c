"""The compiled loop: many environments in one buffer, each advanced by the very functions that plain Python runs.

Why it is fast: a tile's numbers lie environment by environment (see `packing`), the functions have no branches and call no
library, so LLVM turns the loop over a tile into eight environments per instruction; tiles are shared out among threads. What
is rare and has branches, a new waypoint or a reset, is done between those loops. Why it is exact: it is compiled without
fastmath, so neither the vector width nor the number of threads nor the batch changes a bit of any result.
"""

from __future__ import annotations

import hashlib
import os
import threading
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.compiled.packing import TILE, as_tuple, flatten, packing
from turtlebot_gym.kernel import HAS_NUMBA, kernel
from turtlebot_gym.models.random import episode_key
from turtlebot_gym.simulation import Outcome, Parameters, World, begin, look, make_parameters, retarget, transition
from turtlebot_gym.tasks import distance_to, draw_goal
from turtlebot_gym.values import STOP, Command, Pose

# Threads that spin at the end of each step keep a busy machine from running the very thread that they wait for: with a second
# program on the cores, the default spin made a step 20 times slower. This one costs an idle machine nothing that was measured.
os.environ.setdefault("GOMP_SPINCOUNT", "1000")

PARALLEL_FROM = 8 * TILE
"""Batches below this run on one thread: sharing them out would cost more than it saves."""

_EXAMPLE = as_tuple(make_parameters())
_START = Pose(0.0, 0.0, 0.0)
_WORLD, _COME = transition(retarget(begin(1, _EXAMPLE), (_START,), _EXAMPLE), STOP, 1, 1, _EXAMPLE)

PARAMETERS = packing(_EXAMPLE)
"""How parameters lie in a tile of them."""
WORLD = packing(_WORLD)
"""How a world lies in a tile."""
OUTCOME = packing(_COME)
OBSERVATION = packing(look(_WORLD, _EXAMPLE))
_AT_OUTCOME = WORLD.size * TILE
_AT_OBSERVATION = _AT_OUTCOME + OUTCOME.size * TILE
_AT_ACTION = _AT_OBSERVATION + OBSERVATION.size * TILE
_AT_DISTANCE = _AT_OUTCOME + Outcome._fields.index("distance") * TILE
_AT_REACHED = _AT_OUTCOME + Outcome._fields.index("reached") * TILE
_TILE_SIZE = _AT_ACTION + 2 * TILE

_load_world, _store_world, _load_parameters = WORLD.load, WORLD.store, PARAMETERS.load
_store_outcome, _store_observation = OUTCOME.store, OBSERVATION.store
_N_OUTCOME, _N_OBSERVATION = OUTCOME.size, OBSERVATION.size

if HAS_NUMBA:
    from numba import njit, prange
else:  # the loops run as plain Python
    njit: Any = lambda function, **options: function  # noqa: E731
    prange = range


@kernel
def _step_tile(first, count, actions, tile, keys, row, waypoints, observations, outcomes):
    """Advance the ``count`` environments of a tile, which begins with environment ``first``."""
    for lane in range(count):
        tile[_AT_ACTION + lane] = actions[first + lane, 0]
        tile[_AT_ACTION + TILE + lane] = actions[first + lane, 1]
    for lane in range(count):
        p = _load_parameters(row, lane)
        forward = min(max(tile[_AT_ACTION + lane], -1.0), 1.0) * p.robot.max_linear
        turn = min(max(tile[_AT_ACTION + TILE + lane], -1.0), 1.0) * p.robot.max_angular
        world = _load_world(tile, lane)
        after, come = transition(world, Command(forward, turn), int(keys[lane]), waypoints.shape[1], p)
        _store_world(tile, lane, after)
        _store_outcome(tile, _AT_OUTCOME + lane, come)
    for lane in range(count):
        if tile[_AT_REACHED + lane] != 0.0:
            p = _load_parameters(row, lane)
            world = retarget(_load_world(tile, lane), waypoints[first + lane], p)
            _store_world(tile, lane, world)
            tile[_AT_DISTANCE + lane] = distance_to(world.true_state, world.reference)
    for lane in range(count):
        p = _load_parameters(row, lane)
        _store_observation(tile, _AT_OBSERVATION + lane, look(_load_world(tile, lane), p))
    for lane in range(count):
        for k in range(_N_OBSERVATION):
            observations[first + lane, k] = tile[_AT_OBSERVATION + k * TILE + lane]
    for k in range(_N_OUTCOME):
        for lane in range(count):
            outcomes[k, first + lane] = tile[_AT_OUTCOME + k * TILE + lane]


def _step_rows(identity: str) -> Callable[..., None]:
    # numba's cache knows a function's own code and what it closes over, but neither the helpers that it calls nor the flags
    # that it is compiled with. So the loops close over a string that stands for those.
    def step_rows(actions, tiles, keys, parameters, waypoints, observations, outcomes):
        identity  # noqa: B018  # pyright: ignore[reportUnusedExpression]
        for index in prange(len(tiles)):
            at = np.int64(index)  # prange counts in unsigned integers, which mix badly with signed ones
            first = at * TILE
            row = parameters[at if len(parameters) > 1 else 0]
            count = min(TILE, len(actions) - first)
            _step_tile(first, count, actions, tiles[at], keys[at], row, waypoints, observations, outcomes)

    return step_rows


def _reset_rows(identity: str) -> Callable[..., None]:
    def reset_rows(mask, seeds, episodes, tiles, keys, parameters, waypoints, observations, outcomes):
        identity  # noqa: B018  # pyright: ignore[reportUnusedExpression]
        for row in range(len(mask)):
            if mask[row]:
                at, lane = row // TILE, row % TILE
                p = _load_parameters(parameters[at if len(parameters) > 1 else 0], lane)
                key = episode_key(int(seeds[row]), int(episodes[row]))
                keys[at, lane] = key
                world = begin(key, p)
                if p.task.random:
                    before = world.reference
                    for k in range(waypoints.shape[1]):
                        before = draw_goal(key, k, before, p.task)
                        waypoints[row, k, 0], waypoints[row, k, 1], waypoints[row, k, 2] = before
                world = retarget(world, waypoints[row], p)
                _store_world(tiles[at], lane, world)
                come = Outcome(0.0, distance_to(world.true_state, world.reference), False, False, False, False)
                _store_outcome(tiles[at], _AT_OUTCOME + lane, come)
                _store_observation(tiles[at], _AT_OBSERVATION + lane, look(world, p))
                for k in range(_N_OBSERVATION):
                    observations[row, k] = tiles[at, _AT_OBSERVATION + k * TILE + lane]
                for k in range(_N_OUTCOME):
                    outcomes[k, row] = tiles[at, _AT_OUTCOME + k * TILE + lane]

    return reset_rows


@cache
def _sources() -> str:
    """Return a hash of all that the loops are compiled from."""
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).parent.parent.rglob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()


@cache
def _compiled(make: Callable[[str], Callable[..., None]], parallel: bool) -> Callable[..., None]:
    """Compile a loop at its first call, with numba's cache where a folder for it is writable."""
    function = make(f"{_sources()} parallel={parallel}")
    try:
        return njit(function, error_model="numpy", parallel=parallel, cache=True)
    except RuntimeError:  # there is no folder for the cache
        return njit(function, error_model="numpy", parallel=parallel)


class _Threads:
    """Who may run a parallel loop: one Python thread at a time (numba's work queue aborts under two), and not a child that was
    forked after its parent ran one (OpenMP would kill it). All others run the serial loop, which gives the same bits."""

    lock = threading.Lock()
    used = False
    lost = False

    @classmethod
    def acquire(cls) -> bool:
        """Return whether the caller may run a parallel loop; it then has to release the lock."""
        allowed = not cls.lost and cls.lock.acquire(blocking=False)
        cls.used |= allowed
        return allowed

    @classmethod
    def after_fork(cls) -> None:
        cls.lock = threading.Lock()
        cls.lost = cls.used


os.register_at_fork(after_in_child=_Threads.after_fork)


class Batch:
    """Environments that are stepped together; one or ten thousand.

    Args:
        num_envs: How many.
        parameters: One for all of them, or one for each.
        waypoints: The poses to visit, the same for all; where the task draws them, only how many there are counts.
    """

    def __init__(self, num_envs: int, parameters: Parameters | Sequence[Parameters], waypoints: Sequence[Pose]) -> None:
        n_tiles = -(-num_envs // TILE)
        self.num_envs = num_envs
        self.seeds = np.zeros(num_envs, np.int64)
        self.episodes = np.zeros(num_envs, np.int64)
        self.waypoints = np.tile(np.array(waypoints, np.float64), (num_envs, 1, 1))
        self._keys = np.zeros((n_tiles, TILE), np.int64)
        self._tiles = np.zeros((n_tiles, _TILE_SIZE))
        self._parallel = num_envs >= PARALLEL_FROM
        self.set_parameters(parameters)

    def set_parameters(self, parameters: Parameters | Sequence[Parameters]) -> None:
        """Use other parameters from the next step on: one for all environments, or one for each."""
        same = isinstance(parameters, Parameters)
        self.parameters = parameters
        rows = [parameters] * TILE if same else list(parameters)
        if not same and len(rows) != self.num_envs:
            raise ValueError(f"parameters must be one or {self.num_envs}, got {len(rows)}.")
        rows += rows[-1:] * (-len(rows) % TILE)
        table = np.array([list(flatten(as_tuple(row))) for row in (rows[:1] if same else rows)], np.float64)
        if same:
            table = np.repeat(table, TILE, axis=0)
        tiles = table.reshape(-1, TILE, PARAMETERS.size).transpose(0, 2, 1)
        self._parameters = np.ascontiguousarray(tiles).reshape(len(tiles), -1)

    def reset(self, mask: NDArray[np.bool_], observations: NDArray[np.float32], outcomes: NDArray[np.float64]) -> None:
        """Start the episodes of ``seeds`` and ``episodes`` where the mask is true, and write there what has come of it.

        Args:
            mask: Shape (N,).
            observations: Shape (N, 13); rows outside the mask are left as they are.
            outcomes: Shape (6, N); likewise.
        """
        loop = _compiled(_reset_rows, False)
        state = self._tiles, self._keys, self._parameters, self.waypoints
        loop(mask, self.seeds, self.episodes, *state, observations, outcomes)

    def empty(self) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
        """Return uninitialized observations and outcomes, in the shapes of `step`."""
        return np.empty((self.num_envs, _N_OBSERVATION), np.float32), np.empty((_N_OUTCOME, self.num_envs))

    def last(self) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
        """Return fresh observations and outcomes of the last step or reset, in the shapes of `step`."""
        rows = self._rows(_AT_OUTCOME, _N_OUTCOME + _N_OBSERVATION)
        return rows[:, _N_OUTCOME:].astype(np.float32), np.ascontiguousarray(rows[:, :_N_OUTCOME].T)

    def step(self, actions: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
        """Advance all environments by one step.

        Args:
            actions: Shape (N, 2), finite; clipped to [-1, 1].

        Returns:
            Observations, shape (N, 13), and outcomes, shape (6, N), with a row for each field of `Outcome`. Both are fresh.
        """
        observations, outcomes = self.empty()
        parallel = self._parallel and _Threads.acquire()
        try:
            loop = _compiled(_step_rows, parallel)
            loop(actions, self._tiles, self._keys, self._parameters, self.waypoints, observations, outcomes)
        finally:
            if parallel:
                _Threads.lock.release()
        return observations, outcomes

    def numbers(self, path: str) -> NDArray[np.float64]:
        """Return a copy of a part of all worlds, by its dotted path: "true_state", "estimate.belief.covariance"; (N, k)."""
        part = WORLD.slices[path]
        return self._rows(part.start * TILE, part.stop - part.start)

    def first_world(self) -> NDArray[np.float64]:
        """Return a copy of the first environment's world, one number after the other, as `WORLD` has them."""
        return self._tiles[0, :_AT_OUTCOME:TILE].copy()

    def world(self, index: int) -> World:
        """Return one environment's world, in Python's own numbers."""
        return _load_world(self._tiles[index // TILE].tolist(), index % TILE)

    def _rows(self, start: int, size: int) -> NDArray[np.float64]:
        """Return ``size`` numbers of each environment, from a place in the tiles on; (N, size)."""
        part = self._tiles[:, start : start + size * TILE].reshape(len(self._tiles), size, TILE)
        return part.transpose(0, 2, 1).reshape(-1, size)[: self.num_envs].copy()  # of a single tile it would be a view
