"""Hashes of rollouts: every number that an environment gives, for combinations of all its choices.

    python tests/golden/golden.py write              # store the hashes, in plain Python
    python tests/golden/golden.py check --mode plain # compare: plain, scalar or vector
    python tests/golden/golden.py check --sample 12  # some of them

A change that is meant to leave results as they are must leave every hash as it is. Scalar environment, vector environment and
plain Python must give the same hash.
"""

import argparse
import hashlib
import itertools
import json
import random
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

import turtlebot_gym  # noqa: F401  # registers the environments
from turtlebot_gym.estimation.filters import matrix
from turtlebot_gym.heart import Episode
from turtlebot_gym.observations.columns import bounds_of
from turtlebot_gym.systems import Options
from turtlebot_gym.tasks import SQUARE_WAYPOINTS

HASHES = Path(__file__).parent / "golden.json"
SEEDS, STEPS = (3, 4), 25
MODES = ("plain", "scalar", "vector")

FILTERS = ("matched", "tutorial", "gated")
NOISES = ("clean", "tutorial", "documented", "wheel", "rough")
FIXES = ("beacons", "late", "localization", "markers", "motion-capture")
WORLDS = ("clutter", "dense", "corridor", "office", "cellular", "crowd")
LIDARS = ("lds01", "lds02", "a1", "ideal")
OPEN = ("Nav", "Pose", "Square")
OTHERS = (
    *(("robot", robot) for robot in ("waffle", "turtlebot4", "tutorial")),
    *(("integrator", "midpoint"), ("delay", 3), ("observation", "odometry"), ("observation", "truth")),
    *(("arrival", "belief"), ("dt", 0.05)),
)
COMPILED = ("matched", "tutorial")
"""Filters whose combinations with fixes and rooms run compiled too; systems for the other one would take minutes."""


def combinations() -> Iterator[dict[str, Any]]:
    """Yield the keyword arguments of environments, with their id."""
    for id, filter, noise in itertools.product(OPEN, FILTERS, NOISES):
        yield {"id": id, "filter": filter, "noise": noise}
    for id, filter, fix, noise in itertools.product(OPEN, FILTERS, FIXES, ("documented", "rough")):
        yield {"id": id, "filter": filter, "noise": noise, "fix": fix}
    for fix in FIXES:
        yield {"id": "Nav", "filter": "matched", "noise": "wheel", "fix": fix}
    for at, (world, lidar) in enumerate(itertools.product(WORLDS, LIDARS)):
        yield {"id": "Rooms", "world": world, "lidar": lidar, "noise": NOISES[at % 3], "filter": "matched"}
        if at % 6 < len(FILTERS):
            filter = FILTERS[at % 6]
            yield {"id": "Rooms", "world": world, "lidar": lidar, "noise": "rough", "filter": filter}
            noise, fix = NOISES[at % 5], FIXES[at % 5]
            yield {"id": "Rooms", "world": world, "lidar": lidar, "noise": noise, "filter": filter, "fix": fix}
    for world in WORLDS:
        yield {"id": "Rooms", "world": world, "lidar": "ideal", "noise": "wheel", "filter": "matched"}
    for id, (name, value) in itertools.product(OPEN, OTHERS):
        yield {"id": id, "filter": "matched", "noise": "documented", name: value}
    yield {"id": "Square", "filter": "matched", "noise": "documented", "switch": "time"}
    yield {"id": "Square", "filter": "matched", "noise": "documented", "laps": 2}


def name_of(chosen: dict[str, Any]) -> str:
    """Return a combination on one line."""
    return " ".join(f"{key}={value}" for key, value in chosen.items())


def modes_of(chosen: dict[str, Any]) -> tuple[str, ...]:
    """Return the modes in which a combination runs: all, but for the systems that would be compiled for it alone."""
    common = chosen["filter"] in COMPILED if "fix" in chosen or chosen["id"] == "Rooms" else True
    return MODES if common else ("plain",)


def actions() -> np.ndarray:
    """Return actions, shape (STEPS, len(SEEDS), 2): forward and in changing turns."""
    steps, rows = np.arange(STEPS)[:, None], np.arange(len(SEEDS))[None, :]
    return np.stack([0.6 + 0.3 * np.sin(0.7 * steps + rows), np.sin(0.45 * steps - rows)], axis=-1).astype(np.float32)


def arguments_of(chosen: dict[str, Any]) -> tuple[str, dict[str, Any]]:
    """Return an id and its keyword arguments."""
    return f"turtlebot_gym/TurtleBot{chosen['id']}-v0", {key: value for key, value in chosen.items() if key != "id"}


def numbers(observation: Any, reward: float, ended: bool, state: dict[str, Any]) -> np.ndarray:
    """Return the numbers of a step."""
    parts = [np.asarray(observation, np.float32).astype(np.float64), [reward, float(ended)]]
    keys = ("true_state", "odometry", "estimate", "covariance", "command", "distance")
    return np.concatenate([*parts, *(np.asarray(state[key], np.float64).reshape(-1) for key in keys)])


def by_scalar(chosen: dict[str, Any]) -> list[list[np.ndarray]]:
    """Drive the scalar environment."""
    id, arguments = arguments_of(chosen)
    rows = []
    for at, seed in enumerate(SEEDS):
        env = gym.make(id, **arguments)
        observation, info = env.reset(seed=seed)
        row, terminated = [numbers(observation, 0.0, False, info)], False
        for action in actions()[:, at]:
            if not terminated:
                observation, reward, terminated, _, info = env.step(action)
                row.append(numbers(observation, float(reward), terminated, info))
        rows.append(row)
    return rows


def by_vector(chosen: dict[str, Any]) -> list[list[np.ndarray]]:
    """Drive the vector environment."""
    id, arguments = arguments_of(chosen)
    envs = gym.make_vec(id, num_envs=len(SEEDS), vectorization_mode="vector_entry_point", info="full", **arguments)
    none = np.zeros(len(SEEDS))
    steps = [(*envs.reset(seed=list(SEEDS)), none, none)]
    for action in actions():
        observations, rewards, terminated, _, infos = envs.step(action)
        steps.append((observations, infos, rewards, terminated))
    rows: list[list[np.ndarray]] = [[] for _ in SEEDS]
    for at, row in enumerate(rows):
        for observations, infos, rewards, terminated in steps:
            info = {key: values[at] for key, values in infos.items() if not key.startswith("_")}
            row.append(numbers(observations[at], float(rewards[at]), bool(terminated[at]), info))
            if terminated[at]:
                break
    return rows


def by_plain(chosen: dict[str, Any]) -> list[list[np.ndarray]]:
    """Drive the episode of an environment in plain Python, without the environment, which would be compiled."""
    id, arguments = arguments_of(chosen)
    parameters = Options.of(gym.spec(id).kwargs | arguments).setup().parameters
    rows = []
    for at, seed in enumerate(SEEDS):
        episode = Episode(parameters, SQUARE_WAYPOINTS, seed=seed)
        low, high = np.array(bounds_of(episode.system.terms), np.float32)

        row = []
        for action in (None, *actions()[:, at].tolist()):
            if action is not None:
                episode.act(action)
            world, outcome = episode.world, episode.outcome
            state = {
                "true_state": world.body.true_state,
                "odometry": world.senses.odometry.pose,
                "estimate": world.estimate.belief.mean,
                "covariance": matrix(world.estimate.belief.covariance),
                "command": world.body.command,
                "distance": outcome.distance,
            }
            seen = np.clip(np.array(episode.observe(), np.float32), low, high)
            row.append(numbers(seen, outcome.reward, outcome.terminated, state))
            if outcome.terminated:
                break
        rows.append(row)
    return rows


def hash_of(chosen: dict[str, Any], mode: str) -> str:
    """Return the hash of a combination's rollouts; -0.0 counts as 0.0, since equal numbers must count as equal."""
    rows = {"plain": by_plain, "scalar": by_scalar, "vector": by_vector}[mode](chosen)
    digest = hashlib.sha256()
    for row in rows:
        digest.update((np.concatenate(row) + 0.0).tobytes())
    return digest.hexdigest()[:16]


def main() -> int:
    """Write or check the hashes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("write", "check"))
    parser.add_argument("--mode", choices=MODES, default="plain")
    parser.add_argument("--sample", type=int, help="check so many, drawn with --seed")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="", help="combinations that contain this text")
    given = parser.parse_args()
    chosen = [case for case in combinations() if given.only in name_of(case) and given.mode in modes_of(case)]
    if given.sample:
        chosen = random.Random(given.seed).sample(chosen, given.sample)
    known = json.loads(HASHES.read_text()) if HASHES.exists() else {}
    differing = []
    for case in chosen:
        name, digest = name_of(case), hash_of(case, given.mode)
        if given.what == "write":
            known[name] = digest
        elif known[name] != digest:
            differing.append(name)
            print(f"differs: {name}", flush=True)
    if given.what == "write":
        HASHES.write_text(json.dumps(known, indent=0) + "\n")
    print(f"{len(chosen)} combinations in mode {given.mode}: {len(differing)} differ")
    return bool(differing)


if __name__ == "__main__":
    raise SystemExit(main())
