"""The compiled loops of a system: many environments in one buffer, advanced by the same kernels that plain Python runs.

Why it is fast: each number of a tile is stored environment by environment (see `packing`), and the kernels have no
branches and call no library, so LLVM vectorizes the loop over a tile, with eight environments per instruction; threads
share the tiles. Rare work with branches, such as a new waypoint or a reset, runs between those loops. The most common
parameters have their own loop, see `systems.special`. Why it is exact: nothing is reordered or contracted
(`kernel.algebra` says what is left out), so no bit of a result depends on the vector width, the number of threads or the batch.

What a case leaves out is a kernel that does nothing: with constant conditions instead, a step takes 4 % longer.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

from turtlebot_gym.compiled.cache import compiled
from turtlebot_gym.compiled.packing import LINE, TILE, Layout, access_of, layout_of
from turtlebot_gym.compiled.plain import plain_loops
from turtlebot_gym.compiled.step import step_of
from turtlebot_gym.kernel import HAS_NUMBA, compiled_scratch, fetch, kernel, prefer_wide
from turtlebot_gym.models.random import episode_key
from turtlebot_gym.models.unicycle import command_of
from turtlebot_gym.observations import ColumnRun, SceneColumns, runs_of
from turtlebot_gym.systems import Outcome, System
from turtlebot_gym.systems.special import Special, late_fixes

_SUCCESS = Outcome._fields.index("is_success")
FLAGS = slice(_SUCCESS, _SUCCESS + 3)
"""The rows of success, termination and truncation in an outcome."""
_LARGE = 250_000
"""Numbers in the tiles of a thread from which on they are fetched ahead: 2 MB, about a core's own cache."""


class _Loops(NamedTuple):
    """The compiled functions of a system, each compiled at its first call."""

    layout: Layout
    step: Callable[..., None]
    """Advances some tiles. After the keys of a tile come its own number, and how many flags are set in it and those before."""
    reset: Callable[..., None]
    """Begins episodes of some environments in some tiles, or writes their current observations again."""


def _show_blocks_of(blocks: tuple[SceneColumns, ...]) -> Callable[..., None]:
    """Return the kernel that writes arrays of the scene into an environment's observation."""
    if not blocks:
        return kernel(lambda environment, scene, observations: None)
    (of, width, column), rest = blocks[0], _show_blocks_of(blocks[1:])

    @kernel
    def show_blocks(environment, scene, observations):
        numbers = of(scene)
        for k in range(width):
            observations[environment, column + k] = numbers[k]
        rest(environment, scene, observations)

    return show_blocks


def _show_runs_of(runs: tuple[ColumnRun, ...]) -> Callable[..., None]:
    """Return the kernel that copies the numbers in a scratch to an environment's observation."""
    if not runs:
        return kernel(lambda scratch, lane, shown: None)
    (start, stop, column), rest = runs[0], _show_runs_of(runs[1:])
    further = column - start

    @kernel
    def show_runs(scratch, lane, shown):
        for k in range(start, stop):
            shown[k + further] = scratch[k * TILE + lane]
        rest(scratch, lane, shown)

    return show_runs


def _apply_fix_tile_of(system: System, special: Special) -> Any:
    """Return the kernel that goes on where a fix has arrived, see `systems.special`."""
    if not special.late:

        @kernel
        def no_fix(count, tile, scratch, keys, parameters, origin):
            """Do nothing: no fix arrives."""

        return no_fix
    load_parameters, load_world, store_world, _, _, show = access_of(system, special)
    apply_fix, world = late_fixes(special.late).apply_fix, layout_of(system, special).world
    at_arrived = world.places[world.names.index("senses.fix.arrived")] * TILE

    @kernel
    def apply_fix_tile(count, tile, scratch, keys, parameters, origin):
        for start in range(0, count, LINE):
            end, some = min(start + LINE, count), 0.0
            for lane in range(start, end):
                some += tile[at_arrived + lane]
            if some != 0.0:
                for lane in range(start, end):
                    p = load_parameters(parameters, origin + lane)
                    world = apply_fix(load_world(tile, lane), int(keys[lane]), p)
                    store_world(tile, lane, world)
                    show(scratch, lane, world, p)

    return apply_fix_tile


def _advance_tile_of(system: System, special: Special) -> Callable[..., None]:
    """Return the kernel of a tile's steps on open ground: in vectors, and one by one where a waypoint was reached."""
    step = step_of(system)
    without_fix = (
        step_of(late_fixes(special.late).without_fix_effects._replace(rewards=system.rewards)) if special.late else step
    )
    act, conclude, retarget, apply_fix_tile = (
        without_fix.act,
        without_fix.conclude,
        step.retarget,
        _apply_fix_tile_of(system, special),
    )
    load_parameters, load_world, store_world, load_outcome, store_outcome, show = access_of(system, special)
    layout = layout_of(system, special)
    at_outcome, at_action = layout.at_outcome, layout.at_action
    at_reached = at_outcome + layout.outcome.names.index("reached") * TILE

    @kernel
    def advance_tile(first, count, tile, scratch, keys, parameters, origin, waypoints, observations, scenes):
        for lane in range(count):
            p, world, key = load_parameters(parameters, origin + lane), load_world(tile, lane), int(keys[lane])
            command = command_of(scratch[at_action + lane], scratch[at_action + TILE + lane], p.robot)
            world, outcome = conclude(world, act(world, command, key, p), key, waypoints.shape[1], p, ())
            store_world(tile, lane, world)
            store_outcome(scratch, at_outcome + lane, outcome)
            show(scratch, lane, world, p)
        apply_fix_tile(count, tile, scratch, keys, parameters, origin)
        for lane in range(count):
            if scratch[at_reached + lane] != 0.0:
                p = load_parameters(parameters, origin + lane)
                world, outcome = load_world(tile, lane), load_outcome(scratch, at_outcome + lane)
                world, outcome = retarget(world, outcome, int(keys[lane]), waypoints[first + lane], p, ())
                store_world(tile, lane, world)
                store_outcome(scratch, at_outcome + lane, outcome)
                show(scratch, lane, world, p)

    return advance_tile


def _look_round_tile_of(system: System, special: Special) -> Callable[..., None]:
    """Return the kernel of a tile's steps in surroundings: in vectors up to looking, and then one by one."""
    step, around = step_of(system), system.surroundings
    assert around is not None
    act, conclude, retarget, scene_at = step.act, step.conclude, step.retarget, around.at
    load_parameters, load_world, store_world, _, store_outcome, show = access_of(system, special)
    layout, show_blocks = layout_of(system, special), _show_blocks_of(runs_of(system.terms)[1])
    at_outcome, at_action, size = layout.at_outcome, layout.at_action, layout.world.size * TILE

    @kernel
    def look_round_tile(first, count, tile, scratch, keys, parameters, origin, waypoints, observations, scenes):
        moved_tile = compiled_scratch(size)
        for lane in range(count):
            p = load_parameters(parameters, origin + lane)
            command = command_of(scratch[at_action + lane], scratch[at_action + TILE + lane], p.robot)
            store_world(moved_tile, lane, act(load_world(tile, lane), command, int(keys[lane]), p))
        for lane in range(count):
            p, scene, key = load_parameters(parameters, origin + lane), scene_at(scenes, first + lane), int(keys[lane])
            world, moved = load_world(tile, lane), load_world(moved_tile, lane)
            world, outcome = conclude(world, moved, key, waypoints.shape[1], p, scene)
            if outcome.reached:
                world, outcome = retarget(world, outcome, key, waypoints[first + lane], p, scene)
            store_world(tile, lane, world)
            store_outcome(scratch, at_outcome + lane, outcome)
            show_blocks(first + lane, scene, observations)
        for lane in range(count):
            show(scratch, lane, load_world(tile, lane), load_parameters(parameters, origin + lane))

    return look_round_tile


def _step_tile_of(system: System, special: Special) -> Callable[..., int]:
    """Return the kernel that advances a tile of environments."""
    layout = layout_of(system, special)
    outcome, at_outcome, at_action, size = layout.outcome, layout.at_outcome, layout.at_action, layout.scratch
    first_flag, end_of_flags = FLAGS.start, FLAGS.stop
    work_tile = (_look_round_tile_of if system.surroundings else _advance_tile_of)(system, special)
    n_outcome, n_judged, show_runs = outcome.size, outcome.size - len(system.rewards), _show_runs_of(runs_of(system.terms)[0])

    @kernel
    def step_tile(first, count, actions, tile, keys, parameters, origin, waypoints, observations, outcomes, scenes):
        """Advance the ``count`` environments of a tile whose first environment is ``first``; return how many flags are set."""
        scratch = compiled_scratch(size)
        asked, shown = actions[first : first + count], observations[first : first + count]
        for lane in range(count):
            scratch[at_action + lane] = asked[lane, 0]
            scratch[at_action + TILE + lane] = asked[lane, 1]
        work_tile(first, count, tile, scratch, keys, parameters, origin, waypoints, observations, scenes)
        for lane in range(count):
            show_runs(scratch, lane, shown[lane])
        for k in range(n_judged):
            column = outcomes[k][first : first + count]
            for lane in range(count):
                column[lane] = scratch[at_outcome + k * TILE + lane]
        if len(outcomes) > n_judged:  # the shares of the reward, where somebody asks for them
            for k in range(n_judged, n_outcome):
                column = outcomes[k][first : first + count]
                for lane in range(count):
                    column[lane] = scratch[at_outcome + k * TILE + lane]
        flagged = 0
        for k in range(first_flag, end_of_flags):
            for lane in range(count):
                flagged += scratch[at_outcome + k * TILE + lane] != 0.0
        return flagged

    return step_tile


def _reset_lane_of(system: System, special: Special) -> Callable[..., None]:
    """Return the kernel that begins an episode of one environment, or writes its current observation."""
    step, lay_out, around = step_of(system), system.lay_out, system.surroundings
    begin, start_outcome = step.begin, step.start_outcome
    scene_at = around.at if around else kernel(lambda scenes, index: ())
    load_parameters, load_world, store_world, _, store_outcome, show = access_of(system, special)
    layout = layout_of(system, special)
    at_outcome, size = layout.at_outcome, layout.scratch
    runs, blocks = runs_of(system.terms)
    show_runs, show_blocks = _show_runs_of(runs), _show_blocks_of(blocks)

    @kernel
    def reset_lane(environment, lane, begins, tile, key, parameters, origin, waypoints, observations, outcomes, scenes):
        scratch, p, scene = compiled_scratch(size), load_parameters(parameters, origin + lane), scene_at(scenes, environment)
        if begins:
            start, goal = lay_out(key, p, scene)
            if p.task.random:
                waypoints[0, 0], waypoints[0, 1], waypoints[0, 2] = goal.x, goal.y, goal.theta
            store_world(tile, lane, begin(start, key, waypoints, p, scene))
        world = load_world(tile, lane)
        store_outcome(scratch, at_outcome, start_outcome(world))
        show(scratch, 0, world, p)
        show_runs(scratch, 0, observations[environment])
        show_blocks(environment, scene, observations)
        for k in range(len(outcomes)):
            outcomes[k, environment] = scratch[at_outcome + k * TILE]

    return reset_lane


@cache
def loops_of(system: System, special: Special) -> _Loops:
    """Return the compiled loops of a system, general or for a special case; processes share them through the cache."""
    if not (HAS_NUMBA and system.compiled):
        return _Loops(layout_of(system, special), *plain_loops(system, special))
    step_tile, reset_lane = _step_tile_of(system, special), _reset_lane_of(system, special)
    layout, place = layout_of(system, special), "in rooms" if system.surroundings else "on open ground"
    ahead, width = layout.parameters.ahead, layout.parameters.size * TILE
    many = _LARGE // (layout.world.size * TILE)

    def step_rows(actions, tiles, keys, parameters, waypoints, observations, outcomes, scenes):
        prefer_wide()
        flagged = 0
        for at in range(len(tiles)):
            number = keys[at, TILE]
            origin = ahead + (number * width if len(parameters) > ahead + width else 0)
            count = min(TILE, len(actions) - number * TILE)
            tile, own = tiles[at], keys[at]
            if len(tiles) > many:  # the processor itself does not foresee where the next tile's runs are
                following = tiles[min(at + 1, len(tiles) - 1)]
                for place in range(0, len(following), LINE):
                    fetch(following, place)
            flagged += step_tile(
                number * TILE, count, actions, tile, own, parameters, origin, waypoints, observations, outcomes, scenes
            )
            own[TILE + 1] = flagged

    def reset_rows(mask, begins, seeds, episodes, tiles, keys, parameters, waypoints, observations, outcomes, scenes):
        for at in range(len(tiles)):
            number = keys[at, TILE]
            origin = ahead + (number * width if len(parameters) > ahead + width else 0)
            for environment in range(number * TILE, min((number + 1) * TILE, len(mask))):
                if mask[environment]:
                    lane, visited = environment % TILE, waypoints[environment]
                    if begins:
                        keys[at, lane] = episode_key(int(seeds[environment]), int(episodes[environment]))
                    key = int(keys[at, lane])  # signed: a mix of unsigned and signed integers becomes a float
                    reset_lane(
                        environment, lane, begins, tiles[at], key, parameters, origin, visited, observations, outcomes, scenes
                    )

    case = f" {special.name}" if special.name else ""
    return _Loops(layout, compiled(step_rows, f"steps {place}{case}"), compiled(reset_rows, f"resets {place}{case}"))
