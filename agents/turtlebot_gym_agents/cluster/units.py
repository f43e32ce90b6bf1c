"""Units of work: the task and everything it depends on, independent of where it runs.

A unit can be pickled, and `run` is a pure function of it: results are bit-identical on all machines with the same libraries and
kind of processor.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory, gettempdir
from typing import TYPE_CHECKING, Any, Protocol

import gymnasium as gym
import numpy as np

import turtlebot_gym.drives
from turtlebot_gym.files import load
from turtlebot_gym_agents.cluster.attachments import Attachments, attach, placed, unpacked
from turtlebot_gym_agents.cluster.origin import origin
from turtlebot_gym_agents.cluster.store import Result
from turtlebot_gym_agents.evaluation.episodes import Episodes
from turtlebot_gym_agents.evaluation.evaluate import batches, drive
from turtlebot_gym_agents.evaluation.metrics import Errors
from turtlebot_gym_agents.provenance import plain

if TYPE_CHECKING:
    from turtlebot_gym_agents.training.config import TrainingConfig

ROWS = ("time", "true_state", "odometry", "estimate", "covariance", "reference", "command", "clearance")
"""Columns of a trajectory that a unit returns."""
CHUNK = 250
"""Episodes per unit. It never depends on the number of workers, so that stored units are found again."""
KEPT = ("policy.onnx", "best.zip", "config.json", "result.json")
"""Files that return from a training's folder; checkpoints stay where they were made."""


class Unit(Protocol):
    """A piece of work."""

    memory: int
    """Memory that a process needs for it, bytes."""

    @property
    def size(self) -> int:
        """Size as counted by progress."""
        ...

    def about(self) -> dict[str, Any]:
        """Return everything that the result depends on, as JSON types."""
        ...

    def run(self) -> Result:
        """Run the unit."""
        ...


@dataclass(frozen=True, kw_only=True)
class Drive:
    """Some episodes of a policy, one for each seed."""

    policy: str
    """A name for `turtlebot_gym_agents.make_policy`, or "oracle"."""
    env: str
    """Environment id."""
    seed: int
    """Seed of the first episode."""
    episodes: int
    """Number of episodes."""
    options: Mapping[str, Any] = field(default_factory=dict)
    """Arguments of the environment."""
    files: Attachments = field(default_factory=dict)
    """Files that policy and options name."""
    trajectory: bool = False
    """Whether to record the first episode's trajectory."""
    allow_mismatch: bool = False
    """Whether a bundle made for another task or observation may drive."""
    memory = 500 * 2**20

    @property
    def size(self) -> int:
        """Return the number of episodes."""
        return self.episodes

    def about(self) -> dict[str, Any]:
        """Return all that the result depends on."""
        names = ("policy", "env", "seed", "episodes", "options", "trajectory", "allow_mismatch")
        return {"drive": plain({name: getattr(self, name) for name in names}), "files": _hashes(self.files)}

    def run(self) -> Result:
        """Drive the episodes."""
        with unpacked(self.files) as places:
            options = {name: placed(value, places) for name, value in self.options.items()}

            def make() -> Any:
                return gym.make_vec(
                    self.env, num_envs=self.episodes, vectorization_mode="vector_entry_point", info="full", **options
                )

            _compile(f"{self.env} {sorted(options)} {options.get('filter')} {options.get('plant')}", make)
            envs = make()
            episodes, trajectory, p = drive(envs, placed(self.policy, places), self.seed, allow_mismatch=self.allow_mismatch)
            envs.close()
        arrays = dict(columns(episodes))
        if self.trajectory:
            arrays |= {f"trajectory.{name}": getattr(trajectory, name) for name in ROWS}
        return Result({"limit": p.task.max_steps * p.dt, "max_linear": p.robot.max_linear}, arrays, {}, {})


@dataclass(frozen=True, kw_only=True)
class Training:
    """The training of a policy."""

    config: TrainingConfig
    """Configuration of the training."""
    hyper: Mapping[str, Any]
    """Hyper-parameters of the training."""
    files: Attachments = field(default_factory=dict)
    """Files that the configuration names."""
    memory = 1200 * 2**20
    size = 1

    def about(self) -> dict[str, Any]:
        """Return all that the result depends on."""
        config = {name: value for name, value in settings(self.config).items() if name not in ("config", "checkpoint_seconds")}
        return {"training": config, "hyperparameters": plain(self.hyper), "files": _hashes(self.files)}

    def run(self) -> Result:
        """Train."""
        from turtlebot_gym_agents.training.train import train

        with unpacked(self.files) as places, TemporaryDirectory(prefix="turtlebot-gym-") as name:
            config = located(self.config, places)
            compile_training(config, self.hyper)
            folder = Path(name)
            told = train(config, folder, progress=False, hyper=self.hyper)
            record = load(folder / "config.json")
            record["config"] = settings(self.config)  # with the files' original names, not the unpacked paths
            (folder / "config.json").write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")
            files = {file: (folder / file).read_bytes() for file in KEPT}
        facts = {"steps": told.steps, "best": dict(told.best), "history": told.history}
        return Result(facts, {}, files, {"training": told.seconds, "steps_per_second": told.steps_per_second})


def drives(
    policy: str,
    *,
    env: str,
    episodes: int,
    seed: int,
    chunk: int = CHUNK,
    files: Attachments | None = None,
    allow_mismatch: bool = False,
    **options: Any,
) -> list[Drive]:
    """Return the units of an evaluation.

    Args:
        policy: See `evaluation.evaluate.evaluate`, as for the others.
        env: Environment id.
        episodes: Number of episodes.
        seed: Seed of the first episode.
        chunk: Episodes per unit.
        files: Files that policy and options name, if they do not exist on this machine.
        allow_mismatch: See there.
        **options: Arguments of the environment.
    """
    carried = {**attach(policy, *options.values()), **(files or {})}
    common = {"policy": policy, "env": env, "options": options, "files": carried, "allow_mismatch": allow_mismatch}
    return [
        Drive(**common, seed=seed + start, episodes=size, trajectory=start == 0) for start, size in batches(episodes, chunk)
    ]


def training(config: TrainingConfig) -> Training:
    """Return the unit of a training, with its hyper-parameters."""
    from turtlebot_gym_agents.training import hyperparameters

    hyper = hyperparameters.load(config.algo, config.env, config.config)
    return Training(config=config, hyper=hyper, files=attach(*(config.robot, config.noise, config.fix, config.world)))


def key(unit: Unit) -> str:
    """Return the name of a unit's result: a hash of everything it depends on, code and libraries included."""
    text = json.dumps({"about": unit.about(), "origin": origin()}, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def run(unit: Unit) -> Result:
    """Run a unit, and record where it ran and how long it took."""
    begun, cpu = time.perf_counter(), time.process_time()
    result = unit.run()
    times = {
        "seconds": time.perf_counter() - begun,
        "cpu_seconds": time.process_time() - cpu,
        "host": platform.node(),
        "process": os.getpid(),
    }
    return result._replace(times={**times, **result.times})


def columns(episodes: Episodes) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the numbers of episodes by name; those in `Errors` as "field.name"."""
    for name, value in episodes._asdict().items():
        if isinstance(value, Errors):
            yield from ((f"{name}.{part}", numbers) for part, numbers in value._asdict().items())
        else:
            yield name, value


def episodes_of(arrays: Mapping[str, np.ndarray]) -> Episodes:
    """Return episodes from the arrays that `columns` yielded."""
    errors = {name: Errors(*(arrays[f"{name}.{part}"] for part in Errors._fields)) for name in ("estimate", "odometry")}
    values: dict[str, Any] = {**arrays, **errors}
    return Episodes(**{name: values[name] for name in Episodes._fields})


def trajectory_of(arrays: Mapping[str, np.ndarray]) -> turtlebot_gym.drives.Drive:
    """Return the trajectory among the arrays of a unit."""
    columns: dict[str, Any] = {name: arrays[f"trajectory.{name}"] for name in ROWS if f"trajectory.{name}" in arrays}
    return turtlebot_gym.drives.Drive(**columns)


def settings(config: TrainingConfig) -> dict[str, Any]:
    """Return a training's configuration as JSON types."""
    return plain(asdict(config))


def located(config: TrainingConfig, places: Mapping[str, str]) -> TrainingConfig:
    """Return a configuration with the local paths of files that were sent along."""
    return replace(config, **{name: placed(getattr(config, name), places) for name in ("robot", "noise", "fix", "world")})


def compile_training(config: TrainingConfig, hyper: Mapping[str, Any]) -> None:
    """Compile the loops that a training needs, see `_compile`."""
    system = f"{config.env} {config.filter} {config.fix} {config.world}"
    for number in {int(hyper["n_envs"]), config.episodes}:
        _compile(f"{system} {number}", lambda number=number: config.make(number))


_COMPILED: set[str] = set()


def _compile(system: str, make: Callable[[], Any]) -> None:
    """Step some environments once while no other process on this machine does, so that one compiles and the others use its
    cache.

    Args:
        system: Identity of the environments; each is compiled once per process.
        make: Makes the environments.
    """
    if system in _COMPILED:
        return
    _COMPILED.add(system)
    with _alone():
        envs = make()
        envs.reset(seed=0)
        envs.step(np.zeros(envs.action_space.shape, np.float32))
        envs.close()


@contextmanager
def _alone() -> Iterator[None]:
    """Wait until no other process of this user on this machine is in such a block; a killed process releases it."""
    try:
        import fcntl
    except ImportError:  # Windows: each process compiles for itself
        yield
        return
    with (Path(gettempdir()) / f"turtlebot-gym-{os.getuid()}.lock").open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


def _hashes(files: Attachments) -> dict[str, dict[str, str]]:
    """Return hashes of the files' contents, by name."""
    found: Sequence[tuple[str, Mapping[str, bytes]]] = sorted(files.items())
    return {name: {file: hashlib.sha256(content).hexdigest() for file, content in one.items()} for name, one in found}
