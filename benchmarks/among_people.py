"""Who reaches the goal among people: stops by tracks, by what was learned, and by the truth, at once or some tenths later.

All drive VFH+, and stand while somebody is about to come near. The one who knows has the true positions and velocities; with
a delay, those of some steps ago, moved on straight. `NAME+yield` has tracks, and nothing that was tuned. A stop at distances
from tracks, arcs around them and the one who knows are tuned on the trainings' rooms. The learned stop imitates the one who
knows, from the scan, the tracks and VFH+'s action (DAgger). People walk by the social force model; those who walk by ORCA are
for the test alone. Odometry is the wheels', without noise of the motion: with it the robot does not find its goal, whoever
walks there.

References:
    Ross, Gordon, Bagnell, "A reduction of imitation learning and structured prediction to no-regret online learning" (2011).
"""

from __future__ import annotations

import itertools
import multiprocessing
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from gymnasium.vector import AutoresetMode, VectorEnv
from numpy.typing import NDArray
from rich.table import Table

import arcs
from harness.study import Study, each, run
from orca import Orca
from turtlebot_gym.observations import NEAREST, ROOM, TRACK_BOUNDS, size_of
from turtlebot_gym.observations.columns import slices_of
from turtlebot_gym.parameters import ProcessNoise
from turtlebot_gym.presets import make_noise, make_robot
from turtlebot_gym_agents.evaluation import comparison, metrics
from turtlebot_gym_agents.evaluation.episodes import Episodes
from turtlebot_gym_agents.evaluation.evaluate import drive, driver_of
from turtlebot_gym_agents.policies import Policy
from turtlebot_gym_agents.policies.fit import ROOMS
from turtlebot_gym_agents.policies.yielding import passing
from turtlebot_gym_agents.training.normalization import NEAR

Flags = NDArray[np.bool_]
WIDTH, SCANNED = NEAREST * len(TRACK_BOUNDS[0]), slices_of(ROOM)["scan"]
PERIOD, HORIZON, GAP = 0.1, 0.5, 0.15
"""Control period, s; and the stop that is learned: somebody who walks on straight would come nearer than this, m, within this
time, s."""
KNOWN = list(itertools.product((0.5, 1.0, 1.5), (0.1, 0.2, 0.3)))
"""Tries of these two for the one who knows."""
TRAINING_SEED = 2**40
DISTANCES, DOUBTED = list(itertools.product((0.4, 0.5), (0.1, 0.12, 0.15), (0.6, 0.8))), 0.65
"""Tries of the stop at distances: time, s; clearance, m; and how many standard deviations more. And clearance of what may be
somebody, m."""
TRIED = 100
"""Rooms of each try, for each LiDAR."""
ARCS = list(itertools.product((0.5, 0.7, 1.0), (0.1, 0.2, 0.3)))
"""Tries of the arcs: time, s, and clearance, m."""
BATCH, EPOCHS, FOUND = 2048, 3, 0.25
"""Samples of an update, passes over all in a round, and probability from which the learned stop stands."""


@dataclass(frozen=True, kw_only=True)
class Config(Study):
    """Train and drive."""

    lidars: tuple[str, ...] = ("lds01", "lds02", "a1")
    """LiDARs; with the first one also among people who walk by ORCA."""
    episodes: int = 1000
    """Number of held-out rooms."""
    seed: int = 5_000_000
    """Their first seed."""
    trainings: int = 3
    """Number of trainings of the stop."""
    rounds: int = 12
    """Rounds of collecting and learning in each."""
    late: tuple[int, ...] = (0, 2, 4)
    """Delays of the one who knows, steps."""
    processes: int = 2
    """Number of processes that drive and train."""


def rooms(number: int, lidar: str, **options: Any) -> VectorEnv:
    """Return rooms with people."""
    noise = replace(make_noise("wheel"), process=ProcessNoise())
    options |= {"world": "people", "observation": "ekf,tracks", "info": "full", "vectorization_mode": "vector_entry_point"}
    return gym.make_vec(ROOMS, num_envs=number, lidar=lidar, noise=noise, **options)


def tracks_of(observations: NDArray) -> NDArray[np.float64]:
    """Return the tracks that are observed last, shape (n, `NEAREST`, 8)."""
    return observations[:, -WIDTH:].reshape(len(observations), NEAREST, -1).astype(float)


class Driver:
    """VFH+, whose actions ``revise(observations, actions)`` changes."""

    def __init__(self, envs: VectorEnv, revise: Callable[[NDArray, NDArray], NDArray]) -> None:
        self._policy: Any = driver_of("vfh", envs)
        self._revise = revise

    def reset(self, mask: Flags) -> None:
        self._policy.reset(mask)

    def __call__(self, observations: NDArray) -> NDArray:
        return self._revise(observations, np.array(self._policy(observations)))


def standing(stops: Callable[[NDArray, NDArray], Flags]) -> Callable[[NDArray, NDArray], NDArray]:
    """Return what lets the robot stand where ``stops(observations, actions)`` says so."""

    def revise(observations: NDArray, actions: NDArray) -> NDArray:
        actions[stops(observations, actions)] = 0.0
        return actions

    return revise


class Knowing:
    """Stops by the truth as it was some steps ago."""

    def __init__(self, envs: VectorEnv, late: int = 0, horizon: float = HORIZON, gap: float = GAP) -> None:
        self._envs: Any = envs.unwrapped
        self._horizon, self._gap = horizon, gap
        self._past = deque[tuple[NDArray, NDArray]](maxlen=late + 1)

    def __call__(self, *_: Any) -> Flags:
        scenes, states, _ = self._envs.truth()
        circles: NDArray[np.float64] = scenes.room.circles
        there = np.arange(circles.shape[1]) < scenes.room.counts[:, :1]
        self._past.append((circles[..., :2].copy(), circles[..., 3:5].copy()))
        at, walks = self._past[0]
        to = at + walks * PERIOD * (len(self._past) - 1) - states[:, None, :2]
        least = passing(to, walks, self._horizon)[1]
        near = self._gap + circles[..., 2] + self._envs.parameters.robot.radius
        return np.asarray(((least < near) & there).any(axis=1))


def by_truth(late: int) -> Callable[..., Any]:
    """Return what makes, of time and distance, a maker of a driver that knows where people were some steps ago."""
    return lambda horizon, gap: lambda envs: Driver(envs, standing(Knowing(envs, late, horizon, gap)))


def by_distances(horizon: float, gap: float, deviations: float) -> Callable[[VectorEnv], Policy]:
    """Return a maker of a driver that keeps a distance from tracks."""

    def stops(observations: NDArray, actions: NDArray) -> Flags:
        rows = tracks_of(observations)
        _, least = passing(rows[..., :2], rows[..., 2:4], horizon)
        kept = (
            np.where(rows[..., 7] == 1.0, gap + deviations * rows[..., 4], DOUBTED) + rows[..., 6] + make_robot("burger").radius
        )
        return np.asarray(((least < kept) & (rows[..., 7] > 0.0)).any(axis=1))

    return lambda envs: Driver(envs, standing(stops))


class Learned:
    """A network, and what it sees: speeds, the scan, VFH+'s action, and of each track its numbers, and when it passes."""

    def __init__(self) -> None:
        self.net: torch.nn.Sequential | None = None
        self.mean = self.std = torch.empty(0)

    def features(self, observations: NDArray, actions: NDArray) -> torch.Tensor:
        rows, seen = tracks_of(observations), observations[:, : size_of(ROOM)]
        until, least = passing(rows[..., :2], rows[..., 2:4], 2.0)
        near = least - rows[..., 6]
        tracks = np.concatenate([rows, *(x[..., None] for x in (np.linalg.norm(rows[..., :2], axis=-1), until, near))], -1)
        nobody = np.array([3.0, 3.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 3.0, 2.0, 3.0])
        most = np.maximum(nobody, 1.5)
        tracks = np.where(rows[..., 7:] > 0.0, np.clip(tracks, -most, most), nobody)
        scan = np.log(seen[:, SCANNED] + NEAR)
        parts = (seen[:, 5:7], scan, seen[:, -1:], actions, tracks.reshape(len(rows), -1))
        return torch.from_numpy(np.concatenate(parts, 1).astype(np.float32))

    def normal(self, features: torch.Tensor) -> torch.Tensor:
        return ((features - self.mean) / self.std).clamp(-10.0, 10.0)

    def finds(self, features: torch.Tensor, least: float) -> Flags:
        """Return where a stop is as probable as this, at least."""
        assert self.net is not None
        with torch.no_grad():
            return (self.net(self.normal(features))[:, 0].sigmoid() >= least).numpy()

    def drive(self, envs: VectorEnv) -> Policy:
        """Return VFH+ with this stop."""
        stops = standing(lambda rows, actions: self.finds(self.features(rows, actions), FOUND))
        return Driver(envs, stops)


def collect(learned: Learned, seed: int, lidar: str) -> Iterator[tuple[torch.Tensor, Flags]]:
    """Drive 256 rooms for 400 steps, and yield features and whether the one who knows would stop."""
    envs, random = rooms(256, lidar, autoreset_mode=AutoresetMode.SAME_STEP), np.random.default_rng(seed)
    policy: Any = driver_of("vfh", envs)
    knows, over = Knowing(envs), np.ones(256, np.bool_)
    observations, _ = envs.reset(seed=seed)
    for step in range(400):
        if over.any():
            policy.reset(over)
        actions, stops = np.array(policy(observations)), knows()
        features = learned.features(observations, actions)
        if step % 2 == 0:
            yield features, stops
        obeyed = np.where(random.random(256) < 0.8, stops, random.random(256) < 0.5) if learned.net is None else None
        actions[learned.finds(features, 0.5) if obeyed is None else obeyed] = 0.0
        observations, _, terminated, truncated, _ = envs.step(actions)
        over = terminated | truncated
    envs.close()


def train(seed: int, config: Config) -> Learned:
    """Return a stop that imitates the one who knows."""
    torch.manual_seed(seed)
    torch.set_num_threads(1)
    learned, parts = Learned(), list[tuple[torch.Tensor, Flags]]()
    for number in range(config.rounds):
        first = TRAINING_SEED * (1 + seed) + 256 * number
        parts += collect(learned, first, config.lidars[number % len(config.lidars)])
        x, y = torch.cat([x for x, _ in parts]), torch.from_numpy(np.concatenate([y for _, y in parts])).float()
        if learned.net is None:
            learned.mean, learned.std = x.mean(dim=0), x.std(dim=0).clamp_min(1e-3)
            sizes, relu = (x.shape[1], 128, 128, 1), torch.nn.ReLU
            first_layer, second, third = (torch.nn.Linear(a, b) for a, b in itertools.pairwise(sizes))
            learned.net = torch.nn.Sequential(first_layer, relu(), second, relu(), third)
        z, optimizer = learned.normal(x), torch.optim.Adam(learned.net.parameters(), 1e-3)
        loss_of = torch.nn.BCEWithLogitsLoss(pos_weight=torch.tensor(3.0))  # a stop that is missed is worse
        for batch in (part for _ in range(EPOCHS) for part in torch.randperm(len(z)).split(BATCH)):
            optimizer.zero_grad()
            loss_of(learned.net(z[batch])[:, 0], y[batch]).backward()
            optimizer.step()
    return learned


def driven(
    policy: str | Callable[[VectorEnv], Policy], lidar: str, episodes: int, seed: int, model: str = "forces"
) -> Episodes:
    """Return the episodes of a policy, given by its name or made for the environment, among people of a model."""
    envs = rooms(episodes, lidar) if model == "forces" else Orca(rooms(episodes, lidar))
    found, *_ = drive(envs, policy if isinstance(policy, str) else policy(envs), seed)
    envs.close()
    return found


def by_arcs(horizon: float, gap: float) -> Callable[[VectorEnv], Policy]:
    """Return a maker of VFH+ that takes another arc where tracks come near its own."""

    def revise(observations: NDArray, actions: NDArray) -> NDArray:
        return arcs.around(actions.astype(float), observations, tracks_of(observations), make_robot("burger"), horizon, gap)

    return lambda envs: Driver(envs, revise)


_TASKS: list[Callable[[], Any]] = []


def _do(number: int) -> Any:
    return _TASKS[number]()


def spread(tasks: Sequence[Callable[[], Any]], processes: int, label: str) -> list[Any]:
    """Return what each task returns; other processes do them."""
    _TASKS[:] = tasks
    with multiprocessing.get_context("fork").Pool(processes) as pool:
        return list(each(pool.imap(_do, range(len(tasks))), label, len(tasks)))


def tuned(
    maker: Callable[..., Any], tries: Sequence[tuple[float, ...]], lidars: Sequence[str], config: Config
) -> tuple[float, ...]:
    """Return the numbers with which a driver reaches most goals in rooms of the trainings."""
    cells = list(itertools.product(tries, lidars))
    tasks = [partial(driven, maker(*numbers), lidar, TRIED, TRAINING_SEED) for numbers, lidar in cells]
    goals = dict.fromkeys(tries, 0)
    for (numbers, _), found in zip(cells, spread(tasks, config.processes, "tries"), strict=True):
        goals[numbers] += int(found.success.sum())
    return max(goals, key=lambda numbers: goals[numbers])


def measure(config: Config) -> tuple[dict[str, Any], list[Table]]:
    """Return the results and their table."""
    distances, arc = tuned(by_distances, DISTANCES, config.lidars, config), tuned(by_arcs, ARCS, config.lidars, config)
    known = {late: tuned(by_truth(late), KNOWN, config.lidars[:1], config) for late in config.late}
    learned = spread([partial(train, seed, config) for seed in range(config.trainings)], config.processes, "trainings")
    drivers: dict[str, list[Any]] = {name: [name] for name in ("vfh", "vfh+yield", "vfh+safety+yield")}
    drivers |= {"stop at distances": [by_distances(*distances)], "arcs around tracks": [by_arcs(*arc)]}
    drivers |= {"stop learned": [one.drive for one in learned]}
    for late, numbers in known.items():
        name = "stop that knows" + (f", {late * PERIOD:.1f} s late" if late else "")
        drivers[name] = [by_truth(late)(*numbers)]
    worlds = [*((lidar, "forces") for lidar in config.lidars), (config.lidars[0], "ORCA")]
    cells = list(itertools.product(worlds, drivers))
    tasks = [
        partial(driven, driver, lidar, config.episodes, config.seed, model)
        for (lidar, model), name in cells
        for driver in drivers[name]
    ]
    found = iter(spread(tasks, config.processes, "drives"))
    rows, table = [], Table("LiDAR", "people", "policy", "goals, %", "collisions, %", "to goal, s")
    for (lidar, model), name in cells:
        parts = [next(found) for _ in drivers[name]]
        share = comparison.share if len(parts) > 1 else lambda flags: metrics.share(flags[0])
        row = {key: share(np.array([getattr(part, key) for part in parts])) for key in ("success", "collision")}
        time = metrics.mean(np.concatenate([part.time[part.success] for part in parts]))
        rows.append({"lidar": lidar, "people": model, "policy": name, **row, "time_to_goal": time})
        shown = ("{:.1f} ({:.1f}, {:.1f})".format(*(100.0 * bound for bound in part)) for part in row.values())
        table.add_row(lidar, model, name, *shown, f"{time.value:.1f}")
    return {"distances": distances, "arc": arc, "known": list(known.values()), "rows": rows}, [table]


def main() -> None:
    """Train, drive, print a table and write the results."""
    run(Config, measure, beside=__file__)


if __name__ == "__main__":
    main()
