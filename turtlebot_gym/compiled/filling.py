"""Fill the cache before it is needed: on a robot, in a container, before tests."""

from __future__ import annotations

import multiprocessing
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from typing import Any

import numpy as np

from turtlebot_gym.compiled.batch import PARALLEL_FROM, ROOMS_PARALLEL_FROM, Batch
from turtlebot_gym.config import as_int, choose
from turtlebot_gym.kernel import HAS_LLVM
from turtlebot_gym.systems import Options

_FILTERS: dict[str, dict[str, Any]] = {
    "kalman": {},
    "wheels": {"noise": "wheel"},
    "gated": {"filter": "gated"},
}
SYSTEMS: dict[str, dict[str, Any]] = {
    "nav": {},
    **{
        f"{name}{fixes}": {"task": "square", **of_filter, **({"fix": "beacons"} if fixes else {})}
        for fixes in ("", "+fixes")
        for name, of_filter in _FILTERS.items()
    },
    **{f"rooms-{name}": {"task": "room", **of_filter} for name, of_filter in _FILTERS.items()},
    "rooms-localized": {"task": "room", "noise": "wheel", "localizer": "match"},
}
"""Options of an environment for each system: open ground by default; with each filter, without and with fixes; rooms with
each filter, and with a localizer. In rooms other numbers need no compilation, except for other delays of fixes."""


def _fill(name: str) -> float:
    """Compile a system's loops if need be, and return how long it took, s."""
    began = time.perf_counter()
    parameters, waypoints, plan, _ = Options(**SYSTEMS[name]).setup()
    for number in (1, ROOMS_PARALLEL_FROM if parameters.room else PARALLEL_FROM):
        batch = Batch(number, parameters, waypoints, plan=plan)
        batch.reset(np.ones(number, np.bool_), *batch.empty())
        batch.step(np.zeros((number, 2), np.float32))
    return time.perf_counter() - began


def fill_all(
    names: Sequence[str], *, processes: int = 1, progress: Callable[[int], None] = lambda done: None
) -> dict[str, float]:
    """Compile the loops of some systems, and return how long each took, s.

    Args:
        names: Of `SYSTEMS`.
        processes: How many processes compile at a time; they share the cache.
        progress: Called with the number of systems that are done.

    Raises:
        ValueError: If a name is unknown.
        ImportError: If llvmlite is missing, or compilation is disabled.
    """
    for name in names:
        choose("system", name, SYSTEMS)
    if not HAS_LLVM:
        raise ImportError(
            "Nothing is compiled without llvmlite: pip install 'turtlebot-gym[gym]', and unset TURTLEBOT_GYM_PLAIN."
        )
    times: dict[str, float] = {}
    order = sorted(names, key=lambda name: not name.startswith("rooms"))  # the longest first
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(as_int("processes", processes, 1), context, _in_silence) as pool:
        running = {pool.submit(_fill, name): name for name in order}
        for done, future in enumerate(as_completed(running), 1):
            times[running[future]] = future.result()
            progress(done)
    return {name: times[name] for name in names}


def _in_silence() -> None:
    """Leave the terminal to the process that shows the progress."""
    from turtlebot_gym.compiled import store

    store.say = lambda text: None
