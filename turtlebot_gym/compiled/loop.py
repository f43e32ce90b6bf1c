"""The compiled loops: many environments in one buffer, advanced by the same kernels that plain Python runs.

A tile is stepped in vectors up to looking, since its kernels have no branches and call no library, and then one by one;
threads share the tiles. Nothing is reordered or contracted (`kernel.algebra` says what is left out), so no bit of a result
depends on the vector width, the number of threads or the batch.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from types import MappingProxyType
from typing import Any, NamedTuple

from turtlebot_gym.compiled.builtins import register_access
from turtlebot_gym.compiled.cache import compiled
from turtlebot_gym.compiled.packing import TILE, Packing, layout_of, packing
from turtlebot_gym.compiled.plain import plain_loops
from turtlebot_gym.compiled.proof import Case, own_of, reduced
from turtlebot_gym.compiled.step import NOWHERE, step_of
from turtlebot_gym.kernel import HAS_LLVM, compiled_scratch, kernel, lanes, prefer_wide
from turtlebot_gym.models.random import episode_key
from turtlebot_gym.models.unicycle import command_of
from turtlebot_gym.observations import ColumnRun, SceneColumns, observing, runs_of
from turtlebot_gym.systems import Outcome, System

_SUCCESS = Outcome._fields.index("is_success")
FLAGS = slice(_SUCCESS, _SUCCESS + 3)
"""The rows of success, termination and truncation in an outcome."""


class Loops(NamedTuple):
    """The functions of a system that step and reset some tiles; compiled ones are compiled at their first call."""

    world: Packing
    constants: Mapping[int, float]
    """What stands at the places of numbers that never change, which compiled loops neither read nor write."""
    step: Callable[..., None]
    """Advances some tiles. After the keys of a tile come its own number, and how many flags are set in it and those before."""
    reset: Callable[..., None]
    """Begins episodes of some environments in some tiles, or writes their current observations again."""


class _Access(NamedTuple):
    """Kernels that load and store the values of a system, and their places in a thread's scratch."""

    load_parameters: Callable[..., Any]
    load_world: Callable[..., Any]
    store_world: Callable[..., None]
    store_outcome: Callable[..., None]
    show: Callable[..., None]
    """``show(scratch, lane, world, p)`` writes an observation to the scratch."""
    at_outcome: int
    """Offset of the outcome in the scratch, after the observation."""
    at_action: int
    scratch: int
    """Numbers in the scratch."""


def _inline(pack: Packing, constants: Mapping[int, float] = MappingProxyType({})) -> Packing:
    """Let compiled loops inline a packing's load and store; ``constants`` stand at some places."""
    places = [place * TILE for place in pack.places]
    register_access(pack.load, pack.store, pack.example, places, {place * TILE: value for place, value in constants.items()})
    return pack


def _parameters_of(system: System, case: Case) -> tuple[Packing, dict[int, float]]:
    """Return the layout of parameters of which some are part of the code."""
    pack, fixed, own = layout_of(system).parameters, dict(case.fixed), own_of(system, case)
    places = [own.index(name) if name not in fixed else len(own) + list(fixed).index(name) for name in pack.names]
    return packing(pack.example, places), dict(enumerate(fixed.values(), len(own)))


@cache
def access_of(system: System, case: Case | None) -> _Access:
    parameters, world, outcome, observation = layout_of(system)
    if case is None:
        parameters, world = _inline(parameters), _inline(world)
    else:
        parameters, world = _inline(*_parameters_of(system, case)), _inline(*reduced(system, case))
    outcome, observation = _inline(outcome), _inline(observation)
    observe, store_observation = observing(system.terms), observation.store

    @kernel
    def show(scratch, lane, world, p):
        store_observation(scratch, lane, observe(world, p))

    at_outcome = observation.size * TILE
    at_action = at_outcome + outcome.size * TILE
    return _Access(parameters.load, world.load, world.store, outcome.store, show, at_outcome, at_action, at_action + 2 * TILE)


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


def _open_tile_of(system: System, case: Case) -> Callable[..., int]:
    """Return the kernel that advances a tile of environments on open ground: in vectors, but for new waypoints."""
    step = step_of(system)
    act, conclude, retarget, start_outcome, number_of_waypoints = *step[1:], case.waypoints
    load_parameters, load_world, store_world, _, show, at_outcome, *_ = access_of(system, case)
    show_runs, reached, distance = _show_runs_of(runs_of(system.terms)[0]), *map(Outcome._fields.index, ("reached", "distance"))
    shares = case.shares

    @kernel
    def tell(told, lane, outcome):
        row = 0
        for number in (*outcome[:-1], *outcome.shares) if shares else outcome[:-1]:
            told[row, lane] = number
            row += 1  # noqa: SIM113  # enumerate is not translated

    @kernel
    def step_tile(first, count, actions, tile, keys, parameters, origin, waypoints, observations, outcomes, scenes):
        """Advance the ``count`` environments of a tile whose first environment is ``first``; return how many have flags."""
        asked, told, shown = actions[2 * first :], outcomes[:, first:], observations[first:]
        scratch, flagged, arrived = compiled_scratch(at_outcome, "float32"), 0, 0
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
            show(scratch, lane, world, p)
            flagged += (outcome.is_success | outcome.terminated | outcome.truncated) & (lane < count)
        if arrived > 0:
            for lane in range(count):
                if told[reached, lane] != 0.0:
                    p, key, world = load_parameters(parameters, origin + lane), int(keys[lane]), load_world(tile, lane)
                    world, outcome = retarget(world, start_outcome(world), key, waypoints[first + lane], p, ())
                    store_world(tile, lane, world)
                    told[distance, lane] = outcome.distance
                    show(scratch, lane, world, p)
        for lane in range(count):
            show_runs(scratch, lane, shown[lane])
        return flagged

    return step_tile


def _look_round_tile_of(system: System) -> Callable[..., None]:
    """Return the kernel of a tile's steps in surroundings: in vectors up to looking, and then one by one."""
    step, around = step_of(system), system.surroundings
    assert around is not None
    act, conclude, retarget, scene_at = step.act, step.conclude, step.retarget, around.at
    load_parameters, load_world, store_world, store_outcome, show, at_outcome, at_action, _ = access_of(system, None)
    show_blocks, size = _show_blocks_of(runs_of(system.terms)[1]), layout_of(system).world.size * TILE

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


def _step_tile_of(system: System) -> Callable[..., int]:
    """Return the kernel that advances a tile of environments."""
    *_, at_outcome, at_action, size = access_of(system, None)
    first_flag, end_of_flags, work_tile, n_outcome = (
        FLAGS.start,
        FLAGS.stop,
        _look_round_tile_of(system),
        layout_of(system).outcome.size,
    )
    n_judged, show_runs = n_outcome - len(system.rewards), _show_runs_of(runs_of(system.terms)[0])

    @kernel
    def step_tile(first, count, actions, tile, keys, parameters, origin, waypoints, observations, outcomes, scenes):
        """Advance the ``count`` environments of a tile whose first environment is ``first``; return how many flags are set."""
        scratch = compiled_scratch(size)
        shown = observations[first : first + count]
        for lane in range(count):
            scratch[at_action + lane] = actions[2 * (first + lane)]
            scratch[at_action + TILE + lane] = actions[2 * (first + lane) + 1]
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


def _reset_lane_of(system: System, case: Case | None) -> Callable[..., None]:
    """Return the kernel that begins an episode of one environment, or writes its current observation."""
    step, lay_out, around = step_of(system), system.lay_out, system.surroundings or NOWHERE
    begin, start_outcome, scene_at = step.begin, step.start_outcome, around.at
    load_parameters, load_world, store_world, store_outcome, show, at_outcome, _, size = access_of(system, case)
    runs, blocks = runs_of(system.terms)
    show_runs, show_blocks = _show_runs_of(runs), _show_blocks_of(blocks)

    @kernel
    def reset_lane(environment, lane, begins, tile, key, parameters, origin, waypoints, observations, outcomes, scenes):
        scratch, p, scene = (
            compiled_scratch(size),
            load_parameters(parameters, origin + lane),
            scene_at(scenes, environment),
        )
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
def loops_of(system: System, case: Case | None = None) -> Loops:
    """Return the loops of a system, compiled, or in plain Python; processes share them through the cache.

    Args:
        system: The system.
        case: What loops of open ground are made for; None for plain Python, and for rooms.
    """
    if case is None and not (HAS_LLVM and system.compiled and system.surroundings):
        return Loops(layout_of(system).world, {}, *plain_loops(system))
    world, constants = reduced(system, case) if case else (layout_of(system).world, {})
    step_tile, reset_lane = _open_tile_of(system, case) if case else _step_tile_of(system), _reset_lane_of(system, case)
    width = (len(own_of(system, case)) if case else layout_of(system).parameters.size) * TILE

    def step_rows(actions, tiles, keys, parameters, waypoints, observations, outcomes, scenes):
        prefer_wide()
        flagged = 0
        for at in range(len(tiles)):
            number = keys[at, TILE]
            origin = number * width if len(parameters) > width else 0
            count = min(TILE, len(observations) - number * TILE)
            tile, own = tiles[at], keys[at]
            flagged += step_tile(
                number * TILE, count, actions, tile, own, parameters, origin, waypoints, observations, outcomes, scenes
            )
            own[TILE + 1] = flagged

    def reset_rows(mask, begins, seeds, episodes, tiles, keys, parameters, waypoints, observations, outcomes, scenes):
        for at in range(len(tiles)):
            number = keys[at, TILE]
            origin = number * width if len(parameters) > width else 0
            for environment in range(number * TILE, min((number + 1) * TILE, len(mask))):
                if mask[environment]:
                    lane, visited = environment % TILE, waypoints[environment]
                    if begins:
                        keys[at, lane] = episode_key(int(seeds[environment]), int(episodes[environment]))
                    key = int(keys[at, lane])  # signed: a mix of unsigned and signed integers becomes a float
                    reset_lane(
                        environment, lane, begins, tiles[at], key, parameters, origin, visited, observations, outcomes, scenes
                    )

    where = "on open ground" if case else "in rooms"
    about = f"{case} {world.places}" if case else ""
    step, reset = (2, 1) if case else (3, 3)
    return Loops(
        world,
        constants,
        compiled(step_rows, f"steps {where}", about, step),
        compiled(reset_rows, f"resets {where}", about, reset),
    )
