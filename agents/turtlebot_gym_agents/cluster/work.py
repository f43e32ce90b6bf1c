"""Units and their results: stored results are reused, and missing ones are computed and stored as they arrive."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any

from turtlebot_gym_agents.cluster.store import Result, Store
from turtlebot_gym_agents.cluster.units import Unit, drives, episodes_of, key, run, trajectory_of
from turtlebot_gym_agents.evaluation.episodes import concatenate
from turtlebot_gym_agents.evaluation.evaluate import NAV, Evaluation, require_known

Workers = Callable[[Iterable[tuple[str, Unit]]], Iterator[tuple[str, Result]]]
"""Function that runs units, taken as needed, and yields their results in any order, both with their keys."""


def in_turn(units: Iterable[tuple[str, Unit]]) -> Iterator[tuple[str, Result]]:
    """Run units in this process, one after another."""
    for name, unit in units:
        yield name, run(unit)


def complete(
    units: Sequence[Unit],
    *,
    workers: Workers = in_turn,
    store: Store | None = None,
    progress: Callable[[int], None] = lambda done: None,
) -> list[Result]:
    """Return the results of units, in their order.

    Args:
        units: The units; equal ones run once.
        workers: Function that runs them; results do not depend on it.
        store: Store of the results. A unit whose result is there is not run.
        progress: Called with the total size of the units that have a result.

    Raises:
        ValueError, OSError, ImportError: Raised by a unit.
    """
    keys = [key(unit) for unit in units]
    sizes: dict[str, int] = {}
    for name, unit in zip(keys, units, strict=True):
        sizes[name] = sizes.get(name, 0) + unit.size
    found = {name: store.get(name) for name in sizes if name in store} if store else {}
    done = sum(sizes[name] for name in found)
    progress(done)
    missing = {name: unit for name, unit in zip(keys, units, strict=True) if name not in found}
    for name, result in workers(missing.items()) if missing else ():
        if store:
            store.put(name, result)
        found[name] = result
        done += sizes[name]
        progress(done)
    return [found[name] for name in keys]


def evaluation(units: Sequence[Unit], results: Sequence[Result], config: Mapping[str, Any]) -> Evaluation:
    """Combine the results of `units.drives` into one, as `evaluation.evaluate.evaluate` returns it."""
    first = results[0]
    return Evaluation(
        config=dict(config),
        limit=first.facts["limit"],
        max_linear=first.facts["max_linear"],
        episodes=concatenate([episodes_of(result.arrays) for result in results]),
        trajectory=trajectory_of(first.arrays),
    )


def evaluate_all(
    asked: Sequence[Mapping[str, Any]],
    *,
    workers: Workers = in_turn,
    store: Store | None = None,
    progress: Callable[[int], None] = lambda done: None,
) -> list[Evaluation]:
    """Return several evaluations, split into units.

    Args:
        asked: The arguments of `evaluation.evaluate.evaluate` for each; a policy is given by its name.
        workers: See `complete`, as for the next.
        store: Store of the results.
        progress: Called with the number of episodes driven.
    """
    parts, configs = [], []
    for one in asked:
        config = {"env": NAV, "episodes": 1000, "seed": 0, **one}
        if not (isinstance(config["episodes"], int) and config["episodes"] > 0):
            raise ValueError(f"episodes must be a positive whole number, got {config['episodes']!r}.")
        require_known(config["env"], config["seed"])
        parts.append(drives(**config))
        configs.append(config)
    units = [unit for part in parts for unit in part]
    results = complete(units, workers=workers, store=store, progress=progress)
    found, at = [], 0
    for part, config in zip(parts, configs, strict=True):
        head = {name: config[name] for name in ("env", "policy", "episodes", "seed")}
        told = {name: value for name, value in config.items() if name != "allow_mismatch"}  # as `evaluate` records it
        found.append(evaluation(part, results[at : at + len(part)], head | told))
        at += len(part)
    return found
