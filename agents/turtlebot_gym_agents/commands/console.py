"""Shared by the commands: tables on standard output, progress on standard error, and options of dataclasses as commands."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from turtlebot_gym.files import replacing
from turtlebot_gym_agents.outputs import FIGURE, JSON
from turtlebot_gym_agents.provenance import write_json

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.table import Table

JsonFile = Annotated[Path | None, tyro.conf.arg(metavar="FILE.json"), JSON]
FigureFile = Annotated[Path | None, tyro.conf.arg(metavar="FILE.png"), FIGURE]
"""Options that name a file to write, see `outputs`; a figure may be a .pdf or .svg, too."""
WIDTH = 160
"""Width of a table in a file or a pipe, characters."""


@dataclass(frozen=True, kw_only=True)
class WritingOptions:
    """A command that writes files."""

    force: bool = False
    """Overwrite files that exist."""


@dataclass(frozen=True, kw_only=True)
class ReportingOptions(WritingOptions):
    """A command whose results can be written as JSON."""

    json: JsonFile = None
    """Write configuration and results here."""

    def settings(self) -> Mapping[str, Any]:
        """Return the options to record with results."""
        return {name: value for name, value in asdict(self).items() if name != "force"}

    def report(self, result: Mapping[str, Any], config: Mapping[str, Any] | None = None) -> None:
        """Write results, if requested, with their configuration, by default the `settings`."""
        if self.json is not None:
            write_json(self.json, result, config=self.settings() if config is None else config)


@contextmanager
def needs(extra: str) -> Iterator[None]:
    """Say what to install if an import fails."""
    try:
        yield
    except ModuleNotFoundError as error:
        raise ImportError(f"{error.name} is not installed: pip install 'turtlebot-gym[{extra}]'.") from error


@contextmanager
def progress(total: int) -> Iterator[Callable[..., None]]:
    """Show a progress bar on a terminal's standard error; yields the function that moves it."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    columns = (BarColumn(), TextColumn("{task.completed} of {task.total}"), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("", total=total)
        yield lambda completed, total=None: bar.update(task, completed=completed, total=total)


def print_tables(*tables: Table) -> None:
    """Print tables to standard output."""
    from rich.console import Console

    console = Console()
    (console if console.is_terminal else Console(width=WIDTH)).print(*tables)


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure, which is replaced atomically; its folder is created if missing."""
    with replacing(path) as beside:
        figure.savefig(beside, dpi=120)
