"""The loops of a system on all threads, without compiling them a second time.

numba would compile a loop with ``prange`` as a whole, once more for each system. The loops here only divide the tiles among the
threads and call a system's serial loop by its address, so one for each kind of scene serves all systems.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from turtlebot_gym.compiled.cache import compiled


def address_of(loop: Any, *arguments: Any) -> int:
    """Return the address of a loop's machine code for the types of some arguments."""
    from numba import typeof

    kinds = tuple(map(typeof, arguments))
    loop.compile(kinds)
    result = loop.overloads[kinds]
    return result.library.get_pointer_to_function(result.fndesc.llvm_func_name)


@cache
def parallel_loop(name: str) -> Callable[..., None]:
    """Return the loop that divides the tiles of a "step" or a "reset" among the threads.

    Its arguments are the address of a system's loop, the number of parts, and the arguments of that loop.
    """
    from numba import prange

    from turtlebot_gym.intrinsics import call

    def step(address, parts, actions, tiles, keys, parameters, waypoints, observations, outcomes, scenes):
        for index in prange(parts):
            part = np.int64(index)  # prange counts in unsigned integers; mixed with signed ones they become floats
            some = slice(part * len(tiles) // parts, (part + 1) * len(tiles) // parts)
            call(address, (actions, tiles[some], keys[some], parameters, waypoints, observations, outcomes, scenes))

    def reset(
        address, parts, mask, begins, seeds, episodes, tiles, keys, parameters, waypoints, observations, outcomes, scenes
    ):
        for index in prange(parts):
            part = np.int64(index)
            some = slice(part * len(tiles) // parts, (part + 1) * len(tiles) // parts)
            orders, state = (mask, begins, seeds, episodes), (tiles[some], keys[some], parameters, waypoints)
            call(address, orders + state + (observations, outcomes, scenes))  # compiled code has no stars

    return compiled({"step": step, "reset": reset}[name], f"{name}s on all threads", parallel=True)
