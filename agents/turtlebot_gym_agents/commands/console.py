"""What the subcommands share: options, tables on standard output, progress on standard error."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from turtlebot_gym_agents.outputs import FIGURE, JSON

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.table import Table

File = Annotated[Path | None, tyro.conf.arg(metavar="FILE")]
"""An option that names a file to read."""
JsonFile = Annotated[Path | None, tyro.conf.arg(metavar="FILE.json"), JSON]
FigureFile = Annotated[Path | None, tyro.conf.arg(metavar="FILE.png"), FIGURE]
"""Options that name a file to write, see `outputs`; a figure may be a .pdf or .svg, too."""


@dataclass(frozen=True, kw_only=True)
class Writing:
    """A command that writes files."""

    force: bool = False
    """Overwrite files that exist."""

    def asked(self) -> dict[str, Any]:
        """Return all options but ``force``, on which no result depends."""
        return {name: value for name, value in asdict(self).items() if name != "force"}


ROOMS = "turtlebot_gym/TurtleBotRooms-v0"


@dataclass(frozen=True, kw_only=True)
class Setting:
    """What is driven, and where."""

    env: str = "turtlebot_gym/TurtleBotNav-v0"
    """The environment's id: turtlebot_gym/TurtleBotNav-v0, .../TurtleBotPose-v0, .../TurtleBotSquare-v0 or
    .../TurtleBotRooms-v0."""
    filter: str = "matched"
    """The filter: matched, tutorial, gated, mixture, slip or scale."""
    robot: str = "burger"
    """burger, waffle, turtlebot4, tutorial, or a file of your own (FILE.yaml)."""
    world: str | None = None
    """Rooms only: clutter, dense, corridor, office, cellular, crowd, a Gazebo world (FILE.world) or a map (FILE.yaml)."""
    lidar: str | None = None
    """Rooms only: lds01, lds02, a1 or ideal."""
    fix: str | None = None
    """What measures the pose from outside, now and then: beacons, late, localization, markers, motion-capture, or a file of
    your own (FILE.yaml)."""
    arrival: str = "truth"
    """Whose arrival counts: that of the true pose ("truth"), or of the observed one ("belief"), as on a robot."""
    seed: int = 0
    """The first seed."""

    def given(self) -> dict[str, str]:
        """Return the keyword arguments that an environment need not be given.

        Raises:
            ValueError: If some that only rooms take are given for another environment.
        """
        given = {name: value for name in ("world", "lidar") if (value := getattr(self, name)) is not None}
        if given and self.env != ROOMS:
            raise ValueError(f"world and lidar are for {ROOMS}, not for {self.env}.")
        return given | ({} if self.fix is None else {"fix": self.fix})


@contextmanager
def needs(extra: str) -> Iterator[None]:
    """Say what to install where an import fails."""
    try:
        yield
    except ModuleNotFoundError as error:
        raise ImportError(f"{error.name} is not installed: pip install 'turtlebot-gym[{extra}]'.") from error


def require_installed(*modules: str, extra: str, without: str) -> None:
    """Say what to install before the work starts.

    Args:
        *modules: What the work needs.
        extra: What brings them.
        without: The option with which they are not needed.

    Raises:
        ImportError: If one is missing.
    """
    if missing := next((name for name in modules if find_spec(name) is None), None):
        raise ImportError(f"{missing} is not installed: pip install 'turtlebot-gym[{extra}]', or use {without}.")


@contextmanager
def progress(total: int) -> Iterator[Callable[..., None]]:
    """Show a progress bar on standard error, where that is a terminal; yields a function that moves it, and may tell another
    total."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    columns = (BarColumn(), TextColumn("{task.completed} of {task.total}"), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("", total=total)
        yield lambda completed, total=None: bar.update(task, completed=completed, total=total)


def print_tables(*tables: Table) -> None:
    """Print tables to standard output; into a file or a pipe in full width."""
    from rich.console import Console

    console = Console()
    Console(width=console.width if console.is_terminal else 160).print(*tables)


def write_json(path: Path, result: Mapping[str, Any], *, config: Mapping[str, Any]) -> None:
    """Write a result as `turtlebot_gym_agents.provenance.write_json` does."""
    from turtlebot_gym_agents import provenance

    provenance.write_json(path, result, config=config)


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure; its folder is made where it is missing."""
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=120)
