"""Measure the overhead of ``turtlebot-gym train`` over the learning itself, also on a busy machine.

Two contenders take turns, each in its own process: the whole command, from its start to the written policy, and the bare
``model.learn()`` with the same steps, algorithm, adapter, network and seed, without callbacks, timed without imports and
preparation. The results are medians over the rounds of wall time, CPU seconds and the ratio in each round. One more run shows
where the command's time goes.

With ``--busy 4`` each round has a second part beside four busy processes, which this program starts and stops: CPU seconds of a
training should not grow with them. The machine is used as it is; its load is recorded.

`make bench-train` runs it, with nothing else on the cores.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

import tyro

from harness.machine import busy, in_child, machine
from harness.turns import Turn

LIMIT = 1.25
"""Limit on the ratio of the whole command to the bare learning, wall time."""
BUSY_LIMIT = 1.3
"""Limit on the ratio of a training's CPU seconds on a busy machine to those alone."""


@dataclass(frozen=True, kw_only=True)
class Config:
    """Compare the time of the command with the bare learning."""

    env: str = "turtlebot_gym/TurtleBotNav-v0"
    """Environment id."""
    steps: int = 1_000_000
    """Steps of each training."""
    seed: int = 0
    """Seed of all trainings."""
    rounds: int = 3
    """Number of turns of each contender."""
    busy: int = 0
    """Busy processes for the second part of each round; 0 for none."""
    json: Path | None = None
    """Write the results here."""
    part: Literal["all", "bare", "account"] = "all"
    """Part to run in a child process."""


@dataclass
class Stopwatch:
    """Adds up the time of functions, without that of nested ones."""

    taken: dict[str, list[float]] = field(default_factory=dict)
    """Wall and CPU seconds by name."""
    _inner: list[list[float]] = field(default_factory=lambda: [[0.0, 0.0]])

    @contextmanager
    def time(self, name: str) -> Iterator[None]:
        """Add this block's time."""
        self._inner.append([0.0, 0.0])
        begin = _now()
        try:
            yield
        finally:
            both = [end - start for start, end in zip(begin, _now(), strict=True)]
            inner = self._inner.pop()
            own = self.taken.setdefault(name, [0.0, 0.0])
            for at in (0, 1):
                own[at] += both[at] - inner[at]
                self._inner[-1][at] += both[at]

    def timed(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """Return the function, timed."""

        def run(*args: Any, **kwargs: Any) -> Any:
            with self.time(name):
                return function(*args, **kwargs)

        return run


def _now() -> tuple[float, float]:
    return time.perf_counter(), time.process_time()


def bare(config: Config) -> Turn:
    """Return the cost of ``learn()`` alone, in this process."""
    import torch

    from turtlebot_gym.compiled.threads import limited
    from turtlebot_gym_agents.training.config import TrainingConfig
    from turtlebot_gym_agents.training.model import make_model

    torch.set_num_threads(1)
    training = TrainingConfig(env=config.env, seed=config.seed, steps=config.steps)
    with tempfile.TemporaryDirectory() as folder, limited(1):
        model = make_model(training, training.make_training(), tensorboard=Path(folder))
        wall, cpu = _now()
        model.learn(config.steps)
        return Turn(*(end - start for start, end in zip((wall, cpu), _now(), strict=True)))


def account(config: Config, folder: Path) -> dict[str, list[float]]:
    """Return the command's wall and CPU seconds by part, in this process."""
    watch = Stopwatch()
    with watch.time("all the rest"):
        with watch.time("imports: the command line"):
            from turtlebot_gym_agents.commands.cli import main
        with watch.time("imports: the environments and numba"):
            from turtlebot_gym_agents.training import config as _  # noqa: F401
        with watch.time("imports: torch and Stable-Baselines3"):
            import stable_baselines3  # noqa: F401
        with watch.time("imports: the training"):
            from turtlebot_gym_agents.training import callbacks, model, train

        judge, saver = callbacks.EvaluationCallback, callbacks.CheckpointCallback
        judge._evaluate = watch.timed("evaluations", judge._evaluate)
        saver.save = watch.timed("checkpoints", saver.save)
        callbacks.save_model = watch.timed("checkpoints", callbacks.save_model)
        callbacks.export = watch.timed("the bundle", callbacks.export)
        model.measure = watch.timed("loops and normalization", model.measure)
        train.make_model = watch.timed("the model", train.make_model)
        train.learn = watch.timed("learning", train.learn)
        main([*_arguments(config), "--out", str(folder)])
    return watch.taken


def command(config: Config) -> Turn:
    """Return the cost of the whole command, as a process."""
    with tempfile.TemporaryDirectory() as folder:
        arguments = [sys.executable, "-m", "turtlebot_gym_agents", *_arguments(config), "--out", f"{folder}/run"]
        start = time.perf_counter()
        with Path(folder, "output").open("w+b") as output:
            child = subprocess.Popen(arguments, stdout=output, stderr=output)
            _, status, used = os.wait4(child.pid, 0)
            child.returncode = os.waitstatus_to_exitcode(status)
            if child.returncode:
                output.seek(0)
                raise RuntimeError(f"{' '.join(arguments)} failed: {output.read().decode()}")
        return Turn(time.perf_counter() - start, used.ru_utime + used.ru_stime)


def _arguments(config: Config) -> list[str]:
    return ["train", "--env", config.env, "--steps", str(config.steps), "--seed", str(config.seed)]


def _child(config: Config, part: str) -> Any:
    """Run a part of this program in its own process, and return what it prints."""
    return in_child(__file__, "--part", part, "--env", config.env, "--steps", config.steps, "--seed", config.seed)


def one_round(config: Config) -> dict[str, Turn]:
    """Return the turn of each contender."""
    turns = {"command": command(config), "bare": Turn(*_child(config, "bare"))}
    if config.busy:
        with busy(config.busy):
            turns |= {"command, busy": command(config), "bare, busy": Turn(*_child(config, "bare"))}
    return turns


def ratio(rounds: list[dict[str, Turn]], over: str, under: str, clock: str) -> float:
    """Return the median over the rounds of the ratio of two contenders."""
    return statistics.median(getattr(turns[over], clock) / getattr(turns[under], clock) for turns in rounds)


def main() -> None:
    """Measure, print tables, and write JSON."""
    config = tyro.cli(Config, description=__doc__)
    if config.part == "bare":
        print(json.dumps(bare(config)))
        return
    if config.part == "account":
        with tempfile.TemporaryDirectory() as folder:
            print(json.dumps(account(config, Path(folder, "run"))))
        return
    _measure(config)


def _measure(config: Config) -> None:
    from rich.console import Console
    from rich.table import Table

    from turtlebot_gym_agents.provenance import write_json

    before = machine()
    command(Config(env=config.env, steps=1, seed=config.seed))  # compile, and load the files into memory
    rounds = [one_round(config) for _ in range(config.rounds)]
    where = _child(config, "account")
    console = Console(width=None if sys.stdout.isatty() else 120)
    title = f"{config.steps:,} steps of PPO, {config.rounds} rounds, {before['cores']} cores, load {before['load_before']:.1f}"
    table = Table("median of the rounds", "wall, s", "CPU, s", title=title)
    medians = {
        name: Turn(*(statistics.median(part) for part in zip(*(turns[name] for turns in rounds), strict=True)))
        for name in rounds[0]
    }
    for name, cost in medians.items():
        table.add_row(name, f"{cost.wall:.2f}", f"{cost.cpu:.2f}")
    console.print(table)
    table = Table("where the command's time goes", "wall, s", "CPU, s")
    for name, (wall, cpu) in sorted(where.items(), key=lambda item: -item[1][0]):
        table.add_row(name, f"{wall:.2f}", f"{cpu:.2f}")
    console.print(table)
    ratios = {f"command over bare learning, {clock}": ratio(rounds, "command", "bare", clock) for clock in Turn._fields}
    limits = {"command over bare learning, wall": LIMIT}
    if config.busy:
        name = f"command beside {config.busy} busy processes over alone, cpu"
        ratios[name], limits[name] = ratio(rounds, "command, busy", "command", "cpu"), BUSY_LIMIT
    table = Table("ratio, median of the rounds", "", "at most", "met")
    for name, value in ratios.items():
        limit = limits.get(name)
        table.add_row(name, f"{value:.2f}", *(("", "") if limit is None else (f"{limit:g}", "yes" if value <= limit else "NO")))
    console.print(table)
    if config.json is not None:
        settings = {name: value for name, value in asdict(config).items() if name not in ("json", "part")}
        turns = [{name: cost._asdict() for name, cost in costs.items()} for costs in rounds]
        result = {"machine": {**before, "load_after": os.getloadavg()[0]}, "ratios": ratios, "rounds": turns}
        result["where"] = {name: Turn(*cost)._asdict() for name, cost in where.items()}
        write_json(config.json, result, config=settings)


if __name__ == "__main__":
    main()
