"""What every study does around its options and the function that measures."""

from __future__ import annotations

import inspect
import json
import re
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, TypeVar

import tyro
from rich.console import Console
from rich.progress import track
from rich.table import Table

from turtlebot_gym.files import write_text
from turtlebot_gym_agents.commands.console import print_tables
from turtlebot_gym_agents.provenance import plain, provenance, settings_of

Results = Mapping[str, Any]
Unit = TypeVar("Unit")


@dataclass(frozen=True, kw_only=True)
class Study:
    """Options of every study."""

    json: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """File for the results."""


Options = TypeVar("Options", bound=Study)


def run(
    options: type[Options], measure: Callable[[Options], tuple[Results | None, Sequence[Table]]], *, beside: str = ""
) -> tuple[Options, Any]:
    """Run a study from the command line: print its tables, write its results, and return its options and results.

    Args:
        options: Its options.
        measure: Returns the results, or None to write none, and tables. A ``config`` in results counts.
        beside: Module beside which results are written by default; "" for none.
    """
    default: dict[str, Any] = {"default": options(json=Path(beside).with_suffix(".json"))} if beside else {}
    config = tyro.cli(options, description=inspect.getdoc(inspect.getmodule(measure)), **default)
    results, tables = measure(config)
    print_tables(*tables)
    if config.json is not None and results is not None:
        write_summary(config.json, results, config)
    return config, results


def each(units: Iterable[Unit], label: str, number: int | None = None) -> Iterable[Unit]:
    """Yield units of work one by one, with their progress on standard error."""
    return track(units, label, number, console=Console(stderr=True))


def write_summary(path: Path, results: Results, config: Any, unread: Container[str] = ()) -> None:
    """Write what pages and tests read of results, with provenance: numbers keep six digits, and an interval is one line.

    Args:
        path: File.
        results: Results by name.
        config: Dataclass of the study's options.
        unread: Names in mappings that are left out.
    """

    def read(value: Any) -> Any:
        if isinstance(value, dict):
            return {name: read(part) for name, part in value.items() if name not in unread}
        if isinstance(value, list):
            return [read(part) for part in value]
        return float(f"{value:.6g}") if isinstance(value, float) else value

    whole = {"config": plain(settings_of(config)), **provenance(), **read(plain(results))}
    text = json.dumps(whole, indent=1, allow_nan=False)
    write_text(path, re.sub(r"[{][^][{}]*[}]", lambda found: " ".join(found[0].split()), text) + "\n")


def finished(
    judge: Callable[..., Results], wanted: Iterable[Sequence[Any]], kept: Path, names: Sequence[str], pool: Executor
) -> Iterator[dict[str, Any]]:
    """Yield the result of each unit of work, those of an earlier run first.

    Args:
        judge: Called in a process of the pool with the numbers of a unit; its result holds them by their names.
        wanted: Numbers of each unit.
        kept: File of the finished units, one on a line.
        names: Names of the numbers.
        pool: Its processes.
    """
    kept.parent.mkdir(parents=True, exist_ok=True)
    rows = [json.loads(line) for line in kept.read_text(encoding="utf-8").splitlines()] if kept.is_file() else []
    there = {tuple(row[name] for name in names): row for row in rows}
    units = list(map(tuple, wanted))
    yield from (there[unit] for unit in units if unit in there)
    futures = [pool.submit(judge, *unit) for unit in units if unit not in there]
    with kept.open("a", encoding="utf-8") as file:
        try:
            for future in as_completed(futures):
                row = plain(future.result())
                file.write(json.dumps(row) + "\n")
                file.flush()
                yield row
        finally:
            pool.shutdown(cancel_futures=True)
