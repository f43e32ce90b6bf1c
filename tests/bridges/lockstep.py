"""The same drive in the environment and in the live graph in lock-step, and that they are the same.

A drive is given by the options that both take: policy, noise, seed, and those of the square or of a world.
"""

from dataclasses import replace

import gymnasium as gym
import numpy as np

import turtlebot_gym  # noqa: F401  # registers the environments
from turtlebot_gym.drive import Drive
from turtlebot_gym.observations import LOCATED_ROOM, ROOM, TRACKS
from turtlebot_gym_agents.policies import PolicyWithMemory, make_policy
from turtlebot_gym_ros import Graph

DT = 0.1
"""Control interval, s."""
COLUMNS = ("time", "true_state", "odometry", "estimate", "covariance", "reference", "command", "clearance")
"""What both know of a drive; in a world also the clearance."""


def square(**options):
    """Return a drive along the square, with enough laps that the last waypoint is not reached in a minute."""
    given = {"policy": "bearing", "noise": "tutorial", "switch": "time", "robot": "burger", "seed": 3, **options}
    return {"laps": 1 if given["switch"] == "time" else 50, **given}


class Logged:
    """VFH+, with memory, which keeps what it is given and what it answers in ``seen``; it runs in this process."""

    terms, name, seen = ROOM, "vfh", []

    def __init__(self, *, robot, dt):
        self._policy = make_policy(self.name, robot=robot, dt=dt)

    def reset(self, mask):
        self._policy.reset(mask)

    def __call__(self, observation):
        action = np.asarray(self._policy(observation), np.float32)
        self.seen.append(np.concatenate([observation, action], dtype=np.float32))
        return action


class Located(Logged):
    """With the localizer's evidence."""

    terms = LOCATED_ROOM


class Tracking(Logged):
    """With a stop for people."""

    terms, name = (*ROOM, TRACKS), "vfh+yield"


def episode(drive, steps=600, *, number=0, observation="ekf"):
    """Return the environment's drive, in a world to its end; ``number`` counts the seed's episodes.

    On the square it arrives by belief, as the waypoint generator does.
    """
    options = dict(drive)
    policy, seed, in_world = options.pop("policy"), options.pop("seed"), "world" in drive
    policy = make_policy(policy, robot=drive.get("robot", "burger"), noise=drive["noise"])
    if isinstance(policy, PolicyWithMemory):
        policy.reset(np.ones((), np.bool_))
    own = {"observation": observation} if in_world else {"arrival": "belief"}
    env = gym.make(f"turtlebot_gym/TurtleBot{'Rooms' if in_world else 'Square'}-v0", max_episode_steps=10**9, **own, **options)
    observation, info = env.reset(seed=seed)
    for _ in range(number):
        observation, info = env.reset()
    infos, ended = [info], False
    while len(infos) <= steps and not ended:
        observation, _, terminated, truncated, info = env.step(policy(observation))
        infos.append(info)
        ended = terminated or truncated
    env.close()
    drive = Drive.stack(infos, time=DT * np.arange(len(infos)))
    return replace(drive, clearance=drive.clearance.astype(np.float32))  # as its message carries it


def live(drive, steps, **options):
    """Return the graph's drive over a number of steps; the options are those of `Graph`."""
    with Graph(**drive, goal_tolerance=0.0, **options) as graph:
        return driven(graph, steps)


def driven(graph, steps):
    """Return the first steps of a graph's drive once they are done."""
    graph.wait_until(lambda graph: graph.time >= (steps - 0.5) * DT, timeout=max(120.0, 10.0 * steps * DT))
    return graph.trajectory()[: steps + 1]


def assert_same(expected, live):
    """Check that a live drive is the environment's in every number; headings survive their quaternion."""
    for name in COLUMNS:
        np.testing.assert_array_equal(getattr(live, name), getattr(expected, name), name)
