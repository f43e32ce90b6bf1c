"""Compare the live graph with the environment: equality in lock-step, closeness in real time, and speed.

In lock-step each run of the graph, in one process or in four, alone or beside busy processes, must give the same bytes, without
any difference from the environment's episode of the same seed. In real time, under the same load, the estimate's error must
equal the environment's. Run ``make bench-lockstep``.
"""

from __future__ import annotations

import os
import resource
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from rich.console import Console

from harness.machine import busy, cores
from harness.study import Study, measured, run
from lockstep_drives import (
    DT,
    RoomDrive,
    SquareDrive,
    differences,
    digest,
    episode,
    live,
    room_differences,
    room_episode,
    room_live,
)
from turtlebot_gym.drives import Drive, position_error
from turtlebot_gym_ros import Graph
from turtlebot_gym_ros.graph.bringup import room_metrics

DOMAINS = range(180, 215)
"""ROS domains of graphs that run at the same time; users and the tests use others."""

AT_ONCE = 2
"""Number of simultaneous graphs in real time."""


@dataclass(frozen=True, kw_only=True)
class Config(Study):
    """Compare the live graph with the environment."""

    steps: int = 600
    """Length of a drive."""
    runs: int = 20
    """Runs of the same drive in one process, and as many in four, half of them beside busy processes."""
    busy: int = 4
    """Number of busy processes."""
    real_time: int = 10
    """Seeds of the drives in real time."""
    rooms: int = 20
    """Number of rooms."""
    room_world: str = "dense"
    """Their preset."""
    room_policy: str = "ppo-rooms"
    """Policy in the rooms."""
    room_processes: bool = True
    """Whether each node has a process of its own there."""
    only: tuple[str, ...] = ()
    """Parts to measure; by default all."""


def rooms(config: Config) -> dict[str, Any]:
    """Drive through rooms, and compare outcome and drive with the environment's."""
    rows = []
    for seed in range(config.rooms):
        drive = RoomDrive(config.room_policy, config.room_world, seed=seed)
        expected = room_episode(drive)
        live = room_live(drive, len(expected.clearance) - 1, processes=config.room_processes)
        outcomes = [room_metrics(row) for row in (expected, live)]
        largest, same = max(room_differences(expected, live).values()), outcomes[0] == outcomes[1]
        rows.append({"seed": seed, "largest": largest, "same": same, **outcomes[1]})
    return {
        "same outcome": sum(row["same"] for row in rows),
        "largest difference": max((row["largest"] for row in rows), default=0.0),
        "goals": sum(row["goal reached"] for row in rows),
        "collisions": sum(row["collision"] for row in rows),
        "of": rows,
    }


def equality(config: Config) -> dict[str, Any]:
    """Compare the graph with the environment: policies, noises, and both rules of switching."""
    by_case = {}
    for policy in ("proportional", "bearing", "ppo-square"):
        for noise in ("tutorial", "documented", "rough"):
            for switch in ("time", "arrival"):
                drive = SquareDrive(policy, noise, switch, "burger", 3)
                pair = episode(drive, config.steps), live(drive, config.steps)
                by_case[" ".join(drive[:3])] = differences(*pair)
    return {"largest": max(max(difference.values()) for difference in by_case.values()), "of": by_case}


def repeats(config: Config) -> dict[str, Any]:
    """Drive the tutorial's square repeatedly, and count the distinct drives."""
    drive, by_load = SquareDrive(), {}
    for processes in (False, True):
        for load in (0, config.busy):
            with busy(load):
                digests = [digest(live(drive, config.steps, processes=processes)) for _ in range(config.runs // 2)]
            by_load[f"{'4 processes' if processes else '1 process'}, {load} busy"] = digests
    return {"different": len({digest for digests in by_load.values() for digest in digests}), "digests": by_load}


def speeds(config: Config) -> dict[str, Any]:
    """Measure the speed of a drive as a multiple of real time, and the cost of a step, without the start."""
    rows = {}
    for processes in (False, True):
        rates, before, begin = [], usage(), time.perf_counter()
        for _ in range(3):
            with Graph(processes=processes, switch="time", goal_tolerance=0.0) as graph:
                graph.wait_until(lambda graph: graph.time >= 10.0)
                start, at, own = time.perf_counter(), graph.time, usage()
                graph.wait_until(lambda graph, at=at: graph.time >= at + config.steps * DT, timeout=600.0)
                rates.append((graph.time - at) / (time.perf_counter() - start))
                steps, cpu = (graph.time - at) / DT, usage() - own
        rows["4 processes" if processes else "1 process"] = {
            "times_real_time": rates,
            # The processor time of child processes is known only at their end, and includes start and imports.
            "cpu_ms_per_step": 1e3 * cpu / steps,
            "cpu_s_with_starts_and_processes": usage() - before,
            "wall_s": time.perf_counter() - begin,
        }
    return rows


def usage() -> float:
    """Return the processor time of this process and of finished child processes, s."""
    both = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(used.ru_utime + used.ru_stime for used in both)


def real_time(config: Config) -> dict[str, Any]:
    """Compare the estimate's error in real time, beside busy processes, with the environment's of the same seed and episode."""
    seeds, rows = range(config.real_time), {}
    drives = [SquareDrive("bearing", "tutorial", "time", "burger", seed) for seed in seeds]
    with busy(config.busy):
        for first in range(0, len(drives), AT_ONCE):
            group = dict(zip(DOMAINS, drives[first : first + AT_ONCE], strict=False))
            graphs = [
                Graph(speed=1.0, domain=domain, laps=1, goal_tolerance=0.0, **drive._asdict())
                for domain, drive in group.items()
            ]
            try:
                for graph in graphs:
                    graph.start()
                for graph in graphs:
                    graph.wait_until(lambda graph: graph.time >= config.steps * DT, timeout=1000.0)
                for drive, graph in zip(group.values(), graphs, strict=True):
                    rows[drive.seed] = error(graph.trajectory(), config.steps)
            finally:
                for graph in graphs:
                    graph.close()
    expected = {drive.seed: error(episode(drive, config.steps, number=1), config.steps) for drive in drives}
    ratio = float(np.mean(list(rows.values())) / np.mean(list(expected.values())))
    return {"ratio_of_means": ratio, "live_m": rows, "environment_m": expected}


def error(trajectory: Drive, steps: int) -> float:
    """Return the mean position error of the estimate over a drive, m."""
    return float(np.nanmean(position_error(trajectory.estimate, trajectory.true_state)[: steps + 1]))


def measure(config: Config) -> tuple[dict[str, Any], list[Any]]:
    """Return the results of all parts with the machine's load around each."""
    os.environ["ROS_DOMAIN_ID"] = str(DOMAINS.stop + os.getpid() % 17)
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    parts: dict[str, Callable[[Config], dict[str, Any]]] = {
        "equality": equality, "rooms": rooms, "speed": speeds, "repeats": repeats, "real time": real_time,
    }  # fmt: skip
    results, names = {}, config.only or tuple(parts)
    for name, result in measured({name: partial(parts[name], config) for name in names}):
        results[name] = result
        Console().print(name, {key: value for key, value in result.items() if key not in ("of", "digests")})
    return {"cores": cores(), "parts": results}, []


if __name__ == "__main__":
    run(Config, measure)
