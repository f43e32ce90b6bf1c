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
from turtlebot_gym.kernel import HAS_NUMBA, kernel, prefer_wide
from turtlebot_gym.models.random import episode_key
from turtlebot_gym.models.unicycle import command_of
from turtlebot_gym.systems import System, step_of
from turtlebot_gym.systems.episode import start_outcome
from turtlebot_gym.systems.special import GENERAL, Special
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
    reset_parallel: Callable[..., None]
    """The same, on all threads: worth it where a room is drawn for each."""


@cache
def layout_of(system: System, special: Special = GENERAL) -> Layout:
    """Return how a system's values lie in a tile, from an example of each."""
    begin, transition, observe, *_ = step_of(system)
    p, waypoints, around = as_tuple(system.example), (Pose(0.0, 0.0, 0.0),), system.surroundings
    scene = around.at(around.make([system.example]), 0) if around else ()
    start, _ = system.lay_out(1, p, scene)
    world, outcome = transition(begin(start, 1, waypoints, p, scene), STOP, 1, waypoints, p, scene)
    parameters = packing(p, known=dict(special.parameters))
    a_world = packing(world, known=dict(special.world), same=dict(special.same))
    an_outcome, observation = packing(outcome), packing(observe(world, p))
    at_outcome = a_world.size * TILE
    at_observation = at_outcome + an_outcome.size * TILE
    at_action = at_observation + observation.size * TILE
    size = at_action + 2 * TILE
    return Layout(parameters, a_world, an_outcome, observation, at_outcome, at_observation, at_action, size)


@kernel
def _no_scene(scenes: Any, index: int) -> tuple[()]:
    """Return the scene of open ground."""
    return ()


@kernel
def _show_nothing(environment: int, scene: tuple[()], observations: Any) -> None:
    """Add nothing to an observation."""


def _show_ranges_of(system: System) -> Callable[..., None]:
    """Return the kernel that writes the ranges into an environment's observation, before its last number."""
    around, before = system.surroundings, layout_of(system).observation.size - 1
    if around is None:
        return _show_nothing
    ranges_of, seen = around.ranges, around.seen

    @kernel
    def show_ranges(environment, scene, observations):
        ranges = ranges_of(scene)
        for k in range(seen):
            observations[environment, before + k] = ranges[k]

    return show_ranges


def _look_tile_of(system: System) -> Callable[..., None]:
    """Return the kernel that looks round for a tile of environments, one after the other."""
    around = system.surroundings
    if around is None:

        @kernel
        def look_at_nothing(first, count, tile, keys, row, observations, scenes):
            """There is nothing around."""

        return look_at_nothing
    look_round, scene_at, show_ranges = step_of(system).look_round, around.at, _show_ranges_of(system)
    parameters, world, outcome, _, at_outcome, *_ = layout_of(system)
    load_parameters, load_world, load_outcome = parameters.load, world.load, outcome.load
    store_world, store_outcome = world.store, outcome.store

    @kernel
    def look_tile(first, count, tile, keys, row, observations, scenes):
        for lane in range(count):
            p, scene = load_parameters(row, lane), scene_at(scenes, first + lane)
            world, outcome = load_world(tile, lane), load_outcome(tile, at_outcome + lane)
            world, outcome = look_round(world, outcome, int(keys[lane]), p, scene)
            store_world(tile, lane, world)
            store_outcome(tile, at_outcome + lane, outcome)
            show_ranges(first + lane, scene, observations)

    return look_tile


def _do_nothing() -> None:
    """Stand for `prefer_wide` in plain Python."""


def _step_tile_of(system: System, special: Special = GENERAL) -> Callable[..., None]:
    """Return the kernel that advances a tile of environments."""
    _, _, observe, advance, retarget, _ = step_of(system)
    look_tile, seen = _look_tile_of(system), system.surroundings.seen if system.surroundings else 0
    parameters, world, outcome, observation, at_outcome, at_observation, at_action, _ = layout_of(system, special)
    load_parameters, load_world, load_outcome = parameters.load, world.load, outcome.load
    store_world, store_outcome, store_observation = world.store, outcome.store, observation.store
    n_outcome, n_observation = outcome.size, observation.size
    at_reached = at_outcome + outcome.names.index("reached") * TILE
    widen = prefer_wide if HAS_NUMBA and system.compiled else _do_nothing
    own = 1 if special == GENERAL else 0  # of a special case all share the parameters in a tile's first lane

    @kernel
    def step_tile(first, count, actions, tile, keys, row, waypoints, observations, outcomes, scenes):
        """Advance the ``count`` environments of a tile, which begins with environment ``first``."""
        widen()
        asked = actions[first : first + count]
        for lane in range(count):
            tile[at_action + lane] = asked[lane, 0]
            tile[at_action + TILE + lane] = asked[lane, 1]
        for lane in range(count):
            p = load_parameters(row, own * lane)
            command = command_of(tile[at_action + lane], tile[at_action + TILE + lane], p.robot)
            world, outcome = advance(load_world(tile, lane), command, int(keys[lane]), waypoints.shape[1], p)
            store_world(tile, lane, world)
            store_outcome(tile, at_outcome + lane, outcome)
        for lane in range(count):
            if tile[at_reached + lane] != 0.0:
                p = load_parameters(row, own * lane)
                world, outcome = load_world(tile, lane), load_outcome(tile, at_outcome + lane)
                world, outcome = retarget(world, outcome, waypoints[first + lane], p)
                store_world(tile, lane, world)
                store_outcome(tile, at_outcome + lane, outcome)
        look_tile(first, count, tile, keys, row, observations, scenes)
        for lane in range(count):
            p = load_parameters(row, own * lane)
            store_observation(tile, at_observation + lane, observe(load_world(tile, lane), p))
        shown = observations[first : first + count]
        for lane in range(count):
            for k in range(n_observation):
                shown[lane, k if k < n_observation - 1 else k + seen] = tile[at_observation + k * TILE + lane]
        for k in range(n_outcome):
            told = outcomes[k][first : first + count]
            for lane in range(count):
                told[lane] = tile[at_outcome + k * TILE + lane]

    return step_tile


def _reset_lane_of(system: System, special: Special = GENERAL) -> Callable[..., None]:
    """Return the kernel that begins an episode of one environment."""
    begin, _, observe, *_ = step_of(system)
    lay_out, around = system.lay_out, system.surroundings
    scene_at, seen = (around.at, around.seen) if around else (_no_scene, 0)
    show_ranges = _show_ranges_of(system)
    parameters, world, outcome, observation, at_outcome, at_observation, *_ = layout_of(system, special)
    load_parameters, store_world = parameters.load, world.store
    store_outcome, store_observation = outcome.store, observation.store
    n_outcome, n_observation = outcome.size, observation.size

    @kernel
    def reset_lane(environment, lane, tile, key, row, waypoints, observations, outcomes, scenes):
        p, scene = load_parameters(row, lane), scene_at(scenes, environment)
        start, goal = lay_out(key, p, scene)
        if p.task.random:
            waypoints[0, 0], waypoints[0, 1], waypoints[0, 2] = goal.x, goal.y, goal.theta
        world = begin(start, key, waypoints, p, scene)
        store_world(tile, lane, world)
        store_outcome(tile, at_outcome + lane, start_outcome(world))
        store_observation(tile, at_observation + lane, observe(world, p))
        for k in range(n_observation):
            observations[environment, k if k < n_observation - 1 else k + seen] = tile[at_observation + k * TILE + lane]
        show_ranges(environment, scene, observations)
        for k in range(n_outcome):
            outcomes[k, environment] = tile[at_outcome + k * TILE + lane]

    return reset_lane


def _work(*arguments: Any) -> None:
    """Stand for a kernel of a system, which `loops_of` binds to this name."""
    raise NotImplementedError


def _step_rows(identity: str) -> Callable[..., None]:
    def step_rows(actions, tiles, keys, parameters, waypoints, observations, outcomes, scenes):
        identity  # noqa: B018  # pyright: ignore[reportUnusedExpression]  # part of the cache's key
        for index in prange(len(tiles)):
            at = np.int64(index)  # prange counts in unsigned integers, which mix badly with signed ones
            first = at * TILE
            row = parameters[at if len(parameters) > 1 else 0]
            count = min(TILE, len(actions) - first)
            _work(first, count, actions, tiles[at], keys[at], row, waypoints, observations, outcomes, scenes)

    return step_rows


def _reset_rows(identity: str) -> Callable[..., None]:
    def reset_rows(mask, seeds, episodes, tiles, keys, parameters, waypoints, observations, outcomes, scenes):
        identity  # noqa: B018  # pyright: ignore[reportUnusedExpression]  # part of the cache's key
        for index in prange(len(tiles)):
            at = np.int64(index)
            row = parameters[at if len(parameters) > 1 else 0]
            for environment in range(at * TILE, min((at + 1) * TILE, len(mask))):
                if mask[environment]:
                    lane = environment % TILE
                    keys[at, lane] = episode_key(int(seeds[environment]), int(episodes[environment]))
                    key = int(keys[at, lane])  # signed: unsigned and signed integers would meet in floats
                    _work(environment, lane, tiles[at], key, row, waypoints[environment], observations, outcomes, scenes)

    return reset_rows


def _loop(
    make: Callable[[str], Callable[..., None]], work: Callable[..., None], *, system: System, parallel: bool
) -> Callable[..., None]:
    """Return a loop around a kernel, to be compiled at its first call if the system can be."""
    if not system.compiled:
        return bind(make(""), _work=work)
    identity = f"{fingerprint(make(''), work)} parallel={parallel}"
    return compiled(bind(make(identity), _work=work), parallel=parallel)


@cache
def loops_of(system: System, special: Special = GENERAL) -> Loops:
    """Return the compiled loops of a system, for all parameters or a special case; processes share them by numba's cache."""
    step_tile, reset_lane = _step_tile_of(system, special), _reset_lane_of(system, special)
    return Loops(
        layout_of(system, special),
        _loop(_step_rows, step_tile, system=system, parallel=False),
        _loop(_step_rows, step_tile, system=system, parallel=True),
        _loop(_reset_rows, reset_lane, system=system, parallel=False),
        _loop(_reset_rows, reset_lane, system=system, parallel=True),
    )
