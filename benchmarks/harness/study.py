"""What every study does around its measurements: keep finished work, show progress, and publish results."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, as_completed
from pathlib import Path
from typing import Any, TypeVar

from rich.console import Console
from rich.progress import track

from harness.tables import tables_of
from turtlebot_gym.files import write_text
from turtlebot_gym_agents.provenance import plain, provenance

Unit = TypeVar("Unit")


def each(units: Iterable[Unit], label: str, number: int | None = None) -> Iterable[Unit]:
    """Yield units of work one by one, with their progress on standard error."""
    return track(units, label, number, console=Console(stderr=True))


def publish(path: Path, results: Mapping[str, Any], options: Mapping[str, Any]) -> None:
    """Print the tables that pages show of a file's results, and write it, with provenance and the options that are no files."""
    given = {name: value for name, value in options.items() if not isinstance(value, Path)}
    whole = rounded(plain({"config": given, **provenance(), **results}))
    for title, text in tables_of(path.stem, whole).items():
        print(f"{title}\n\n{text}")
    text = json.dumps(whole, indent=1, allow_nan=False)
    write_text(path, re.sub(r"[{\[][^][{}]*[]}]", lambda found: " ".join(found[0].split()), text) + "\n")


def rounded(value: Any) -> Any:
    """Return a value of JSON types whose numbers have six digits."""
    if isinstance(value, dict):
        return {name: rounded(part) for name, part in value.items()}
    if isinstance(value, list):
        return [rounded(part) for part in value]
    return float(f"{value:.6g}") if isinstance(value, float) else value


def finished(
    judge: Callable[..., Mapping[str, Any]], units: Sequence[tuple[Any, ...]], kept: Path | None, names: str, pool: Executor
) -> Iterator[dict[str, Any]]:
    """Yield the result of each unit of work, which holds the unit's parts by their names; first those that are kept in a file.

    The judge is called with the parts of a unit, in a process of the pool, which ends with the iteration.
    """
    rows = [json.loads(line) for line in kept.read_text(encoding="utf-8").splitlines()] if kept and kept.is_file() else []
    there = {tuple(row[name] for name in names.split()): row for row in rows}
    yield from (there[unit] for unit in units if unit in there)
    futures = [pool.submit(judge, *unit) for unit in units if unit not in there]
    try:
        for future in as_completed(futures):
            row = plain(future.result())
            if kept:
                kept.parent.mkdir(parents=True, exist_ok=True)
                with kept.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(row) + "\n")
            yield row
    finally:
        pool.shutdown(cancel_futures=True)
