"""Drive rooms by a LiDAR that sees a part of the circle, or measures in another unit, and count true contacts.

Each drive is one of a policy on its own sensors (`turtlebot_gym_agents.Deployment`), with and without its safety layer, in an
unseen room. It ends on contact by the true pose, at the goal, when a scan is refused, or after some time.
"""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
from rich.table import Table

from harness.study import Study, each, run
from turtlebot_gym.models.angles import TWO_PI
from turtlebot_gym.rooms.lidar import Lidar
from turtlebot_gym.rooms.scan import Scan
from turtlebot_gym.rooms.scene import Scene, scene_at
from turtlebot_gym.systems import Snapshot
from turtlebot_gym.values import Command
from turtlebot_gym_agents import Deployment

PERIOD = 0.1
"""Control period, s."""
POLICIES = ("vfh", "gap", "planner", "ppo-rooms")
MARGINS = (0.0, 0.08)
VIEWS = {
    "all around": (0.0, 360.0),
    "blind behind": (-120.0, 240.0),
    "blind left": (150.0, 240.0),
    "blind right": (-30.0, 240.0),
    "ahead 60": (-30.0, 60.0),
    "behind 120": (120.0, 120.0),
}
"""First direction that a LiDAR sees, and the angle from there, degrees."""
UNITS = {"mm": 1000.0, "cm": 100.0, "inch": 1.0 / 0.0254}
"""Numbers per metre in which a LiDAR that sees all around states ranges and limits."""


@dataclass(frozen=True, kw_only=True)
class Config(Study):
    """Drive rooms by a LiDAR that sees a part of the circle, or measures in another unit."""

    drives: int = 200
    """Number of rooms of each combination."""
    seconds: float = 30.0
    """Longest drive, s."""
    policies: tuple[str, ...] = POLICIES
    """The policies."""
    cases: tuple[str, ...] = (*VIEWS, *UNITS)
    """Names of views and units."""
    world: str = "dense"
    """The kind of rooms."""
    lidar: str = "lds01"
    """The LiDAR, before it is made blind."""
    seed: int = 7
    """Seed of the rooms."""
    workers: int = 2
    """Number of processes."""


def main() -> None:
    """Drive, print a table and write the results."""
    run(Config, measure, beside=__file__)


def measure(config: Config) -> tuple[dict[str, Any], list[Table]]:
    """Return the results and their table."""
    cells = [(policy, margin, case) for policy in config.policies for margin in MARGINS for case in config.cases]
    with ProcessPoolExecutor(config.workers) as pool:
        futures = {pool.submit(drive, config, *cell): cell for cell in cells}
        rows = {futures[done]: done.result() for done in each(as_completed(futures), "cells", len(cells))}
    table = Table("policy", "margin, m", "LiDAR", "contacts", "arrived", "refused", "way, m", "least clearance, m")
    for cell in cells:
        row = rows[cell]
        numbers = f"{row['contacts']}", f"{row['arrived']}", f"{row['refused']}", f"{row['way']:.2f}", f"{row['least']:.3f}"
        table.add_row(cell[0], f"{cell[1]:g}", cell[2], *numbers)
    return {"drives": [dict(zip(("policy", "margin", "case"), cell, strict=True)) | rows[cell] for cell in cells]}, [table]


def drive(config: Config, policy: str, margin: float, case: str) -> dict[str, Any]:
    """Drive all rooms of a combination at the same time, and return how many drives ended how."""
    env = gym.make_vec(
        "turtlebot_gym/TurtleBotRooms-v0",
        config.drives,
        vectorization_mode="vector_entry_point",
        world=config.world,
        lidar=config.lidar,
        max_episode_steps=round(config.seconds / PERIOD),
    )
    rooms: Any = env.unwrapped
    rooms.reset(seed=config.seed)
    robots = [Deployment(policy, safety_margin=margin, period=PERIOD) for _ in range(config.drives)]
    worlds, moving, refused = [rooms.snapshot(row) for row in range(config.drives)], set(range(config.drives)), 0
    arrived = np.zeros(config.drives, np.bool_)
    while moving:
        actions = np.zeros((config.drives, 2), np.float32)
        for row in sorted(moving):
            worlds[row] = world = rooms.snapshot(row)
            scan = as_seen(scene_at(rooms.truth()[0], row), rooms.parameters.room.lidar, case)
            try:
                command = act(robots[row], world, scan)
            except ValueError:  # the caller stops the robot
                refused += 1
                moving.remove(row)
                continue
            actions[row] = command.v / robots[row].robot.max_linear, command.omega / robots[row].robot.max_angular
        _, _, terminated, truncated, infos = rooms.step(actions)
        for row in [row for row in moving if terminated[row] or truncated[row]]:
            worlds[row], arrived[row] = rooms.snapshot(row), infos["is_success"][row]
            moving.remove(row)
    ends = [world.room for world in worlds]
    return {
        "contacts": sum(bool(end.collided) for end in ends),
        "arrived": int(arrived.sum()),
        "refused": refused,
        "way": float(np.mean([end.path_length for end in ends])),
        "least": float(min(end.least for end in ends)),
    }


def act(robot: Deployment, world: Snapshot, scan: Scan) -> Command:
    """Return the command of a robot with an estimate from outside."""
    (mean, P), course = world.estimate.belief, world.course
    more = {"following": course.following, "nis": world.estimate.nis, "scan_age": world.room.scan_age}
    return robot.act(mean[:3], (P.xx, P.yy, P.tt), mean[3:], scan, course.reference, **more)


def as_seen(scene: Scene, lidar: Lidar, case: str) -> Scan:
    """Return a room's newest scan of which only a view is sent, or in another unit."""
    beams, unit = int(lidar.beams), UNITS.get(case, 1.0)
    first, width = np.radians(VIEWS.get(case, VIEWS["all around"]))
    directions = lidar.yaw + TWO_PI * np.arange(beams) / beams
    sees = ((directions - first) % TWO_PI <= width) & np.isfinite(scene.lidar.beams[2, :beams])
    ranges = np.where(sees, unit * scene.lidar.ranges[1, :beams], np.nan).astype(np.float32)
    return Scan(ranges, lidar.yaw, TWO_PI / beams, unit * lidar.range_min, unit * lidar.range_max)


if __name__ == "__main__":
    main()
