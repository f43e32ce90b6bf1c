"""Compare the live graph in lock-step with the environment, which must make the same drive to the bit.

The README's result is `lockstep.json`; that of the page on rooms, `lockstep_office.json`, comes with ``--only rooms --rooms 100
--room-world office --room-policy planner+safety --no-room-processes``.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Any

from harness.study import Study, each, run
from lockstep_drives import (
    RoomDrive,
    SquareDrive,
    differences,
    episode,
    live,
    room_differences,
    room_episode,
    room_live,
)
from turtlebot_gym_ros.graph.bringup import room_metrics


@dataclass(frozen=True, kw_only=True)
class Config(Study):
    """Compare the live graph with the environment."""

    steps: int = 600
    """Length of a drive on the square."""
    rooms: int = 20
    """Number of rooms."""
    room_world: str = "dense"
    """Their preset."""
    room_policy: str = "ppo-rooms"
    """Policy in the rooms."""
    room_processes: bool = True
    """Whether each node has a process of its own there."""
    only: tuple[str, ...] = ()
    """Parts to measure, of equality and rooms; by default both."""


def rooms(config: Config) -> dict[str, Any]:
    """Drive through rooms, and compare outcome and drive with the environment's."""
    largest, same, ends = 0.0, 0, []
    for seed in each(range(config.rooms), "rooms"):
        drive = RoomDrive(config.room_policy, config.room_world, seed=seed)
        expected = room_episode(drive)
        driven = room_live(drive, len(expected.clearance) - 1, processes=config.room_processes)
        ends.append(room_metrics(driven))
        same += ends[-1] == room_metrics(expected)
        largest = max(largest, *room_differences(expected, driven).values())
    counts = {"goals": sum(end["goal reached"] for end in ends), "collisions": sum(end["collision"] for end in ends)}
    return {"same outcome": same, "largest difference": largest, **counts}


def equality(config: Config) -> dict[str, Any]:
    """Compare the graph with the environment: policies, noises, and both rules of switching."""
    by_case = {}
    for policy in ("proportional", "bearing", "ppo-square"):
        for noise in ("tutorial", "documented", "rough"):
            for switch in ("time", "arrival"):
                drive = SquareDrive(policy, noise, switch, "burger", 3)
                apart = differences(episode(drive, config.steps), live(drive, config.steps))
                by_case[" ".join(drive[:3])] = max(apart.values())
    return {"largest": max(by_case.values()), "of": by_case}


def measure(config: Config) -> tuple[dict[str, Any], list[Any]]:
    """Return the results of all parts, and print them."""
    os.environ["ROS_DOMAIN_ID"] = str(215 + os.getpid() % 17)  # users and the tests use others
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    parts = {"equality": equality, "rooms": rooms}
    results = {name: parts[name](config) for name in config.only or parts}
    print(results)
    return {"parts": results}, []


if __name__ == "__main__":
    run(Config, measure)
