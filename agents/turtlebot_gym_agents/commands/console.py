"""Shared by the commands: progress on standard error, figures, and what to install."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from turtlebot_gym.files import replacing

if TYPE_CHECKING:
    from matplotlib.figure import Figure


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
        yield lambda completed: bar.update(task, completed=completed)


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure, which is replaced atomically; its folder is created if missing."""
    with replacing(path) as beside:
        figure.savefig(beside, dpi=120)
