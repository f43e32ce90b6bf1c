"""Shared by the subcommands: options, tables on standard output, progress on standard error."""

from __future__ import annotations

import codecs
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import tyro

from turtlebot_gym.files import replacing
from turtlebot_gym_agents.commands.flags import Environment
from turtlebot_gym_agents.commands.overrides import Overridable
from turtlebot_gym_agents.front.defaults import NAV, SEED
from turtlebot_gym_agents.ids import brought_by, environment_id
from turtlebot_gym_agents.outputs import FIGURE, JSON
from turtlebot_gym_agents.provenance import write_json

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.table import Table

    from turtlebot_gym_agents.cluster.workers import Run

File = Annotated[Path | None, tyro.conf.arg(metavar="FILE")]
"""An option that names a file to read."""
JsonFile = Annotated[Path | None, tyro.conf.arg(metavar="FILE.json"), JSON]
FigureFile = Annotated[Path | None, tyro.conf.arg(metavar="FILE.png"), FIGURE]
"""Options that name a file to write, see `outputs`; a figure may be a .pdf or .svg, too."""

REFERENCE = 0.1
"""The control interval by default, s."""
NARROWEST = 20
"""Least width of tables, characters."""


@dataclass(frozen=True, kw_only=True)
class WritingOptions:
    """A command that writes files."""

    GROUP: ClassVar[str] = "output"

    force: bool = False
    """Overwrite files that exist."""


@dataclass(frozen=True, kw_only=True)
class ReportingOptions(WritingOptions):
    """A command whose results can be written as JSON."""

    GROUP: ClassVar[str] = "output"

    json: JsonFile = None
    """Write configuration and results here."""

    def settings(self) -> Mapping[str, Any]:
        """Return the options to record with results."""
        return {name: value for name, value in asdict(self).items() if name != "force"}

    def report(self, result: Mapping[str, Any], config: Mapping[str, Any] | None = None) -> None:
        """Write results, if requested, with their configuration, by default the `settings`."""
        if self.json is not None:
            write_json(self.json, result, config=self.settings() if config is None else config)


@dataclass(frozen=True, kw_only=True)
class _EpisodeOptions:
    GROUP: ClassVar[str] = "task"

    env: str = NAV
    """Environment: nav, pose, square, rooms, missions, or the id of another one. These are short for
    turtlebot_gym/TurtleBotNav-v0 and so on."""
    seed: int = SEED
    """The first seed."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "env", environment_id(self.env))


@dataclass(frozen=True, kw_only=True)
class EnvironmentOptions(Environment, _EpisodeOptions, Overridable):
    """Environment, filter, robot and seeds of a command; what the id brings is the default."""

    def __post_init__(self) -> None:
        super().__post_init__()
        brought = brought_by(self.env)
        for item in fields(Environment):
            usual = getattr(type(self), item.name, item.default)
            if item.name in brought and getattr(self, item.name) == usual:
                value = brought[item.name]
                object.__setattr__(self, item.name, (value,) if isinstance(usual, tuple) else value)

    def options(self, **chosen: Any) -> dict[str, Any]:
        """Return the keyword arguments of the environment, of which some are chosen here."""
        self.require_read()
        values = {item.name: getattr(self, item.name) for item in fields(Environment)} | chosen
        return self.varied({name: value for name, value in values.items() if value is not None})

    def described(self, *left_out: str) -> list[str]:
        """Return all that differs from the default, each as a phrase of a table's header, but for some options."""
        return [*super().described(*left_out), *self.changed()]

    def remark(self) -> str:
        """Return what another control interval means for the limit of an episode; empty if there is none."""
        if self.dt == REFERENCE or not self.dt > 0.0 or "max_steps" in self.changes.get("task", ()):
            return ""
        from turtlebot_gym_agents.training.config import require_env, steps_of

        steps = steps_of(require_env(self.env))
        if steps is None:
            return ""
        kept = f"task.max_steps={round(steps * REFERENCE / self.dt)} keeps {steps * REFERENCE:g} s"
        return f"with dt {self.dt:g} s an episode of {steps} steps lasts at most {steps * self.dt:g} s; {kept}."


@dataclass(frozen=True, kw_only=True)
class DriveOptions(EnvironmentOptions):
    """Environment, task and robot of a drive."""

    GROUP: ClassVar[str] = "robot and noise"

    friction: float | None = None
    """Plant mujoco only: coefficient of friction between wheels and floor; by default 1, which grips."""
    caster_friction: float | None = None
    """Plant mujoco only: the same between caster and floor; by default 0.05. For a slippery floor use --friction 0.5
    --caster-friction 0.3."""
    allow_mismatch: bool = False
    """Also drive policies made for another task, observation, robot or rate."""

    def options(self, **chosen: Any) -> dict[str, Any]:
        """Return the keyword arguments of the environment, and whether a policy for another task may drive."""
        from turtlebot_gym.plants import make_plant

        if self.reward is not None:
            raise ValueError("reward changes nothing here, where nothing learns: leave it out.")
        options = super().options(**chosen)
        frictions = {"friction": self.friction, "caster_friction": self.caster_friction}
        changed = {name: value for name, value in frictions.items() if value is not None}
        plant = make_plant({"base": options["plant"], **changed} if changed else options["plant"])
        return options | {"plant": plant or self.plant, "allow_mismatch": self.allow_mismatch}

    def described(self, *left_out: str) -> list[str]:
        """Return all that differs from the default, each as a phrase of a table's header, but for some options."""
        frictions = {"friction": self.friction, "caster_friction": self.caster_friction}
        return [
            *super().described(*left_out),
            *(f"{name} {value:g}" for name, value in frictions.items() if value is not None),
        ]


@dataclass(frozen=True, kw_only=True)
class Placement:
    """Where the work runs; results do not depend on it."""

    GROUP: ClassVar[str] = "output"

    cluster: str | None = None
    """Run the work in several processes: "local" for one per core of this machine; with the extra [cluster], "auto" for the Ray
    cluster that this machine belongs to, or the ADDRESS of one, HOST:PORT."""
    workers: int | None = None
    """With --cluster local: number of workers."""

    @property
    def spread(self) -> bool:
        """Whether the work runs elsewhere than in this process."""
        return self.cluster is not None

    def runner(self) -> Run:
        """Return the function that runs jobs; a ValueError refuses workers without a cluster."""
        from turtlebot_gym_agents.cluster.workers import require_workers, results

        require_workers(self.cluster, self.workers)
        return partial(results, cluster=self.cluster, workers=self.workers)

    def settings(self) -> Mapping[str, Any]:
        """Return the options that results depend on."""
        elsewhere = {item.name for item in fields(Placement)} | {"json", "plot", "storage", "force", "wandb"}
        return {name: value for name, value in asdict(self).items() if name not in elsewhere}


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


def print_tables(*tables: Table, keys: int | None = None) -> None:
    """Print tables to standard output, in parts where one is too wide for the terminal.

    A file or a pipe is 160 characters wide, unless the environment variable COLUMNS says otherwise.

    Args:
        tables: What to print.
        keys: Number of columns that identify a row, see `tables.fitted`.
    """
    from rich.console import Console

    from turtlebot_gym_agents.commands.tables import fitted

    console = Console()
    has_width = console.is_terminal or os.environ.get("COLUMNS", "0") != "0"
    width = max(console.width, NARROWEST) if has_width else 160
    Console(width=width).print(*(part for table in tables for part in fitted(table, width, keys=keys)))


def write_anywhere(*streams: Any) -> None:
    """Let streams write in ASCII what their encoding lacks, so that no result is lost to an error at the end."""

    def in_ascii(error: Any) -> str:
        return "".join("+-" if sign == "\u00b1" else "?" for sign in error.object[error.start : error.end])

    codecs.register_error("turtlebot_gym", lambda error: (in_ascii(error), error.end))  # type: ignore[attr-defined]
    for stream in streams:
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="turtlebot_gym")


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure, which is replaced atomically; its folder is created if missing."""
    with replacing(path) as beside:
        figure.savefig(beside, dpi=120)
