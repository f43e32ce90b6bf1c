"""Measure environments of this package beside those of other projects: CPU time of a step, on the same core in the same run.

The projects come from PyPI, in the versions of `peers.txt`, into an environment of their own. Each contender runs in a process
of its own, see `harness.peer`. Ours and its peers take turns, forwards and backwards, so other programs disturb all alike. A
project that cannot be installed or run is named with the cause. Our loops are compiled
into an empty cache, or into that of TURTLEBOT_GYM_CACHE_DIR.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import tyro
from rich.table import Table

from harness.machine import Watch, machine
from harness.process import HERE, Process, environment_of
from harness.study import Study, each, run
from harness.turns import Turn, alternate, calls_for

XLA_FLAGS = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"
PINNED = Path(__file__).with_suffix(".txt")
PROJECTS = {"gymnasium": "gymnasium", "envpool": "envpool", "gymnax": "gymnax six", "jaxmarl": "jaxmarl", "ir-sim": "ir-sim"}
"""What pip is asked to install, by project."""


class Peer(NamedTuple):
    """Environment of another project."""

    name: str
    """Name in `harness.peer.PROGRAMS`."""
    project: str
    """Project on PyPI."""


PEERS: dict[tuple[str, int], tuple[Peer, ...]] = {
    ("TurtleBotNav", 4096): (
        Peer("CartPole", "gymnasium"),
        Peer("EnvPool's Pendulum", "envpool"),
        Peer("gymnax's Pendulum", "gymnax"),
    ),
    ("TurtleBotRooms", 64): (Peer("JaxNav", "jaxmarl"), Peer("JaxNav without new rooms", "jaxmarl")),
    ("TurtleBotRooms", 1): (Peer("IR-SIM", "ir-sim"),),
}
"""Our environments, with their number, and the peers of each. Rooms and its peers have a LiDAR of 180 beams a step."""


@dataclass(frozen=True, kw_only=True)
class Config(Study):
    """Measure this package beside other projects."""

    rounds: int = 9
    """Number of turns of each contender."""
    seconds: float = 0.5
    """Length of a turn, CPU s."""
    environment: Annotated[Path, tyro.conf.arg(metavar="FOLDER")] = Path(".venv-peers")
    """Virtual environment of the projects, made if missing."""


def install(folder: Path) -> dict[str, str]:
    """Make the environment, and return the cause for each project that pip cannot install.

    Raises:
        subprocess.CalledProcessError: If this package cannot be installed.
    """
    if not (folder / "bin" / "python").is_file():
        subprocess.run([sys.executable, "-m", "venv", folder], check=True)
    pip = [folder / "bin" / "python", "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--constraint", PINNED]
    subprocess.run([*pip, "--editable", f"{HERE}[gym]"], check=True)
    causes = {}
    for project, wanted in PROJECTS.items():
        done = subprocess.run([*pip, *wanted.split()], capture_output=True, text=True)
        if done.returncode:
            said = done.stderr.splitlines()
            causes[project] = ([line for line in said if line.startswith("ERROR")] or said or ["pip said nothing."])[-1]
    return causes


def versions(python: Path) -> dict[str, str]:
    """Return the installed versions of the projects and of the pinned libraries."""
    listed = subprocess.run([python, "-m", "pip", "freeze"], capture_output=True, text=True, check=True).stdout.splitlines()
    pinned = {line.partition("==")[0] for line in PINNED.read_text(encoding="utf-8").splitlines()}
    return {name: version for name, _, version in (line.partition("==") for line in listed) if name in pinned}


def compared(
    ours: tuple[str, int], peers: tuple[Peer, ...], config: Config, failed: dict[str, str]
) -> tuple[list[dict[str, Any]], float | None]:
    """Return a row for each peer, and how many cores other programs used meanwhile.

    Args:
        ours: Our environment, and the number of all environments.
        peers: Environments compared with it.
        config: Options.
        failed: Causes by name; peers that do not run are added.
    """
    python = config.environment.absolute() / "bin" / "python"
    size = ours[1]
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        variables = environment_of(HERE)
        variables["PYTHONPATH"] += os.pathsep + str(HERE / "benchmarks")
        variables.setdefault("TURTLEBOT_GYM_CACHE_DIR", str(folder / "cache"))
        variables |= {"JAX_PLATFORMS": "cpu", "XLA_FLAGS": XLA_FLAGS, "MPLBACKEND": "Agg"}
        started: dict[str, Process] = {}
        for name in (ours[0], *(peer.name for peer in peers if peer.project not in failed)):
            command = [str(python), "-m", "harness.peer", name, str(size)]
            try:
                started[name] = Process(command, folder / "log", env=variables, cwd=folder)
            except ChildProcessError as error:
                if name == ours[0]:
                    raise
                failed[name] = str(error)
            else:
                stack.callback(started[name].stop)
        calls = {name: calls_for(by_cpu(process), config.seconds) for name, process in started.items()}
        watch = Watch()
        turns = alternate({name: process.turn for name, process in started.items()}, calls, config.rounds)
        others = watch.used_by_others(sum(turn.cpu for of_one in turns.values() for turn in of_one))
    spent = {
        name: [(1e9 * turn.cpu / steps, 1e9 * turn.wall / steps) for turn in turns[name]]
        for name, process in started.items()
        for steps in [calls[name] * process.ready["steps"]]
    }
    rows = []
    for peer in peers:
        if peer.name in spent:
            ratios = [theirs[0] / mine[0] for theirs, mine in zip(spent[peer.name], spent[ours[0]], strict=True)]
            both = {"peer": peer.name, "ours": ours[0]}
            row = {**both, "project": peer.project, "size": size, "ratio": median_of(ratios)}
            for side, name in both.items():
                cpu, wall = zip(*spent[name], strict=True)
                start = started[name].ready["start"]
                row[f"{side}_ns"] = {"cpu": median_of(cpu), "wall": statistics.median(wall), "first_use_s": start}
            rows.append(row)
    return rows, others


def by_cpu(process: Process) -> Callable[[int], Turn]:
    """Return a process's turns with their CPU seconds in place of the wall time, which other programs lengthen."""
    return lambda calls: Turn(*2 * (process.turn(calls).cpu,))


def median_of(values: Any) -> dict[str, float]:
    """Return the median of values with their least and greatest."""
    return {"value": statistics.median(values), "low": min(values), "high": max(values)}


def measure(config: Config) -> tuple[dict[str, Any], list[Table]]:
    """Return the rows of all peers, those that are faster than ours first, and their table."""
    failed = install(config.environment)
    result: dict[str, Any] = {"machine": machine(), "cache": "given" if "TURTLEBOT_GYM_CACHE_DIR" in os.environ else "empty"}
    result |= {"projects": versions(config.environment / "bin" / "python")}
    rows, others = [], []
    for ours, peers in each(PEERS.items(), "peers"):
        found, used = compared(ours, peers, config, failed)
        rows += found
        others.append(used)
    rows.sort(key=lambda row: row["ratio"]["value"])
    table = Table(
        "environment", "number", "ns a step", "ours", "ns a step", "times ours", "in the rounds", title="CPU, one core"
    )
    for row in rows:
        theirs, mine = (f"{row[side]['cpu']['value']:,.0f}" for side in ("peer_ns", "ours_ns"))
        low, high = row["ratio"]["low"], row["ratio"]["high"]
        table.add_row(
            row["peer"], f"{row['size']}", theirs, row["ours"], mine, f"{row['ratio']['value']:.2f}", f"{low:.2f} to {high:.2f}"
        )
    for name, cause in failed.items():
        print(f"{name} was not measured: {cause}", file=sys.stderr)
    return {**result, "used_by_others": others, "rows": rows, "failed": failed}, [table]


if __name__ == "__main__":
    run(Config, measure, beside=__file__)
