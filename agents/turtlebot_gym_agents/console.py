"""What the subcommands share: tables on standard output, progress on standard error."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

File = Annotated[Path | None, tyro.conf.arg(metavar="FILE")]
"""An option that names a file."""


@contextmanager
def progress(total: int) -> Iterator[Callable[[int], None]]:
    """Show a progress bar on standard error, where that is a terminal; yields a function that moves it."""
    console = Console(stderr=True)
    columns = (BarColumn(), TextColumn("{task.completed} of {task.total}"), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("", total=total)
        yield lambda completed: bar.update(task, completed=completed)


def print_tables(*tables: Table) -> None:
    """Print tables to standard output; into a file or a pipe in full width."""
    console = Console()
    Console(width=console.width if console.is_terminal else 160).print(*tables)
