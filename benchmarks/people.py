"""Drive among people who walk: geometry, a stop by rule, a stop that was learned, and one that knows where everybody walks.

The learned stop imitates the one that knows. Drives are collected with what was learned so far, and labelled by the one that
knows, several times over (DAgger). The rule has the same three scans, and is tuned on the trainings' rooms. All drive the same
held-out rooms. `make bench-people` runs it and writes `people.json`; with ``--ship`` the first network becomes the package's.
Trainings and drives are kept under `out/`, by commit, so an interrupted run resumes.

References:
    Ross, Gordon, Bagnell, "A reduction of imitation learning and structured prediction to no-regret online learning", AISTATS
    (2011). Chen, Zhou, Koltun, Krähenbühl, "Learning by cheating", CoRL (2019).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from gymnasium.vector import AutoresetMode, VectorEnv
from numpy.typing import NDArray
from rich.table import Table

from harness.study import Study, each, run
from scenarios import kept, results_folder, slug
from turtlebot_gym.rooms.lidar import SECTORS, SIGHT
from turtlebot_gym_agents.evaluation import comparison, metrics
from turtlebot_gym_agents.evaluation.episodes import Episodes
from turtlebot_gym_agents.evaluation.evaluate import drive
from turtlebot_gym_agents.policies import Policy, make_policy
from turtlebot_gym_agents.policies.fit import ROOMS
from turtlebot_gym_agents.policies.named import pretrained_folder
from turtlebot_gym_agents.policies.yielding import BEFORE, FEATURES, NEAR, Network, Yielding

TRAINING_SEED = 2**40
HORIZON, GAP = 1.0, 0.1
"""The stop that knows: somebody who walks on straight would come nearer than this, m, within this time, s."""
LIDARS = ("lds01", "lds02", "a1", "lds01")
"""LiDARs of the rounds of a training, in turn."""
RULE, LEARNED = "vfh, stop by rule", "vfh, stop learned"
RULES = [(sight, nearer) for sight in (0.3, 0.45, 0.6, 0.8) for nearer in (0.1, 0.2, 0.4)]
"""Tries of the rule: range within which something counts, m, and by how much of its range it must have come nearer."""


@dataclass(frozen=True, kw_only=True)
class Config(Study):
    """Train and drive."""

    episodes: int = 1000
    """Number of held-out rooms."""
    seed: int = 5_000_000
    """Their first seed."""
    trainings: int = 3
    """Number of trainings of the stop."""
    rounds: int = 12
    """Rounds of collecting and learning in each."""
    policy: tuple[str, ...] = ("vfh", "vfh+safety", "planner+safety", "ppo-rooms+safety")
    """Further policies, as for `turtlebot-gym evaluate`."""
    lidar: tuple[str, ...] = ("lds01", "lds02", "a1")
    """LiDARs of the held-out rooms."""
    ship: bool = False
    """Write the first network into the package."""


def rooms(number: int, lidar: str, **options: Any) -> VectorEnv:
    """Return rooms with people."""
    return gym.make_vec(ROOMS, num_envs=number, world="people", lidar=lidar, info="full", **options)


class Knowing:
    """Drive by another policy, and stand where somebody is about to come near, by what the environment knows.

    Args:
        envs: The environment.
        policy: The policy that drives.
    """

    def __init__(self, envs: VectorEnv, policy: Policy) -> None:
        self._envs: Any = envs.unwrapped
        self._policy = policy
        self.reset: Callable[..., None] = getattr(policy, "reset", lambda mask: None)

    def stops(self) -> NDArray[np.bool_]:
        """Return whether somebody is about to come near, shape (n,)."""
        scenes, states, _ = self._envs.truth()
        circles, counts = scenes.room.circles, scenes.room.counts[:, :1]
        to, walks = circles[..., :2] - states[:, None, :2], circles[..., 3:5]
        until = -(to * walks).sum(axis=-1) / np.maximum((walks**2).sum(axis=-1), 1e-9)
        least = np.linalg.norm(to + walks * np.clip(until, 0.0, HORIZON)[..., None], axis=-1) - circles[..., 2]
        radius = self._envs.parameters.robot.radius
        return ((least - radius < GAP) & (np.arange(circles.shape[1]) < counts)).any(axis=1)

    def __call__(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        actions = np.array(self._policy(observations))
        actions[self.stops()] = 0.0
        return actions


class Rule:
    """Stops where something within sight has come nearer: the learned stop's opponent, with the same features."""

    def __init__(self, sight: float, nearer: float) -> None:
        self._log, self._nearer = np.log(sight / SIGHT + NEAR), np.log(1.0 + nearer)

    def __call__(self, features: NDArray[np.float32]) -> NDArray[np.float32]:
        logs, farther = features[:, 2 : 2 + SECTORS], features[:, 3 + SECTORS :].reshape(-1, BEFORE, SECTORS)
        came = (farther > self._nearer).any(axis=1) & (logs < self._log)
        return came.any(axis=1).astype(np.float32)


def layers() -> torch.nn.Sequential:
    """Return an untrained network."""
    sizes, relu = (FEATURES, 128, 128, 1), torch.nn.ReLU
    first, second, third = (torch.nn.Linear(a, b) for a, b in pairwise(sizes))
    return torch.nn.Sequential(first, relu(), second, relu(), third)


def network_of(net: torch.nn.Sequential, mean: torch.Tensor, std: torch.Tensor) -> Network:
    """Return a trained network in numpy's arrays."""
    arrays = {"mean": mean.numpy(), "std": std.numpy()}
    state = net.state_dict()
    for number, layer in enumerate(("0", "2", "4")):
        arrays |= {f"weight{number}": state[f"{layer}.weight"].numpy().T, f"bias{number}": state[f"{layer}.bias"].numpy()}
    return Network(arrays)


def collect(policy: Yielding, seed: int, lidar: str, *, known: float) -> Iterator[tuple[NDArray, NDArray]]:
    """Drive 256 rooms for 400 steps, and yield features and whether the stop that knows would stop.

    Args:
        policy: What drives.
        seed: First seed of the rooms.
        lidar: The LiDAR.
        known: Share of the steps in which the stop that knows is obeyed.
    """
    envs = rooms(256, lidar, autoreset_mode=AutoresetMode.SAME_STEP)
    knows, random = Knowing(envs, policy.policy), np.random.default_rng(seed)
    observations, _ = envs.reset(seed=seed)
    policy.reset(np.ones(256, np.bool_))
    for _ in range(400):
        actions, stops = np.array(policy.policy(observations)), knows.stops()
        features = policy.scans.features(np.asarray(observations, np.float64))
        yield features, stops
        actions[np.where(random.random(256) < known, stops, policy.network(features) >= 0.5)] = 0.0
        observations, _, terminated, truncated, _ = envs.step(actions)
        if (over := terminated | truncated).any():
            policy.reset(over)
    envs.close()


def train(seed: int, config: Config) -> tuple[Network, float]:
    """Return a network that was taught, and the CPU time that it took, s."""
    begin = time.process_time()
    torch.manual_seed(seed)
    torch.set_num_threads(1)
    net, features, stops = layers(), [], []
    mean, std = torch.zeros(FEATURES), torch.ones(FEATURES)
    for number in each(range(config.rounds), f"training {seed}"):
        policy = Yielding(make_policy("vfh"), network_of(net, mean, std))
        lidar = LIDARS[number % len(LIDARS)]
        driven = list(collect(policy, TRAINING_SEED * (1 + seed) + 256 * number, lidar, known=0.8 if number == 0 else 0.0))
        features += [x for x, _ in driven[::2]]
        stops += [y for _, y in driven[::2]]
        x, y = torch.from_numpy(np.concatenate(features)), torch.from_numpy(np.concatenate(stops).astype(np.float32))
        if number == 0:
            mean, std = x.mean(dim=0), x.std(dim=0).clamp_min(1e-3)
        z = ((x - mean) / std).clamp(-10.0, 10.0)
        optimizer = torch.optim.Adam(net.parameters(), 1e-3)
        # A stop that is missed is worse than one for nothing.
        loss_of = torch.nn.BCEWithLogitsLoss(pos_weight=torch.tensor(3.0))
        for batch in (part for _ in range(3) for part in torch.randperm(len(z)).split(2048)):
            optimizer.zero_grad()
            loss_of(net(z[batch])[:, 0], y[batch]).backward()
            optimizer.step()
    return network_of(net, mean, std), time.process_time() - begin


def driven(make: Callable[[VectorEnv], Policy], lidar: str, episodes: int, seed: int) -> Episodes:
    """Drive a policy, which is made for the environment."""
    envs = rooms(episodes, lidar)
    result, *_ = drive(envs, make(envs), seed)
    envs.close()
    return result


def yielding(judge: Any) -> Callable[[VectorEnv], Policy]:
    """Return a maker of VFH+ that stands by a judge of the features."""
    return lambda envs: Yielding(make_policy("vfh"), judge)


def tuned() -> tuple[float, float]:
    """Return the numbers of the rule with which most goals are reached in rooms of the trainings."""
    shares = {numbers: driven(yielding(Rule(*numbers)), "lds01", 200, TRAINING_SEED).success.mean() for numbers in RULES}
    return max(shares, key=lambda numbers: shares[numbers])


def figures(parts: list[Episodes]) -> dict[str, Any]:
    """Return the figures of a policy, or of several trainings with the variance between them in the intervals."""
    together = {name: np.array([getattr(e, name) for e in parts]) for name in ("success", "collision")}
    share = comparison.share if len(parts) > 1 else lambda flags: metrics.share(flags[0])
    arrived = [e.time[e.success] for e in parts]
    return {**{name: share(flags) for name, flags in together.items()}, "time_to_goal": metrics.mean(np.concatenate(arrived))}


def gain(by_policy: dict[str, list[Episodes]]) -> dict[str, Any]:
    """Return the learned stop's shares minus the rule's in the same rooms, with the variance between trainings."""
    learned, (rule,) = by_policy[LEARNED], by_policy[RULE]
    return {
        f"{name}_minus_rule": comparison.spread([1.0 * getattr(e, name) - getattr(rule, name) for e in learned]).interval()
        for name in ("success", "collision")
    }


@cache  # the results name a clean tree only if the first network is shipped after they are written
def trained(config: Config) -> list[tuple[Network, float]]:
    """Return the network of each training, and its CPU time, s."""
    folder = results_folder("people")
    return [kept(folder / f"{slug(seed=n, rounds=config.rounds)}.pickle", train, n, config) for n in range(config.trainings)]


def measure(config: Config) -> tuple[dict[str, Any], list[Table]]:
    """Return the results of all policies with each LiDAR, and their table."""
    folder = results_folder("people")
    networks, seconds = zip(*trained(config), strict=True)
    numbers = kept(folder / "rule.pickle", tuned)
    named = {name: [lambda envs, name=name: make_policy(name)] for name in config.policy}
    makers: dict[str, list[Callable[[VectorEnv], Policy]]] = {
        **named,
        RULE: [yielding(Rule(*numbers))],
        LEARNED: [yielding(network) for network in networks],
        "vfh, stop that knows": [lambda envs: Knowing(envs, make_policy("vfh"))],
    }
    table, rows = Table("LiDAR", "policy", "goals, %", "collisions, %", "to goal, s", "minus rule, points"), []
    for lidar in config.lidar:
        by_policy: dict[str, list[Episodes]] = {}
        for name, some in each(makers.items(), lidar):
            by_policy[name] = []
            for number, make in enumerate(some):
                stem = slug(policy=name, number=number, lidar=lidar, n=config.episodes, seed=config.seed)
                arguments = make, lidar, config.episodes, config.seed
                by_policy[name].append(kept(folder / f"{stem}.pickle", driven, *arguments))
            row = figures(by_policy[name])
            rows.append({"lidar": lidar, "policy": name, **row, **(gain(by_policy) if name == LEARNED else {})})
            more = rows[-1].get("success_minus_rule")
            cells = (f"{row['success']:.1%}", f"{row['collision']:.1%}", f"{row['time_to_goal'].value:.1f}")
            table.add_row(lidar, name, *cells, f"{more:+.1%}" if more else "")
    return {"rule": numbers, "training_cpu_s": float(np.mean(seconds)), "rows": rows}, [table]


if __name__ == "__main__":
    options, _ = run(Config, measure, beside=__file__)
    if options.ship:
        np.savez_compressed(pretrained_folder() / "yield.npz", **trained(options)[0][0].arrays)
