"""The compiled loops of a system: many environments in one buffer, each advanced by the kernels that plain Python runs.

Why it is fast: a tile's numbers lie environment by environment (see `packing`), the kernels have no branches and call no
library, so LLVM turns the loop over a tile into eight environments per instruction; tiles are shared out among threads. What
is rare and has branches, a new waypoint or a reset, is done between those loops. Why it is exact: it is compiled without
fastmath, so neither the vector width nor the number of threads nor the batch changes a bit of any result.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from turtlebot_gym.compiled.cache import bind, compiled, fingerprint
from turtlebot_gym.compiled.packing import TILE, Packing, as_tuple, packing
from turtlebot_gym.kernel import HAS_NUMBA, kernel
from turtlebot_gym.models.random import episode_key
from turtlebot_gym.models.unicycle import command_of
from turtlebot_gym.systems import System, make_parameters, step_of
from turtlebot_gym.systems.episode import start_outcome
from turtlebot_gym.tasks import draw_goal, start_pose
from turtlebot_gym.values import STOP, Pose

if HAS_NUMBA:
    from numba import prange
else:
    prange = range


class Layout(NamedTuple):
    """How a system's values lie in a tile, one after the other: world, outcome, observation, action."""

    parameters: Packing
    """In a tile of their own."""
    world: Packing
    outcome: Packing
    observation: Packing
    at_outcome: int
    """Where the outcome begins in a tile."""
    at_observation: int
    at_action: int
    size: int
    """Numbers in a tile."""


class Loops(NamedTuple):
    """The compiled functions of a system, each compiled at its first call."""

    layout: Layout
    step: Callable[..., None]
    """Advances all environments, on one thread."""
    step_parallel: Callable[..., None]
    """The same, on all threads."""
    reset: Callable[..., None]
    """Begins the episodes of some environments."""


@cache
def layout_of(system: System) -> Layout:
    """Return how a system's values lie in a tile, from an example of each."""
    begin, transition, observe, *_ = step_of(system)
    p, waypoints = as_tuple(make_parameters()), (Pose(0.0, 0.0, 0.0),)
    world, outcome = transition(begin(1, waypoints, p), STOP, 1, waypoints, p)
    parameters, a_world, an_outcome, observation = map(packing, (p, world, outcome, observe(world, p)))
    at_outcome = a_world.size * TILE
    at_observation = at_outcome + an_outcome.size * TILE
    at_action = at_observation + observation.size * TILE
    size = at_action + 2 * TILE
    return Layout(parameters, a_world, an_outcome, observation, at_outcome, at_observation, at_action, size)


def _step_tile_of(system: System) -> Callable[..., None]:
    """Return the kernel that advances a tile of environments."""
    _, _, observe, advance, retarget = step_of(system)
    parameters, world, outcome, observation, at_outcome, at_observation, at_action, _ = layout_of(system)
    load_parameters, load_world, load_outcome = parameters.load, world.load, outcome.load
    store_world, store_outcome, store_observation = world.store, outcome.store, observation.store
    n_outcome, n_observation = outcome.size, observation.size
    at_reached = at_outcome + outcome.names.index("reached") * TILE

    @kernel
    def step_tile(first, count, actions, tile, keys, row, waypoints, observations, outcomes):
        """Advance the ``count`` environments of a tile, which begins with environment ``first``."""
        for lane in range(count):
            tile[at_action + lane] = actions[first + lane, 0]
            tile[at_action + TILE + lane] = actions[first + lane, 1]
        for lane in range(count):
            p = load_parameters(row, lane)
            command = command_of(tile[at_action + lane], tile[at_action + TILE + lane], p.robot)
            world, outcome = advance(load_world(tile, lane), command, int(keys[lane]), waypoints.shape[1], p)
            store_world(tile, lane, world)
            store_outcome(tile, at_outcome + lane, outcome)
        for lane in range(count):
            if tile[at_reached + lane] != 0.0:
                p = load_parameters(row, lane)
                world, outcome = load_world(tile, lane), load_outcome(tile, at_outcome + lane)
                world, outcome = retarget(world, outcome, waypoints[first + lane], p)
                store_world(tile, lane, world)
                store_outcome(tile, at_outcome + lane, outcome)
        for lane in range(count):
            p = load_parameters(row, lane)
            store_observation(tile, at_observation + lane, observe(load_world(tile, lane), p))
        for lane in range(count):
            for k in range(n_observation):
                observations[first + lane, k] = tile[at_observation + k * TILE + lane]
        for k in range(n_outcome):
            for lane in range(count):
                outcomes[k, first + lane] = tile[at_outcome + k * TILE + lane]

    return step_tile


def _reset_lane_of(system: System) -> Callable[..., None]:
    """Return the kernel that begins an episode of one environment."""
    begin, _, observe, *_ = step_of(system)
    parameters, world, outcome, observation, at_outcome, at_observation, *_ = layout_of(system)
    load_parameters, store_world = parameters.load, world.store
    store_outcome, store_observation = outcome.store, observation.store
    n_outcome, n_observation = outcome.size, observation.size

    @kernel
    def reset_lane(environment, lane, tile, key, row, waypoints, observations, outcomes):
        p = load_parameters(row, lane)
        if p.task.random:
            waypoints[0, 0], waypoints[0, 1], waypoints[0, 2] = draw_goal(key, start_pose(key, p.task), p.task)
        world = begin(key, waypoints, p)
        store_world(tile, lane, world)
        store_outcome(tile, at_outcome + lane, start_outcome(world))
        store_observation(tile, at_observation + lane, observe(world, p))
        for k in range(n_observation):
            observations[environment, k] = tile[at_observation + k * TILE + lane]
        for k in range(n_outcome):
            outcomes[k, environment] = tile[at_outcome + k * TILE + lane]

    return reset_lane


def _work(*arguments: Any) -> None:
    """Stand for a kernel of a system, which `loops_of` binds to this name."""
    raise NotImplementedError


def _step_rows(identity: str) -> Callable[..., None]:
    def step_rows(actions, tiles, keys, parameters, waypoints, observations, outcomes):
        identity  # noqa: B018  # pyright: ignore[reportUnusedExpression]  # part of the cache's key
        for index in prange(len(tiles)):
            at = np.int64(index)  # prange counts in unsigned integers, which mix badly with signed ones
            first = at * TILE
            row = parameters[at if len(parameters) > 1 else 0]
            count = min(TILE, len(actions) - first)
            _work(first, count, actions, tiles[at], keys[at], row, waypoints, observations, outcomes)

    return step_rows


def _reset_rows(identity: str) -> Callable[..., None]:
    def reset_rows(mask, seeds, episodes, tiles, keys, parameters, waypoints, observations, outcomes):
        identity  # noqa: B018  # pyright: ignore[reportUnusedExpression]  # part of the cache's key
        for environment in range(len(mask)):
            if mask[environment]:
                at, lane = environment // TILE, environment % TILE
                row = parameters[at if len(parameters) > 1 else 0]
                key = episode_key(int(seeds[environment]), int(episodes[environment]))
                keys[at, lane] = key
                _work(environment, lane, tiles[at], key, row, waypoints[environment], observations, outcomes)

    return reset_rows


def _loop(make: Callable[[str], Callable[..., None]], work: Callable[..., None], *, parallel: bool) -> Callable[..., None]:
    """Return a loop around a kernel, to be compiled at its first call."""
    identity = f"{fingerprint(make(''), work)} parallel={parallel}"
    return compiled(bind(make(identity), _work=work), parallel=parallel)


@cache
def loops_of(system: System) -> Loops:
    """Return the compiled loops of a system; processes share them by numba's cache."""
    step_tile = _step_tile_of(system)
    return Loops(
        layout_of(system),
        _loop(_step_rows, step_tile, parallel=False),
        _loop(_step_rows, step_tile, parallel=True),
        _loop(_reset_rows, _reset_lane_of(system), parallel=False),
    )
