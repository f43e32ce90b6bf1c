"""Measure the cost of a unit of work with 1 and 2 workers of this machine, and extrapolate to 1,000.

Measured: the same evaluation without workers and with each number of them, in turn; empty units, for the overhead of a unit;
the size of a result; the driver's work per result. The plan for more workers is calculated from those numbers, and says so.

`make bench-cluster` runs it.
"""

from __future__ import annotations

import os
import resource
import time
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from harness.study import Study, run
from turtlebot_gym_agents.cluster.drives import CHUNK, DriveUnit, drives
from turtlebot_gym_agents.cluster.trainings import Training
from turtlebot_gym_agents.cluster.units import Result, Store, Workers, complete, in_turn, key
from turtlebot_gym_agents.cluster.workers import AHEAD, workers_on
from turtlebot_gym_agents.training.config import TrainingConfig

NAV = "turtlebot_gym/TurtleBotNav-v0"
PLANNED = (2, 16, 128, 1000)
"""Numbers of workers in the plan."""


@dataclass(frozen=True, kw_only=True)
class Config(Study):
    """Measure and extrapolate."""

    episodes: int = 8000
    """Episodes of the timed evaluation."""
    empty: int = 200
    """Number of empty units."""
    rounds: int = 2
    """Turns of each number of workers; the best one counts."""


@dataclass(frozen=True, kw_only=True)
class Empty:
    """A unit that does nothing and returns as much data as 250 episodes."""

    number: int
    memory = 0
    size = 1

    def about(self) -> dict[str, Any]:
        """Return what distinguishes it from the others."""
        return {"empty": self.number}

    def run(self) -> Result:
        """Return numbers."""
        return Result({}, {"numbers": np.zeros(25 * CHUNK)}, {}, {})


def seconds_of(units: list[Any], workers: Workers) -> float:
    """Return the time for some units, s."""
    begun = time.perf_counter()
    complete(units, workers=workers)
    return time.perf_counter() - begun


def measured(config: Config) -> dict[str, Any]:
    """Return the time of units by number of workers, with 0 for none, and the time to start them, s."""
    asked = {"env": NAV, "episodes": config.episodes, "seed": 0}
    work, empty = drives("bearing", **asked), [Empty(number=number) for number in range(config.empty)]
    complete(work[:1])  # compiled
    results: dict[int, dict[str, float]] = {}
    for turn in range(config.rounds):
        for workers in (0, 1, 2):
            begun = time.perf_counter()
            if workers == 0:
                row = {"work": seconds_of(work, in_turn), "empty": seconds_of(empty, in_turn)}
            else:
                with workers_on("local", workers=workers, memory=DriveUnit.memory) as here:
                    complete(work[: 2 * workers], workers=here)  # workers have started and loaded the loops
                    start = time.perf_counter() - begun
                    row = {"start": start, "work": seconds_of(work, here), "empty": seconds_of(empty, here)}
            best = results.setdefault(workers, row)
            results[workers] = {name: min(value, best[name]) for name, value in row.items()}
            print(f"round {turn}, {workers} workers: {row}", flush=True)
    return {"units": len(work), "by_workers": results}


@dataclass(frozen=True, kw_only=True)
class Peak:
    """A unit that runs another one, and reports the peak memory of its process."""

    unit: Any
    memory = 0
    size = 1

    def about(self) -> dict[str, Any]:
        """Return the other unit's description."""
        return {"peak": self.unit.about()}

    def run(self) -> Result:
        """Run the unit."""
        self.unit.run()
        return Result({"bytes": 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss}, {}, {}, {})


def peaks() -> dict[str, float]:
    """Return the memory of a worker for a unit of each kind, bytes."""
    (drive,) = drives("ppo-nav", env=NAV, episodes=CHUNK, seed=0)
    results = {}
    for name, unit in (("drive", drive), ("training", Training.of(TrainingConfig(steps=20_000, evaluations=1)))):
        with workers_on("local", workers=2) as here:
            results[name] = complete([Peak(unit=unit)], workers=here)[0].facts["bytes"]
    return results


def driver() -> dict[str, float]:
    """Return the driver's cost of a result: bytes, and seconds to name its unit and to store it."""
    (unit,) = drives("bearing", env=NAV, episodes=CHUNK, seed=CHUNK)
    result = complete([unit])[0]
    held = sum(array.nbytes for array in result.arrays.values())
    count = 200
    with TemporaryDirectory() as folder:
        store = Store(Path(folder))
        begun = time.process_time()
        for number in range(count):
            store.put(str(number), result)
        keeping = (time.process_time() - begun) / count
        kept = next(Path(folder).iterdir()).stat().st_size
    begun = time.process_time()
    for _ in range(count):
        key(unit)
    return {
        "bytes_held": held,
        "bytes_stored": kept,
        "seconds_to_store": keeping,
        "seconds_to_name": (time.process_time() - begun) / count,
    }


def plan(found: dict[str, Any], costs: dict[str, float], config: Config) -> dict[str, Any]:
    """Return the plan for more workers, by arithmetic only; nothing of it was run.

    A worker's time per unit is that of the evaluation; the driver's is that of empty units, including the store.
    """
    times = found["by_workers"]
    unit = times[0]["work"] / found["units"]
    seconds = times[2]["empty"] / config.empty + costs["seconds_to_store"]
    rows = {}
    for workers in PLANNED:
        wanted = workers / unit
        rows[str(workers)] = {
            "results_per_second_wanted": wanted,
            "driver_busy": wanted * seconds,
            "megabytes_per_second": wanted * costs["bytes_held"] / 1e6,
            "object_store_megabytes": workers * (1 + AHEAD) * costs["bytes_held"] / 1e6,
            "driver_memory_gigabytes_an_hour": 3600.0 * min(wanted, 1.0 / seconds) * costs["bytes_held"] / 1e9,
        }
    return {
        "seconds_of_a_unit": unit,
        "driver_seconds_of_a_unit": seconds,
        "workers_that_one_driver_feeds": unit / seconds,
        "unit_seconds_for_1000_workers": 1000.0 * seconds,
        "episodes_in_a_unit_for_1000_workers": CHUNK * 1000.0 * seconds / unit,
        "by_workers": rows,
    }


def measure(config: Config) -> tuple[dict[str, Any], list[Any]]:
    """Measure, extrapolate, and print what matters most."""
    results, costs = measured(config), driver()
    times = results["by_workers"]
    result = {
        "machine": {"cores": os.cpu_count(), "load": os.getloadavg()},
        "measured": results,
        "ratio_of_2_workers_to_1": times[1]["work"] / times[2]["work"],
        "overhead_of_a_unit": {str(n): (times[n]["empty"] - times[0]["empty"]) / config.empty for n in (1, 2)},
        "driver": costs,
        "memory_of_a_worker": peaks(),
        "planned": plan(results, costs, config),
    }
    print(f"2 workers do {result['ratio_of_2_workers_to_1']:.2f} times what 1 does.")
    print(f"A unit costs {result['overhead_of_a_unit']} s beside its work.")
    print(f"One driver feeds {result['planned']['workers_that_one_driver_feeds']:.0f} workers.")
    return result, []


if __name__ == "__main__":
    run(Config, measure, beside=__file__)
