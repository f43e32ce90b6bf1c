"""The loops over many environments in one buffer, advanced by the same kernels that `turtlebot_gym.heart` runs.

On open ground a tile of environments is stepped in vectors, since its kernels have no branches and call no library. Nothing is
reordered or contracted (`kernel.algebra` says what is left out), so no bit of a result depends on the vector width, the number
of threads or the batch. The same loops run as plain Python without a compiler, in a debugger, and for plants that are no
kernels.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np

from turtlebot_gym.compiled.packing import TILE, Access, Packing, access, layout_of, packing
from turtlebot_gym.compiled.program import compiled
from turtlebot_gym.compiled.proof import Case, reduced
from turtlebot_gym.heart import step_of
from turtlebot_gym.kernel import HAS_LLVM, fetch, kernel, lanes
from turtlebot_gym.models.random import episode_key
from turtlebot_gym.models.unicycle import command_of
from turtlebot_gym.observations.columns import observing, present_columns, slices_of
from turtlebot_gym.systems import Outcome, System

_DISTANCE, _SUCCESS = map(Outcome._fields.index, ("distance", "is_success"))
FLAGS = slice(_SUCCESS, _SUCCESS + 3)
"""The rows of success, termination and truncation in an outcome."""


class Parts(NamedTuple):
    """Kernels of a system that the loops share."""

    parameters: Access
    world: Access
    tell: Callable[..., None]
    """``tell(outcomes, row, outcome)`` writes an outcome."""
    finish: Callable[..., bool]
    """Looks and judges after a move of an environment, writes its world and results, and returns whether a flag is set."""
    reset: Callable[..., None]
    """Begins the episode of an environment if asked, and writes its present results."""


@cache
def parts_of(system: System, case: Case | None, shares: bool = False) -> Parts:
    """Return the kernels for a case on open ground, or for rooms; with or without the shares of the reward in outcomes."""
    layout, lay_out, (begin, start_outcome, _, conclude, retarget) = layout_of(system), system.lay_out, step_of(system)
    parameters = access(layout.parameters._replace(known=case.known) if case else layout.parameters)
    world = access(reduced(system, case) if case else layout.world)
    (load_parameters, _), (load_world, store_world), observe = parameters, world, observing(system.terms)
    _, row_of = access(packing(layout.observation.example, present_columns(system.terms)), distance=1)
    starts = slices_of(system.terms)
    blocks = tuple((term.of, term.width, starts[term.name].start) for term in system.terms if term.in_scene)

    @kernel
    def show(shown, world, p, scene):
        row_of(shown, 0, observe(world, p))
        for of, width, column in blocks:
            numbers = of(scene)
            for k in range(width):
                shown[column + k] = numbers[k]

    @kernel
    def tell(outcomes, row, outcome):
        for at, number in enumerate((*outcome[:-1], *outcome.shares) if shares else outcome[:-1]):
            outcomes[at, row] = number

    @kernel
    def finish(row, tile, lane, key, world, moved, p, waypoints, observations, outcomes, scene):
        world, outcome = conclude(world, moved, key, waypoints.shape[1], p, scene)
        if outcome.reached:
            world, outcome = retarget(world, outcome, key, waypoints[row], p, scene)
        store_world(tile, lane, world)
        tell(outcomes, row, outcome)
        show(observations[row], world, p, scene)
        return outcome.is_success | outcome.terminated | outcome.truncated

    @kernel
    def reset(row, begins, seeds, episodes, tile, lane, keys, parameters, waypoints, observations, outcomes, scene):
        p = load_parameters(parameters, lane)
        if begins:
            key = episode_key(int(seeds[row]), int(episodes[row]))
            keys[lane] = key
            start, goal = lay_out(key, p, scene)
            if p.task.random:
                waypoints[row, 0] = goal
            store_world(tile, lane, begin(start, key, waypoints[row], p, scene))
        world = load_world(tile, lane)
        tell(outcomes, row, start_outcome(world))
        show(observations[row], world, p, scene)

    return Parts(parameters, world, tell, finish, reset)


def _open_tile_of(system: System, case: Case, shares: bool) -> Callable[..., int]:
    """Return the kernel that advances a tile of environments on open ground: in vectors, but for new waypoints."""
    (_, start_outcome, act, conclude, retarget), number_of_waypoints = step_of(system), case.waypoints
    (load_parameters, _), (load_world, store_world), tell, *_ = parts_of(system, case, shares)
    columns, observe = present_columns(system.terms), observing(system.terms)
    _, show_lane = access(layout_of(system).observation)
    waiting = tuple(sensor._replace(sense=sensor.wait or sensor.sense) for sensor in system.sensors)
    dues, wait = tuple(sensor.due for sensor in system.sensors if sensor.due), step_of(system._replace(sensors=waiting)).act

    @kernel
    def step_lanes(act, count, asked, told, tile, keys, parameters, scratch, reached):
        """Return how many environments have reached a waypoint, and how many flags are set; lanes may be behind the last."""
        turns, flagged = 0, 0
        for lane in lanes(TILE):
            p, key, world = load_parameters(parameters, lane), int(keys[lane]), load_world(tile, lane)
            command = command_of(float(asked[2 * lane]), float(asked[2 * lane + 1]), p.robot)
            world, outcome = conclude(world, act(world, command, key, p), key, number_of_waypoints, p, ())
            if number_of_waypoints == 1 and outcome.reached:  # a single waypoint stays
                world, outcome = retarget(world, outcome, key, (world.course.reference,), p, ())
            store_world(tile, lane, world)
            tell(told, lane, outcome)
            show_lane(scratch, lane, observe(world, p))
            reached[lane] = outcome.reached
            turns += outcome.reached
            flagged += (outcome.is_success | outcome.terminated | outcome.truncated) & (lane < count)
        return turns, flagged

    @kernel
    def step_tile(first, count, actions, tile, keys, parameters, waypoints, observations, outcomes, scenes):
        """Advance the ``count`` environments of a tile whose first environment is ``first``; return how many flags are set."""
        asked, told, shown = actions[2 * first :], outcomes[:, first:], observations[first:]
        scratch, reached, news = np.empty(len(columns) * TILE, np.float32), np.empty(TILE), len(dues) == 0
        for lane in range(count):
            for due in dues:
                news = news | due(int(load_world(tile, lane).steps + 1.0), load_parameters(parameters, lane))
        if news:
            turns, flagged = step_lanes(act, count, asked, told, tile, keys, parameters, scratch, reached)
        else:
            turns, flagged = step_lanes(wait, count, asked, told, tile, keys, parameters, scratch, reached)
        if number_of_waypoints > 1 and turns > 0:
            for lane in range(count):
                if reached[lane] > 0.0:
                    p, key, world = load_parameters(parameters, lane), int(keys[lane]), load_world(tile, lane)
                    world, outcome = retarget(world, start_outcome(world), key, waypoints[first + lane], p, ())
                    store_world(tile, lane, world)
                    told[_DISTANCE, lane] = outcome.distance
                    show_lane(scratch, lane, observe(world, p))
        for lane in range(count):
            for number, column in enumerate(columns):
                shown[lane, column] = scratch[number * TILE + lane]
        return flagged

    return step_tile


def _room_tile_of(system: System, shares: bool) -> Callable[..., int]:
    """Return the kernel that advances a tile in surroundings: all robots move first, and then look, one by one."""
    (load_parameters, _), (load_world, store_world), _, finish, _ = parts_of(system, None, shares)
    act, scene_at, size = step_of(system).act, system.surroundings.at, layout_of(system).world.size * TILE

    @kernel
    def step_tile(first, count, actions, tile, keys, parameters, waypoints, observations, outcomes, scenes):
        moved_tile, asked, flagged = np.empty(size), actions[2 * first :], 0
        for lane in range(count):
            p = load_parameters(parameters, lane)
            command = command_of(float(asked[2 * lane]), float(asked[2 * lane + 1]), p.robot)
            store_world(moved_tile, lane, act(load_world(tile, lane), command, int(keys[lane]), p))
        for lane in range(count):
            row, p, key = first + lane, load_parameters(parameters, lane), int(keys[lane])
            scene, world, moved = scene_at(scenes, row), load_world(tile, lane), load_world(moved_tile, lane)
            flagged += finish(row, tile, lane, key, world, moved, p, waypoints, observations, outcomes, scene)
        return flagged

    return step_tile


@cache
def loops_of(system: System, case: Case | None, shares: bool) -> tuple[Packing, Callable[..., int], Callable[..., int]]:
    """Return the layout of a system's worlds, and its loops, compiled, or in plain Python.

    The first loop steps the tiles from one number to another, and returns how many flags are set. The second one begins
    episodes of some environments in them, or writes their present results again.

    Args:
        system: The system.
        case: The case of open ground for which loops are compiled; None for plain Python, and for rooms.
        shares: Whether outcomes have rows for the shares of the reward.
    """
    step_tile = _open_tile_of(system, case, shares) if case else _room_tile_of(system, shares)
    reset, scene_at = parts_of(system, case, shares).reset, system.surroundings.at
    world = reduced(system, case) if case else layout_of(system).world
    ahead = world.size if case else 0

    def step_rows(first, last, actions, tiles, keys, parameters, waypoints, observations, outcomes, scenes):
        flagged = 0
        for at in range(first, last):
            row, count, own = at * TILE, min(TILE, len(observations) - at * TILE), parameters[at if len(parameters) > 1 else 0]
            for number in range(ahead):  # on open ground a step is sooner done than the memory of the next tile is read
                fetch(tiles[min(at + 1, last - 1)], number * TILE)
            flagged += step_tile(row, count, actions, tiles[at], keys[at], own, waypoints, observations, outcomes, scenes)
        return flagged

    def reset_rows(
        first, last, rows, count, begins, seeds, episodes, tiles, keys, parameters, waypoints, observations, outcomes, scenes
    ):
        for number in range(count):
            row = int(rows[number])
            at, lane, scene = row // TILE, row % TILE, scene_at(scenes, row)
            if first <= at and at < last:
                tile, own = tiles[at], parameters[at if len(parameters) > 1 else 0]
                reset(row, begins, seeds, episodes, tile, lane, keys[at], own, waypoints, observations, outcomes, scene)
        return 0

    if not (HAS_LLVM and system.compiled):
        return world, step_rows, reset_rows
    where, (step, begin) = ("on open ground", (2, 1)) if case else ("in rooms", (3, 3))
    return world, compiled(step_rows, f"steps {where}", step), compiled(reset_rows, f"resets {where}", begin)
