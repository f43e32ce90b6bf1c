"""The compiled loops: many environments in one buffer, advanced by the same kernels that plain Python runs.

A tile of environments is stepped in vectors, on open ground as a whole and in rooms up to looking, since its kernels have no
branches and call no library. Nothing is reordered or contracted (`kernel.algebra` says what is left out), so no bit of a result
depends on the vector width, the number of threads or the batch.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from types import MappingProxyType
from typing import Any, NamedTuple

from turtlebot_gym.compiled.packing import TILE, Packing, access, layout_of, packing
from turtlebot_gym.compiled.plain import plain_loops
from turtlebot_gym.compiled.program import compiled
from turtlebot_gym.compiled.proof import Case, own_of, reduced
from turtlebot_gym.heart import step_of
from turtlebot_gym.kernel import HAS_LLVM, compiled_scratch, kernel, lanes, prefer_wide
from turtlebot_gym.models.random import episode_key
from turtlebot_gym.models.unicycle import command_of
from turtlebot_gym.observations.columns import observing, present_columns, slices_of
from turtlebot_gym.systems import Outcome, System

_SUCCESS = Outcome._fields.index("is_success")
FLAGS = slice(_SUCCESS, _SUCCESS + 3)
"""The rows of success, termination and truncation in an outcome."""


class Loops(NamedTuple):
    """The functions of a system that step and reset some tiles; compiled ones are compiled at their first call."""

    world: Packing
    constants: Mapping[int, float]
    """What stands at the places of numbers that never change, which compiled loops neither read nor write."""
    step: Callable[..., int]
    """Advances the tiles from one number to another, and returns how many flags are set."""
    reset: Callable[..., None]
    """Begins episodes of some environments in some tiles, or writes their current observations again."""


class Parts(NamedTuple):
    """Kernels of a system that the loops share."""

    load_parameters: Callable[..., Any]
    load_world: Callable[..., Any]
    store_world: Callable[..., None]
    show: Callable[..., None]
    """``show(shown, world, p)`` writes an observation to a row, without what stands in the scene."""
    show_lane: Callable[..., None]
    """``show_lane(scratch, lane, world, p)`` writes it to a lane of a scratch ..."""
    show_lanes: Callable[..., None]
    """... and ``show_lanes(scratch, count, shown)`` from there to some rows."""
    show_scene: Callable[..., None]
    """``show_scene(shown, scene)`` writes to a row what stands in the scene."""
    tell: Callable[..., None]
    """``tell(outcomes, row, outcome)`` writes an outcome."""
    scratch: int
    """Numbers in a scratch."""


@cache
def parts_of(system: System, case: Case | None, shares: bool = False) -> Parts:
    """Return the kernels for a case on open ground, or for rooms; with or without the shares of the reward in outcomes."""
    layout = layout_of(system)
    parameters, world = access(layout.parameters), access(layout.world)
    if case:
        fixed, own = dict(case.fixed), own_of(system, case)
        places = [own.index(name) if name not in fixed else len(own) + [*fixed].index(name) for name in layout.parameters.names]
        parameters = access(packing(layout.parameters.example, places), dict(enumerate(fixed.values(), len(own))))
        world = access(*reduced(system, case))
    present, starts = present_columns(system.terms), slices_of(system.terms)
    columns = tuple(enumerate(present))
    blocks = tuple((term.of, term.width, starts[term.name].start) for term in system.terms if term.in_scene)
    observe, lane_of = observing(system.terms), access(layout.observation).store
    row_of = access(packing(layout.observation.example, present), distance=1).store

    @kernel
    def show(shown, world, p):
        row_of(shown, 0, observe(world, p))

    @kernel
    def show_lane(scratch, lane, world, p):
        lane_of(scratch, lane, observe(world, p))

    @kernel
    def show_lanes(scratch, count, shown):
        for lane in range(count):
            for number, column in columns:
                shown[lane, column] = scratch[number * TILE + lane]

    @kernel
    def show_scene(shown, scene):
        for of, width, column in blocks:
            numbers = of(scene)
            for k in range(width):
                shown[column + k] = numbers[k]

    @kernel
    def tell(outcomes, row, outcome):
        at = 0
        for number in (*outcome[:-1], *outcome.shares) if shares else outcome[:-1]:
            outcomes[at, row] = number
            at += 1  # noqa: SIM113  # enumerate is not translated

    size = layout.observation.size * TILE
    return Parts(parameters.load, *world, show, show_lane, show_lanes, show_scene, tell, size)


def _open_tile_of(system: System, case: Case, shares: bool) -> Callable[..., int]:
    """Return the kernel that advances a tile of environments on open ground: in vectors, but for new waypoints."""
    (_, start_outcome, act, conclude, retarget), number_of_waypoints = step_of(system), case.waypoints
    load_parameters, load_world, store_world, _, show_lane, show_lanes, _, tell, size = parts_of(system, case, shares)
    reached, distance = map(Outcome._fields.index, ("reached", "distance"))

    @kernel
    def step_tile(first, count, actions, tile, keys, parameters, origin, waypoints, observations, outcomes, scenes):
        """Advance the ``count`` environments of a tile whose first environment is ``first``; return how many flags are set."""
        asked, told = actions[2 * first :], outcomes[:, first:]
        scratch, flagged, arrived = compiled_scratch(size, "float32"), 0, 0
        for lane in lanes(TILE):
            p, key, world = load_parameters(parameters, origin + lane), int(keys[lane]), load_world(tile, lane)
            command = command_of(asked[2 * lane], asked[2 * lane + 1], p.robot)
            world, outcome = conclude(world, act(world, command, key, p), key, number_of_waypoints, p, ())
            if number_of_waypoints == 1:  # it stays
                goal = (world.course.reference,)
                world, outcome = retarget(world, outcome, key, goal, p, ()) if outcome.reached else (world, outcome)
            else:
                arrived += outcome.reached
            store_world(tile, lane, world)
            tell(told, lane, outcome)
            show_lane(scratch, lane, world, p)
            flagged += (outcome.is_success | outcome.terminated | outcome.truncated) & (lane < count)
        if arrived > 0:
            for lane in range(count):
                if told[reached, lane] != 0.0:
                    p, key, world = load_parameters(parameters, origin + lane), int(keys[lane]), load_world(tile, lane)
                    world, outcome = retarget(world, start_outcome(world), key, waypoints[first + lane], p, ())
                    store_world(tile, lane, world)
                    told[distance, lane] = outcome.distance
                    show_lane(scratch, lane, world, p)
        show_lanes(scratch, count, observations[first:])
        return flagged

    return step_tile


def _room_tile_of(system: System, shares: bool) -> Callable[..., int]:
    """Return the kernel that advances a tile in surroundings: in vectors up to looking, and then one by one."""
    (_, _, act, conclude, retarget), around = step_of(system), system.surroundings
    load_parameters, load_world, store_world, show, _, _, show_scene, tell, _ = parts_of(system, None, shares)
    scene_at, size = around.at, layout_of(system).world.size * TILE

    @kernel
    def step_tile(first, count, actions, tile, keys, parameters, origin, waypoints, observations, outcomes, scenes):
        moved_tile, asked, flagged = compiled_scratch(size), actions[2 * first :], 0
        for lane in range(count):
            p = load_parameters(parameters, origin + lane)
            command = command_of(asked[2 * lane], asked[2 * lane + 1], p.robot)
            store_world(moved_tile, lane, act(load_world(tile, lane), command, int(keys[lane]), p))
        for lane in range(count):
            row, p, key = first + lane, load_parameters(parameters, origin + lane), int(keys[lane])
            scene, world, moved = scene_at(scenes, row), load_world(tile, lane), load_world(moved_tile, lane)
            world, outcome = conclude(world, moved, key, waypoints.shape[1], p, scene)
            if outcome.reached:
                world, outcome = retarget(world, outcome, key, waypoints[row], p, scene)
            store_world(tile, lane, world)
            tell(outcomes, row, outcome)
            show(observations[row], world, p)
            show_scene(observations[row], scene)
            flagged += outcome.is_success | outcome.terminated | outcome.truncated
        return flagged

    return step_tile


@cache
def loops_of(system: System, case: Case | None = None, shares: bool = False) -> Loops:
    """Return the loops of a system, compiled, or in plain Python; processes share them through the cache.

    Args:
        system: The system.
        case: What loops of open ground are made for; None for plain Python, and for rooms.
        shares: Whether outcomes have rows for the shares of the reward.
    """
    layout, around = layout_of(system), system.surroundings
    if case is None and not (HAS_LLVM and system.compiled and system.in_room):
        return Loops(layout.world, {}, *plain_loops(system))
    world, constants = reduced(system, case) if case else (layout.world, MappingProxyType({}))
    step_tile = _open_tile_of(system, case, shares) if case else _room_tile_of(system, shares)
    width = (len(own_of(system, case)) if case else layout.parameters.size) * TILE
    begin, start_outcome, *_ = step_of(system)
    load_parameters, load_world, store_world, show, _, _, show_scene, tell, _ = parts_of(system, case, shares)
    lay_out, scene_at = system.lay_out, around.at

    def step_rows(first, last, actions, tiles, keys, parameters, waypoints, observations, outcomes, scenes):
        prefer_wide()
        flagged = 0
        for at in range(first, last):
            origin = at * width if len(parameters) > width else 0
            row, count = at * TILE, min(TILE, len(observations) - at * TILE)
            flagged += step_tile(
                row, count, actions, tiles[at], keys[at], parameters, origin, waypoints, observations, outcomes, scenes
            )
        return flagged

    def reset_rows(
        first, last, mask, begins, seeds, episodes, tiles, keys, parameters, waypoints, observations, outcomes, scenes
    ):
        for row in range(first * TILE, min(last * TILE, len(mask))):
            if mask[row]:
                at, lane = row // TILE, row % TILE
                tile, scene = tiles[at], scene_at(scenes, row)
                p = load_parameters(parameters, (at * width if len(parameters) > width else 0) + lane)
                if begins:
                    key = episode_key(int(seeds[row]), int(episodes[row]))
                    keys[at, lane] = key
                    start, goal = lay_out(key, p, scene)
                    if p.task.random:
                        waypoints[row, 0, 0], waypoints[row, 0, 1], waypoints[row, 0, 2] = goal.x, goal.y, goal.theta
                    store_world(tile, lane, begin(start, key, waypoints[row], p, scene))
                world = load_world(tile, lane)
                tell(outcomes, row, start_outcome(world))
                show(observations[row], world, p)
                show_scene(observations[row], scene)

    where, (step, reset) = ("on open ground", (2, 1)) if case else ("in rooms", (3, 3))
    return Loops(world, constants, compiled(step_rows, f"steps {where}", step), compiled(reset_rows, f"resets {where}", reset))
