"""The environments' loops in plain Python: without a compiler, in a debugger, and for plants that are no kernels.

They take the arguments of the compiled loops (`compiled.loop`), and run `turtlebot_gym.heart` for each environment in turn.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from turtlebot_gym import heart
from turtlebot_gym.compiled.packing import TILE, access, flatten, layout_of
from turtlebot_gym.models.random import episode_key
from turtlebot_gym.models.unicycle import command_of
from turtlebot_gym.systems import System


def plain_loops(system: System) -> tuple[Callable[..., int], Callable[..., None]]:
    """Return the loops that advance all environments of some tiles, and that begin episodes or write observations again."""
    layout, around = layout_of(system), system.surroundings
    (load_parameters, _), (load_world, store_world) = access(layout.parameters), access(layout.world)
    begin, start_outcome, *_ = heart.step_of(system)
    width = layout.parameters.size * TILE

    def parts(row, tiles, parameters, scenes):
        """Return an environment's tile, its place there, parameters and scene."""
        at, lane = divmod(row, TILE)
        origin = at * width if len(parameters) > width else 0
        return tiles[at], lane, load_parameters(parameters, origin + lane), around.at(scenes, row)

    def write(row, world, outcome, p, scene, observations, outcomes):
        observations[row] = heart.observe(system, world, p, scene)
        outcomes[:, row] = [*flatten(outcome)][: len(outcomes)]

    def step_rows(first, last, actions, tiles, keys, parameters, waypoints, observations, outcomes, scenes):
        flagged = 0
        for row, (forward, turn) in enumerate(actions.reshape(-1, 2)[: len(observations)].tolist()):
            tile, lane, p, scene = parts(row, tiles, parameters, scenes)
            world, key = load_world(tile, lane), int(keys[row // TILE, lane])
            world, outcome = heart.step(system, world, command_of(forward, turn, p.robot), key, waypoints[row], p, scene)
            store_world(tile, lane, world)
            write(row, world, outcome, p, scene, observations, outcomes)
            flagged += outcome.is_success + outcome.terminated + outcome.truncated
        return flagged

    def reset_rows(
        first, last, mask, begins, seeds, episodes, tiles, keys, parameters, waypoints, observations, outcomes, scenes
    ):
        for row in np.flatnonzero(mask).tolist():
            tile, lane, p, scene = parts(row, tiles, parameters, scenes)
            if begins:
                keys[row // TILE, lane] = key = episode_key(int(seeds[row]), int(episodes[row]))
                start, goal = system.lay_out(key, p, scene)
                if p.task.random:
                    waypoints[row, 0] = goal
                store_world(tile, lane, begin(start, key, waypoints[row], p, scene))
            world = load_world(tile, lane)
            write(row, world, start_outcome(world), p, scene, observations, outcomes)

    return step_rows, reset_rows
