"""The same drive in the environment and in the live graph in lock-step, and how far the two are apart."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np

import turtlebot_gym  # noqa: F401  # registers the environments
from turtlebot_gym.drive import Drive
from turtlebot_gym_agents.policies import PolicyWithMemory, make_policy
from turtlebot_gym_ros import Graph

DT = 0.1
"""Control interval, s."""
COLUMNS = ("time", "true_state", "odometry", "estimate", "covariance", "reference", "command")
"""What both know of a drive."""


class RoomDrive(NamedTuple):
    policy: str = "vfh"
    world: str = "dense"
    lidar: str = "lds01"
    noise: str = "tutorial"
    seed: int = 0
    localizer: str | None = None
    goals: int | None = None
    start: str | None = None
    observation: str = "ekf"


class SquareDrive(NamedTuple):
    policy: str = "proportional"
    noise: str = "tutorial"
    switch: str = "time"
    robot: str = "tutorial"
    seed: int = 0
    filter: str = "matched"
    fix: str = "none"

    @property
    def laps(self) -> int:
        """Number of laps, enough that the last waypoint is not reached in a minute."""
        return 1 if self.switch == "time" else 50


def episode(drive: SquareDrive, steps: int, *, number: int = 0) -> Drive:
    """Return the environment's drive, with arrival by belief as in the generator; ``number`` counts the seed's episodes."""
    options = drive._asdict() | {"laps": drive.laps, "fix": None if drive.fix == "none" else drive.fix}
    policy, seed = make_policy(options.pop("policy"), robot=drive.robot, noise=drive.noise), options.pop("seed")
    env = gym.make("turtlebot_gym/TurtleBotSquare-v0", max_episode_steps=10**9, arrival="belief", **options)
    return Drive.stack([*_driven(env, policy, seed, steps, number)], time=DT * np.arange(steps + 1))


def live(drive: SquareDrive, steps: int, **options: Any) -> Drive:
    """Return the graph's drive over a number of steps; the options are those of `Graph`."""
    return _live(drive._asdict() | {"laps": drive.laps}, steps, **options)


def room_episode(given: RoomDrive, steps: int = 600) -> Drive:
    """Return the environment's episode, from its start to its end, after a number of steps at the latest."""
    options = given._asdict()
    policy, seed = make_policy(options.pop("policy"), noise=given.noise), options.pop("seed")
    if isinstance(policy, PolicyWithMemory):
        policy.reset(np.ones((), np.bool_))
    name = "Rooms" if given.goals is None else "Missions"
    env = gym.make(f"turtlebot_gym/TurtleBot{name}-v0", max_episode_steps=steps, **options)
    infos = [*_driven(env, policy, seed, steps)]
    drive = Drive.stack(infos, time=DT * np.arange(len(infos)))
    return replace(drive, clearance=drive.clearance.astype(np.float32))  # as its message carries it


def room_live(drive: RoomDrive, steps: int, **options: Any) -> Drive:
    """Return the graph's drive over a number of steps; the options are those of `Graph`."""
    given = {name: value for name, value in drive._asdict().items() if value is not None and name != "observation"}
    if drive.start == "known":
        given["start"] = "odometry"
    return _live(given, steps, **options)


def _driven(env: gym.Env[Any, Any], policy: Any, seed: int, steps: int, number: int = 0) -> Iterator[dict[str, Any]]:
    observation, info = env.reset(seed=seed)
    for _ in range(number):
        observation, info = env.reset()
    yield info
    for _ in range(steps):
        observation, _, terminated, truncated, info = env.step(policy(observation))
        yield info
        if terminated or truncated:
            break
    env.close()


def _live(given: dict[str, Any], steps: int, **options: Any) -> Drive:
    with Graph(**given, goal_tolerance=0.0, **options) as graph:
        graph.wait_until(lambda graph: graph.time >= (steps - 0.5) * DT, timeout=max(120.0, 10.0 * steps * DT))
        return first(graph.trajectory(), steps)


def first(trajectory: Drive, steps: int) -> Drive:
    """Return the start and the first steps of a drive."""
    return trajectory[: steps + 1]


def differences(one: Drive, other: Drive) -> dict[str, float]:
    """Return the largest difference in each part of two drives; NaN where one does not know what the other does."""
    return {name: float(np.abs(getattr(one, name) - getattr(other, name)).max()) for name in COLUMNS}


def room_differences(one: Drive, other: Drive) -> dict[str, float]:
    return differences(one, other) | {"clearance": float(np.abs(one.clearance - other.clearance).max())}
