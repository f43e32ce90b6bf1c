"""Whether the live graph is the environment: equal to the number in lock-step, close in real time, and how fast.

In lock-step each run of the graph, in one process or in four, alone or beside busy processes, must give the same bytes; their
difference from the environment's episode of the same seed must be nothing. In real time, under the same load, the estimate's
error must be the environment's. Run ``make bench-lockstep``.
"""

from __future__ import annotations

import hashlib
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import gymnasium as gym
import numpy as np
import tyro
from numpy.typing import NDArray
from rich.console import Console

import turtlebot_gym  # noqa: F401  # registers the environments
from turtlebot_gym.plants import make_plant
from turtlebot_gym.trajectory import Trajectory, position_error
from turtlebot_gym_agents.policies import PolicyWithMemory, make_policy
from turtlebot_gym_agents.provenance import write_json
from turtlebot_gym_ros import Graph
from turtlebot_gym_ros.graph.bringup import room_metrics

DT = 0.1
"""Control interval, s."""
TRAVELS = np.zeros((5, 5), np.bool_)
"""Which entries of a covariance have a place in an `Odometry` message: those of the pose and those of the twist."""
TRAVELS[:3, :3] = TRAVELS[3:, 3:] = True
DOMAINS = range(180, 215)
"""ROS domains of graphs that run at the same time; people and the tests use others."""

AT_ONCE = 2
"""Graphs in real time at the same time."""


ROOM_STEPS = 600
"""Length of an episode in a room."""


class RoomDrive(NamedTuple):
    """An episode in a room, the same in the environment and in the graph."""

    policy: str = "vfh"
    world: str = "dense"
    lidar: str = "lds01"
    noise: str = "tutorial"
    seed: int = 0


class Told(NamedTuple):
    """What was said of an episode in a room."""

    trajectory: Trajectory
    clearance: NDArray[np.float32]
    """Shape (T,), m; in single precision, as it travels."""


class Drive(NamedTuple):
    """A drive of the square, the same in the environment and in the graph."""

    policy: str = "proportional"
    noise: str = "tutorial"
    switch: str = "time"
    robot: str = "tutorial"
    seed: int = 0
    filter: str = "matched"
    fix: str = "none"
    plant: str = "unicycle"
    friction: float = 1.0

    @property
    def laps(self) -> int:
        """So many that the last waypoint is not reached in a minute."""
        return 1 if self.switch == "time" else 50


@dataclass(frozen=True, kw_only=True)
class Config:
    """Compare the live graph with the environment."""

    steps: int = 600
    """Length of a drive."""
    runs: int = 20
    """Runs of the same drive in one process, and as many in four, half of them beside busy processes."""
    busy: int = 4
    """How many processes do nothing but keep the machine busy."""
    real_time: int = 10
    """Seeds of the drives in real time."""
    rooms: int = 20
    """Rooms, of the preset "dense", with a process for each node."""
    room_policy: str = "ppo-rooms"
    """Who drives there."""
    json: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Write the results here too."""


def episode(drive: Drive, steps: int, *, number: int = 0) -> Trajectory:
    """Return the environment's drive: arrival by belief, as the generator judges it; ``number`` counts the seed's episodes."""
    env = gym.make(
        "turtlebot_gym/TurtleBotSquare-v0",
        max_episode_steps=10**9,
        arrival="belief",
        noise=drive.noise,
        filter=drive.filter,
        fix=None if drive.fix == "none" else drive.fix,
        plant=make_plant(drive.plant, friction=drive.friction) if drive.plant != "unicycle" else drive.plant,
        robot=drive.robot,
        switch=drive.switch,
        laps=drive.laps,
    )
    policy = make_policy(drive.policy, robot=drive.robot)
    observation, info = env.reset(seed=drive.seed)
    for _ in range(number):
        observation, info = env.reset()
    infos = [info]
    for _ in range(steps):
        observation, _, terminated, _, info = env.step(policy(observation))
        assert not terminated
        infos.append(info)
    env.close()
    return Trajectory.from_infos(infos, dt=DT)


def live(drive: Drive, steps: int, **options: Any) -> Trajectory:
    """Return the graph's drive, of as many steps; the options are those of `Graph`."""
    with Graph(**drive._asdict(), laps=drive.laps, goal_tolerance=0.0, **options) as graph:
        graph.wait_until(lambda graph: graph.time >= (steps - 0.5) * DT, timeout=max(120.0, 4.0 * steps * DT))
        return first(graph.trajectory(), steps)


def room_episode(drive: RoomDrive) -> Told:
    """Return the environment's episode, from its start to its end."""
    options = drive._asdict()
    policy, seed = make_policy(options.pop("policy")), options.pop("seed")
    if isinstance(policy, PolicyWithMemory):
        policy.reset(np.ones((), np.bool_))
    env = gym.make("turtlebot_gym/TurtleBotRooms-v0", max_episode_steps=ROOM_STEPS, **options)
    observation, info = env.reset(seed=seed)
    infos, ended = [info], False
    while not ended:
        observation, _, terminated, truncated, info = env.step(policy(observation))
        infos.append(info)
        ended = terminated or truncated
    env.close()
    return Told(Trajectory.from_infos(infos, dt=DT), np.array([each["clearance"] for each in infos], np.float32))


def room_live(drive: RoomDrive, steps: int, **options: Any) -> Told:
    """Return the graph's drive, of as many steps; the options are those of `Graph`."""
    with Graph(**drive._asdict(), goal_tolerance=0.0, **options) as graph:
        graph.wait_until(lambda graph: graph.time >= (steps - 0.5) * DT, timeout=max(120.0, 10.0 * steps * DT))
        return Told(first(graph.trajectory(), steps), graph.clearance()[: steps + 1].astype(np.float32))


def room_differences(one: Told, other: Told) -> dict[str, float]:
    """Return the largest difference in each part of two episodes in a room."""
    clearance = float(np.abs(one.clearance - other.clearance).max())
    return differences(one.trajectory, other.trajectory) | {"clearance": clearance}


def rooms(config: Config) -> dict[str, Any]:
    """Drive through rooms in a process for each node, and compare outcome and drive with the environment's."""
    found = []
    for seed in range(config.rooms):
        drive = RoomDrive(config.room_policy, seed=seed)
        expected = room_episode(drive)
        told = room_live(drive, len(expected.clearance) - 1, processes=True)
        outcomes = [room_metrics(*each) for each in (expected, told)]
        largest, same = max(room_differences(expected, told).values()), outcomes[0] == outcomes[1]
        found.append({"seed": seed, "largest": largest, "same": same, **outcomes[1]})
    return {
        "same outcome": sum(each["same"] for each in found),
        "largest difference": max((each["largest"] for each in found), default=0.0),
        "goals": sum(each["goal reached"] for each in found),
        "collisions": sum(each["collision"] for each in found),
        "of": found,
    }


def first(trajectory: Trajectory, steps: int) -> Trajectory:
    """Return the start of a drive, and so many steps."""
    return Trajectory(*(rows[: steps + 1] for rows in trajectory))


def differences(one: Trajectory, other: Trajectory) -> dict[str, float]:
    """Return the largest difference in each part of two drives; NaN where one does not know what the other does."""
    found = {name: np.abs(here - there) for name, here, there in zip(one._fields, one, other, strict=True)}
    return {name: float((rows[:, TRAVELS] if name == "covariance" else rows).max()) for name, rows in found.items()}


def digest(trajectory: Trajectory) -> str:
    """Return a fingerprint of all bytes of a drive."""
    return hashlib.sha256(b"".join(np.ascontiguousarray(rows).tobytes() for rows in trajectory)).hexdigest()[:16]


@contextmanager
def busy(number: int) -> Iterator[None]:
    """Keep the machine busy with so many processes."""
    processes = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(number)]
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.wait()


def equality(config: Config) -> dict[str, Any]:
    """Compare the graph with the environment: policies, noises, and both rules of switching."""
    found = {}
    for policy in ("proportional", "bearing", "ppo-square"):
        for noise in ("tutorial", "documented", "rough"):
            for switch in ("time", "arrival"):
                drive = Drive(policy, noise, switch, "burger", 3)
                pair = episode(drive, config.steps), live(drive, config.steps)
                found[" ".join(drive[:3])] = differences(*pair)
    return {"largest": max(max(each.values()) for each in found.values()), "of": found}


def repeats(config: Config) -> dict[str, Any]:
    """Drive the tutorial's square again and again, and count how many different drives that gives."""
    drive, found = Drive(), {}
    for processes in (False, True):
        for load in (0, config.busy):
            with busy(load):
                digests = [digest(live(drive, config.steps, processes=processes)) for _ in range(config.runs // 2)]
            found[f"{'4 processes' if processes else '1 process'}, {load} busy"] = digests
    return {"different": len({each for digests in found.values() for each in digests}), "digests": found}


def speeds(config: Config) -> dict[str, Any]:
    """Measure how many times faster than real time a drive runs, and what a step costs, without the start."""
    found = {}
    for processes in (False, True):
        rates, before, begin = [], usage(), time.perf_counter()
        for _ in range(3):
            with Graph(processes=processes, switch="time", goal_tolerance=0.0) as graph:
                graph.wait_until(lambda graph: graph.time >= 10.0)
                start, at, own = time.perf_counter(), graph.time, usage()
                graph.wait_until(lambda graph, at=at: graph.time >= at + config.steps * DT, timeout=600.0)
                rates.append((graph.time - at) / (time.perf_counter() - start))
                steps, cpu = (graph.time - at) / DT, usage() - own
        found["4 processes" if processes else "1 process"] = {
            "times_real_time": rates,
            # Of child processes the processor time is known at their end: start and import are in it.
            "cpu_ms_per_step": 1e3 * cpu / steps,
            "cpu_s_with_starts_and_processes": usage() - before,
            "wall_s": time.perf_counter() - begin,
        }
    return found


def usage() -> float:
    """Return the processor time of this process and of the child processes that have ended, s."""
    each = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in each)


def real_time(config: Config) -> dict[str, Any]:
    """Compare the estimate's error in real time, beside busy processes, with the environment's of the same seed and episode."""
    seeds, found = range(config.real_time), {}
    drives = [Drive("bearing", "tutorial", "time", "burger", seed) for seed in seeds]
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
                    found[drive.seed] = error(graph.trajectory(), config.steps)
            finally:
                for graph in graphs:
                    graph.close()
    expected = {drive.seed: error(episode(drive, config.steps, number=1), config.steps) for drive in drives}
    ratio = float(np.mean(list(found.values())) / np.mean(list(expected.values())))
    return {"ratio_of_means": ratio, "live_m": found, "environment_m": expected}


def error(trajectory: Trajectory, steps: int) -> float:
    """Return the mean position error of the estimate over a drive, m."""
    return float(np.nanmean(position_error(trajectory.estimate, trajectory.true_state)[: steps + 1]))


def measure(config: Config) -> dict[str, Any]:
    """Return the results of all parts, each with the load of the machine before and after it (1 min average)."""
    parts: dict[str, Callable[[Config], dict[str, Any]]] = {
        "equality": equality, "rooms": rooms, "speed": speeds, "repeats": repeats, "real time": real_time,
    }  # fmt: skip
    results: dict[str, Any] = {}
    for name, part in parts.items():
        before = os.getloadavg()[0]
        results[name] = part(config) | {"load": [before, os.getloadavg()[0]]}
        Console().print(name, {key: value for key, value in results[name].items() if key not in ("of", "digests")})
    return {"cores": len(os.sched_getaffinity(0)), "parts": results}


def main() -> None:
    """Measure, print, and write JSON."""
    config = tyro.cli(Config, description=__doc__)
    os.environ["ROS_DOMAIN_ID"] = str(DOMAINS.stop + os.getpid() % 17)
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    result = measure(config)
    if config.json is not None:
        write_json(config.json, result, config=asdict(config))


if __name__ == "__main__":
    main()
