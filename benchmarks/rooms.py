"""Measure the speed of rooms: rays, steps, maps and the making of worlds, each with its target, as ratios within one run.

Contenders take turns and the median of each counts, in CPU seconds, so that other programs disturb the ratios little; wall
time is reported too. IR-SIM, the peer, is installed into its own virtual environment, and drives in the same room with the same
beams and the same command: the robot turns on the spot.

`make bench-rooms` runs it, with nothing else on the cores.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from numba import njit
from numpy.typing import NDArray
from rich.table import Table

from harness.machine import cores
from harness.study import Study, run
from harness.tables import Figure, figures_table
from harness.turns import Contender, Turn, take_turns, timed
from irsim_peer import start_peer
from turtlebot_gym.compiled.packing import as_tuple
from turtlebot_gym.models.angles import TWO_PI, sincos
from turtlebot_gym.rooms.cells import ray_to_cells
from turtlebot_gym.rooms.drawing import capacity, draw
from turtlebot_gym.rooms.grid import OCCUPIED, GridMap
from turtlebot_gym.rooms.rays import FAR, inverse
from turtlebot_gym.rooms.rules import ROOMS, RoomRules
from turtlebot_gym.rooms.scene import Scene, arrays_of, make_scenes, scene_at
from turtlebot_gym.rooms.sensing import BLOCK, ROOM, cast

ID = "turtlebot_gym/TurtleBotRooms-v0"
TURN = 0.3
"""Command of all robots: a turning rate, as a share of the limit for this package and in rad/s for the peer."""


@dataclass(frozen=True, kw_only=True)
class Config(Study):
    """Measure rooms."""

    rounds: int = 7
    """Number of turns of each contender."""
    seconds: float = 0.5
    """Length of a turn, s."""
    num_envs: int = 4096
    """Number of environments stepped together."""
    peer: Path | None = Path("out/irsim")
    """The peer's virtual environment, created if missing; None leaves the peer out."""


class Rate(NamedTuple):
    """Calls per second of a contender, medians over its turns."""

    cpu: float
    """Rate by CPU seconds."""
    wall: float
    """Rate by wall time."""


def rates_of(contenders: dict[str, Callable[[int], Turn]], config: Config) -> dict[str, Rate]:
    """Return the rates of contenders that take turns.

    Args:
        contenders: Functions that make a number of calls.
        config: Number and length of turns.
    """
    entries = {name: Contender(run=run, size=1, base=name, by="") for name, run in contenders.items()}
    rows = take_turns(entries, rounds=config.rounds, seconds=config.seconds).environments
    return {name: Rate(row.steps_per_cpu_second, row.steps_per_second) for name, row in rows.items()}


def _scan(scenes: Scene, poses: NDArray[np.float64], beams: NDArray[np.float64], ranges: NDArray[np.float64]) -> None:
    """Cast the beams of all robots."""
    rays = np.empty(ROOM)
    for robot in range(len(poses)):
        scene = scene_at(scenes, robot)
        x, y = poses[robot, 0], poses[robot, 1]
        sine, cosine = sincos(poses[robot, 2])
        for first in range(0, beams.shape[1], BLOCK):
            n = min(BLOCK, beams.shape[1] - first)
            for ray in range(n):
                rays[ray], rays[BLOCK + ray] = x, y
                rays[2 * BLOCK + ray] = cosine * beams[0, first + ray] - sine * beams[1, first + ray]
                rays[3 * BLOCK + ray] = sine * beams[0, first + ray] + cosine * beams[1, first + ray]
            cast(scene, rays, n, 99.0, TWO_PI / beams.shape[1], 0.0)
            for ray in range(n):
                ranges[robot, first + ray] = rays[4 * BLOCK + ray]


def _directions(beams: int) -> NDArray[np.float64]:
    angles = 2.0 * np.pi * np.arange(beams) / beams
    return np.stack([np.cos(angles), np.sin(angles)])


def rays(config: Config) -> dict[str, Any]:
    """Return rays per second on one thread, in rooms with 16 circles, 32 robots at a time."""
    rules = RoomRules(circles=(16.0, 16.0), boxes=(0.0, 0.0))
    scenes = make_scenes(32, circles=16, boxes=0, length=5.0, width=5.0, beams=1)
    for robot in range(32):
        draw(scene_at(scenes, robot), as_tuple(rules), 0.105, robot)
    poses = np.random.default_rng(0).uniform([-2.4, -2.4, -np.pi], [2.4, 2.4, np.pi], (32, 3))
    scan = njit(_scan, error_model="numpy")
    contenders = {}
    for beams in (36, 360):
        arguments = scenes, poses, _directions(beams), np.empty((32, beams))
        contenders[f"{beams} beams"] = timed(lambda k, arguments=arguments: scan(*arguments))
    rates = rates_of(contenders, config)
    return {name: Rate(*(32.0 * int(name.split()[0]) * number for number in rate)) for name, rate in rates.items()}


def _grid_walk(squares: NDArray[np.int8], column: float, row: float, dx: float, dy: float, reach: float) -> float:
    """Return the result of `ray_to_cells` by a plain walk from cell to cell."""
    inverse_dx, inverse_dy = inverse(dx), inverse(dy)
    step_x, step_y = 1 if inverse_dx > 0.0 else -1, 1 if inverse_dy > 0.0 else -1
    i, j = int(row), int(column)
    to_x = (j + (1 if step_x > 0 else 0) - column) * inverse_dx
    to_y = (i + (1 if step_y > 0 else 0) - row) * inverse_dy
    length = 0.0
    while squares[0, i, j] != 0 and length < reach:
        if to_x < to_y:
            length = to_x
            to_x += abs(inverse_dx)
            j += step_x
        else:
            length = to_y
            to_y += abs(inverse_dy)
            i += step_y
    return length if squares[0, i, j] == 0 else FAR


def _walker(walk: Callable[..., float]) -> Callable[..., None]:
    """Return a compiled function that casts the beams of robots on a map, in units of cells."""

    def scan(squares: Any, poses: Any, beams: Any, ranges: Any) -> None:
        for robot in range(len(poses)):
            sine, cosine = sincos(poses[robot, 2])
            for ray in range(beams.shape[1]):
                dx = cosine * beams[0, ray] - sine * beams[1, ray]
                dy = sine * beams[0, ray] + cosine * beams[1, ray]
                ranges[robot, ray] = walk(squares, poses[robot, 0], poses[robot, 1], dx, dy, 1e9)

    return njit(scan, error_model="numpy")


def hall(seed: int = 0) -> GridMap:
    """Return a map of 20 m by 20 m at 5 cm: walls around, shelves and pillars."""
    random, cells = np.random.default_rng(seed), np.zeros((400, 400), np.int8)
    for _ in range(120):
        i, j, height, width = *random.integers(0, 390, 2), *random.integers(2, 25, 2)
        cells[i : i + height, j : j + width] = OCCUPIED
    cells[[0, -1], :] = cells[:, [0, -1]] = OCCUPIED
    return GridMap(cells=cells, resolution=0.05)


def maps(config: Config) -> dict[str, Any]:
    """Return rays per second on a map with 360 beams, by strides and by a plain walk, and the difference of their ranges."""
    grid = hall()
    rows, columns = np.nonzero(grid.squares[0])
    random = np.random.default_rng(1)
    at = random.integers(len(rows), size=32)
    poses = np.stack([columns[at] + random.random(32), rows[at] + random.random(32), random.uniform(-np.pi, np.pi, 32)], 1)
    directions, ranges = _directions(360), {name: np.empty((32, 360)) for name in ("strides", "grid walk")}
    scans = {"strides": _walker(ray_to_cells), "grid walk": _walker(njit(_grid_walk, error_model="numpy"))}
    contenders = {
        name: timed(lambda k, scan=scan, name=name: scan(grid.squares, poses, directions, ranges[name]))
        for name, scan in scans.items()
    }
    rates = rates_of(contenders, config)
    apart = float(np.abs(ranges["strides"] - ranges["grid walk"]).max()) * grid.resolution
    return {name: Rate(*(32.0 * 360.0 * number for number in rate)) for name, rate in rates.items()} | {"apart_m": apart}


def steps(config: Config) -> dict[str, Any]:
    """Return steps per second in `dense` with 36 beams, of this package and the peer, and the time to make a world."""
    n = config.num_envs
    envs = gym.make_vec(ID, num_envs=n, world="dense", lidar="ideal", max_episode_steps=10**9)
    _, info = envs.reset(seed=0)
    batch: Any = envs.unwrapped._batch  # pyright: ignore[reportAttributeAccessIssue]
    actions = np.tile(np.array([0.0, TURN], np.float32), (n, 1))
    contenders = {"steps": timed(lambda k: envs.step(actions)), "worlds": timed(lambda k: envs.reset())}
    peer = start_peer(config.peer, scene_at(batch.scenes, 0), TURN) if config.peer else None
    if peer:
        contenders["peer"] = peer.turn
    try:
        rates = rates_of(contenders, config)
    finally:
        if peer:
            peer.stop()
    p = batch.parameters
    least = float(np.mean(info["way_left"])) / (min(p.robot.max_linear, p.robot.max_wheel) * p.dt)
    results = {name: Rate(*((n if name != "peer" else 1) * number for number in rate)) for name, rate in rates.items()}
    return {**results, "steps_of_an_episode": least}


def memory(number: int = 4096) -> dict[str, float]:
    """Return the memory of the rooms of a number of environments, MB, by world."""
    taken = {}
    for name, rules in ROOMS.items():
        circles, boxes = capacity(rules)
        size = {"length": 2.0 * rules.half_length, "width": 2.0 * rules.half_width}
        scene = make_scenes(1, circles=circles, boxes=boxes, beams=36, **size)
        taken[name] = number * sum(part.nbytes for part in arrays_of(scene)) / 1e6
    grid = hall()
    shared = sum(part.nbytes for part in (grid.squares, grid.known, grid.frame))
    scene = make_scenes(1, circles=0, boxes=0, beams=36, length=20.0, width=20.0)
    return taken | {"map of 20 m at 5 cm": (shared + number * sum(part.nbytes for part in arrays_of(scene))) / 1e6}


def measure(config: Config) -> tuple[dict[str, Any], list[Table]]:
    """Return all rates and sizes, and a table of those that have targets."""
    load = os.getloadavg()[0]
    casting, walking, stepping, taken = rays(config), maps(config), steps(config), memory()
    figures = [
        Figure("rays with 36 beams and 16 circles, one thread", casting["36 beams"].cpu / 1e6, "M/s", 40.0),
        Figure("rays with 360 beams and 16 circles, one thread", casting["360 beams"].cpu / 1e6, "M/s"),
        Figure("rays on a map with 360 beams, one thread", walking["strides"].cpu / 1e6, "M/s"),
        Figure("these rays, times those of a plain grid walk", walking["strides"].cpu / walking["grid walk"].cpu, "", 1.5),
        Figure("steps in dense with 36 beams, wall time", stepping["steps"].wall / 1e6, "M/s", 1.0),
        Figure("the same, CPU seconds of one core", stepping["steps"].cpu / 1e6, "M/s"),
    ]
    if "peer" in stepping:
        figures.append(
            Figure("these steps, times IR-SIM's, wall time", stepping["steps"].wall / stepping["peer"].wall, "", 1000.0)
        )
        figures.append(Figure("the same, CPU seconds of one core", stepping["steps"].cpu / stepping["peer"].cpu, ""))
    episodes = stepping["worlds"].cpu * stepping["steps_of_an_episode"] / stepping["steps"].cpu
    figures.append(Figure("episodes' steps, times the making of their worlds", episodes, "", 5.0))
    figures += [Figure(f"memory of 4096 worlds, {name}", size, "MB") for name, size in taken.items()]
    print(f"Ranges by strides and by a grid walk differ by at most {walking['apart_m']:.1e} m.")
    results = {"load": [load, os.getloadavg()[0]], "rays": casting, "maps": walking, "steps": stepping, "memory_mb": taken}
    return results, [figures_table(figures, "at least", title=f"{cores()} cores, load {load:.1f}")]


if __name__ == "__main__":
    run(Config, measure)
