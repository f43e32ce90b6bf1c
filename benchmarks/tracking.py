"""Measure the tracker on simulated people, and where nobody is: errors, false and missed tracks, and what it costs.

A person has been in sight for a second if each scan of it shows her on most of the beams that could. A track is hers if the
best assignment says so and it is within half a metre; one without a person within a metre is false, and counts once.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray
from rich.table import Table
from scipy.optimize import linear_sum_assignment

from harness.study import Study, each, run
from turtlebot_gym import Episode
from turtlebot_gym.models.angles import TWO_PI
from turtlebot_gym.observations import ROOM, size_of
from turtlebot_gym.rooms.lidar import Lidar, beams_by
from turtlebot_gym.systems import Options
from turtlebot_gym.systems.tracking import UNIFORM, sweep_of
from turtlebot_gym.tracking.tracker import on_scan
from turtlebot_gym.tracking.tracks import FRESH, MOVES, PX, STATE, TIME, VX, predicted
from turtlebot_gym_agents import make_policy

PERIOD = 0.1
"""Control period, s."""
SIGHT = 1.0
"""Time in sight after which errors count, s."""
STEADY = 0.5
"""Acceleration below which a person walks steadily, m/s^2, over the last 0.4 s."""
OWN, NEAR = 0.5, 1.0
"""Greatest distance of a person's track, and least of a false one, m."""
VISIBLE = 4, 0.8
"""Fewest beams that must be able to show a person, and share of them that do."""


@dataclass(frozen=True, kw_only=True)
class Config(Study):
    """Measure the tracker."""

    worlds: tuple[str, ...] = ("people", "office")
    """Rooms, with people or without."""
    lidars: tuple[str, ...] = ("lds01", "lds02", "a1")
    """LiDARs."""
    robots: int = 192
    """Number of robots."""
    seconds: float = 120.0
    """Time that each drives, s."""
    policy: str = "vfh"
    """The policy."""
    seed: int = 50
    """Seed of the rooms."""


def main() -> None:
    """Drive, print a table and write the results."""
    run(Config, measure, beside=__file__)


def measure(config: Config) -> tuple[dict[str, Any], list[Table]]:
    """Return the results and their table."""
    cells = [(world, lidar) for world in config.worlds for lidar in config.lidars]
    rows = [cell_of(config, *cell) for cell in each(cells, "cells")]
    names = (
        "velocity_rms",
        "steady_velocity_rms",
        "velocity_median",
        "position_rms",
        "nees",
        "missed",
        "false_per_hour",
        "cpu_share",
    )
    table = Table("world", "LiDAR", *names)
    for row in rows:
        table.add_row(row["world"], row["lidar"], *(f"{row[name]:.3g}" if name in row else "" for name in names))
    return {"cells": rows}, [table]


def cell_of(config: Config, world: str, lidar: str) -> dict[str, Any]:
    """Return the figures of a room and a LiDAR."""
    options: dict[str, Any] = {"world": world, "lidar": lidar, "noise": "wheel", "observation": "ekf,tracks"}
    env = gym.make_vec("turtlebot_gym/TurtleBotRooms-v0", config.robots, vectorization_mode="vector_entry_point", **options)
    rooms: Any = env.unwrapped
    policy = make_policy(config.policy, robot="burger", dt=PERIOD)
    observations, _ = env.reset(seed=config.seed)
    watches = [Watch(rooms.parameters.room.lidar) for _ in range(config.robots)]
    for _ in range(round(config.seconds / PERIOD)):
        observations, *_ = env.step(np.asarray(policy(observations[:, : size_of(ROOM)]), np.float32))
        scenes = rooms.truth()[0]
        for row, watch in enumerate(watches):
            watch.look(rooms.snapshot(row), scenes, row)
    errors = np.array([error for watch in watches for error in watch.errors])
    hours = config.robots * config.seconds / 3600.0
    result = {
        "world": world,
        "lidar": lidar,
        "hours": hours,
        "false_per_hour": sum(watch.false for watch in watches) / hours,
        "cpu_share": cpu_share(options),
    }
    if errors.size:
        position, velocity, nees, steady = errors.T
        result |= {
            "looks": len(errors),
            "velocity_rms": float(np.sqrt(np.mean(velocity**2))),
            "velocity_median": float(np.median(velocity)),
            "steady_velocity_rms": float(np.sqrt(np.mean(velocity[steady > 0.0] ** 2))),
            "steady": float(steady.mean()),
            "position_rms": float(np.sqrt(np.mean(position**2))),
            "nees": float(nees.mean()),
            "missed": sum(watch.missed for watch in watches) / (sum(watch.missed for watch in watches) + len(errors)),
        }
    return result


def cpu_share(options: dict[str, Any], scans: int = 60) -> float:
    """Return the share of a core that the tracker takes in plain Python at the LiDAR's rate."""
    setup = Options.of(options).setup()
    episode = Episode(setup.parameters, setup.waypoints, seed=1, system=setup.system)
    lidar, spent, number = setup.parameters.room.lidar, 0.0, 0
    while number < scans:
        episode.act((0.5, 0.2))
        if is_complete(int(episode.world.steps), lidar):
            ranges, last = episode.scene.lidar.ranges[1].copy(), episode.world.steps * PERIOD
            start = time.process_time()
            on_scan(episode.scene.tracker, ranges, sweep_of(lidar, last, PERIOD))
            spent, number = spent + time.process_time() - start, number + 1
    return spent / scans * lidar.rate


def is_complete(at: int, lidar: Lidar) -> bool:
    """Return whether a scan is complete with a step."""
    return beams_by(at, lidar, PERIOD) // int(lidar.beams) > beams_by(at - 1, lidar, PERIOD) // int(lidar.beams)


class Watch:
    """What the tracker of one robot says beside the truth."""

    def __init__(self, lidar: Lidar) -> None:
        self.lidar, self.errors, self.missed, self.false = lidar, list[tuple[float, ...]](), 0, 0
        self._past, self._sight, self._accused = list[NDArray[np.float64]](), np.zeros(0), set[int]()
        self._at = np.iinfo(np.int64).max

    def look(self, world: Any, scenes: Any, row: int) -> None:
        """Compare after a step."""
        count, at = int(scenes.room.counts[row, 0]), int(world.steps)
        people = scenes.room.circles[row, :count, :3].copy() if scenes.room.people.shape[1] else np.zeros((0, 3))
        begins, self._at = at <= self._at, at
        if begins:
            self._past, self._sight, self._accused = [], np.zeros(len(people)), set()
        self._past = [*self._past[-5:], people]
        if at < 6 or not is_complete(at, self.lidar):
            return
        pose, odometry, now = world.body.true_state, world.senses.odometry, at * PERIOD
        tracks = scenes.tracker.tracks[row]
        known = np.flatnonzero((tracks[:, STATE] == MOVES) & (now - tracks[:, TIME] <= FRESH))
        states = np.array([_in_world(tracks[k], now, pose, odometry.pose) for k in known]).reshape(-1, 4)
        apart = np.hypot(*(states[:, None, :2] - people[None, :, :2]).transpose(2, 0, 1))
        pairs = zip(*linear_sum_assignment(np.minimum(apart, OWN)), strict=True)
        owner = {int(person): int(track) for track, person in pairs if apart[track, person] < OWN}
        strangers = {int(known[k]) for k in range(len(known)) if not apart[k].size or apart[k].min() > NEAR}
        self.false += len(strangers - self._accused)
        self._accused = strangers
        velocity, before = ((self._past[k] - self._past[k - 1])[:, :2] / PERIOD for k in (-1, -5))
        seen = self._visible(people, pose, scenes.lidar.ranges[row, 1])
        self._sight = np.where(seen, self._sight + 1.0 / self.lidar.rate, 0.0)
        for person in np.flatnonzero(self._sight > SIGHT).tolist():
            if person not in owner:
                self.missed += 1
                continue
            track = tracks[known[owner[person]]]
            error = states[owner[person]] - np.concatenate((people[person, :2], velocity[person]))
            covariance = _covariance(track, now, states[owner[person]], pose, UNIFORM * self.lidar.accuracy)
            steady = np.hypot(*(velocity[person] - before[person])) < STEADY * 4.0 * PERIOD
            nees = float(error @ np.linalg.solve(covariance, error))
            self.errors.append((np.hypot(*error[:2]), np.hypot(*error[2:]), nees, float(steady)))

    def _visible(self, people: NDArray[np.float64], pose: Any, ranges: NDArray[np.float32]) -> NDArray[np.bool_]:
        """Return whether the newest scan shows each person on most of the beams that could."""
        lidar, step, shown = self.lidar, TWO_PI / self.lidar.beams, np.zeros(len(people), np.bool_)
        x, y = pose.x + lidar.x * np.cos(pose.theta), pose.y + lidar.x * np.sin(pose.theta)
        for k, (cx, cy, radius) in enumerate(people):
            far = np.hypot(cx - x, cy - y)
            middle = (np.arctan2(cy - y, cx - x) - pose.theta - lidar.yaw) / step
            half = 0.9 * np.arcsin(min(radius / max(far, radius), 1.0)) / step
            beams = np.arange(np.ceil(middle - half), np.floor(middle + half) + 1).astype(int) % int(lidar.beams)
            hits = abs(ranges[beams] - far + 0.7 * radius) < 0.35 + lidar.accuracy * far
            shown[k] = far < lidar.range_max and len(beams) >= VISIBLE[0] and hits.mean() > VISIBLE[1]
        return shown


def _in_world(track: NDArray[np.float64], now: float, pose: Any, odometry: Any) -> tuple[float, ...]:
    """Return position and velocity of a track in the world now, from its place relative to the odometry's pose."""
    turn = np.exp(1j * (pose.theta - odometry.theta))
    velocity = complex(*track[VX : VX + 2])
    at = complex(pose.x, pose.y) + turn * (
        complex(*track[PX : PX + 2]) + velocity * (now - track[TIME]) - complex(*odometry[:2])
    )
    velocity *= turn
    return at.real, at.imag, velocity.real, velocity.imag


def _covariance(
    track: NDArray[np.float64], now: float, state: NDArray[np.float64], pose: Any, scale: float
) -> NDArray[np.float64]:
    """Return the covariance of a track's position and velocity, with the error that all ranges share."""
    P = predicted(track, now - track[TIME])
    lever = state - np.array([pose.x, pose.y, pose.v * np.cos(pose.theta), pose.v * np.sin(pose.theta)])
    return np.kron(np.array([[P.pp, P.pv], [P.pv, P.vv]]), np.eye(2)) + scale * scale * np.outer(lever, lever)


if __name__ == "__main__":
    main()
