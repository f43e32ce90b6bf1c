"""The command line, ``turtlebot-gym``: one dataclass per subcommand, whose fields are its options.

To add one: write a frozen dataclass with a docstring under each field and a ``run`` method, and name it in `COMMANDS`, or in
another package as an entry point of the group ``turtlebot_gym.commands``. Results go to standard output, progress and errors to
standard error. Heavy modules are imported in ``run``.
"""

from __future__ import annotations

import math
import sys
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

import tyro

from turtlebot_gym.entry_points import load_entry_point, loadable, names_in
from turtlebot_gym.notices import Notice
from turtlebot_gym.validation import choose
from turtlebot_gym_agents.commands.benchmark import Benchmark, Compile
from turtlebot_gym_agents.commands.bundles import Export, ShowCard
from turtlebot_gym_agents.commands.console import (
    DriveOptions,
    FigureFile,
    JsonFile,
    Placement,
    ReportingOptions,
    print_tables,
    progress,
    save_figure,
    write_anywhere,
)
from turtlebot_gym_agents.commands.flags import REGISTRY
from turtlebot_gym_agents.commands.help import help_of
from turtlebot_gym_agents.commands.learning import Train
from turtlebot_gym_agents.commands.overrides import extract, override
from turtlebot_gym_agents.commands.study import Study
from turtlebot_gym_agents.front.defaults import EPISODES, POLICIES
from turtlebot_gym_agents.outputs import inputs_of, outputs_of, require_outputs

if TYPE_CHECKING:
    from turtlebot_gym_agents.evaluation.result import Evaluation


class _CommandLine(Protocol):
    """A subcommand with its options."""

    def run(self) -> None: ...


@dataclass(frozen=True, kw_only=True)
class Evaluate(Placement, ReportingOptions, DriveOptions):
    """Drive policies on the same seeds and compare how well they do.

    Evaluates every combination of policy, noise, filter and observation.
    """

    COMMON: ClassVar = ("policy", "env", "episodes", "noise", "filter", "robot", "world", "json", "plot")
    EXAMPLE: ClassVar = "env=rooms world=office noise.odometry.spike=0.1 dt=0.05"

    policy: tuple[str, ...] = POLICIES
    """Policies: bearing, proportional, in rooms vfh and planner, ppo-nav, ppo-rooms, FILE.onnx, or MODULE:NAME of your own.
    Further baselines: corner, polar, rotate-drive-rotate; ones with other gains (FILE.yaml, FILE.json).
    Shipped with the package: ppo-nav, ppo-pose, ppo-square, ppo-rooms. In rooms also oracle, which knows the map, NAME+safety,
    within a safety layer, and NAME+yield, which stops for people."""
    noise: tuple[str, ...] = ("tutorial",)  # pyright: ignore[reportIncompatibleVariableOverride]
    """Noises: clean, tutorial, documented, wheel, rough, or FILE.yaml."""
    filter: tuple[str, ...] = ("matched",)  # pyright: ignore[reportIncompatibleVariableOverride]
    """Filters: matched, calibrated, tutorial, gated, FILE.yaml, or MODULE:NAME. With --imu also gyro."""
    observation: tuple[str, ...] = ("ekf",)  # pyright: ignore[reportIncompatibleVariableOverride]
    """What the policy observes: ekf, odometry, truth or located, with terms after it, see train --help-all."""
    episodes: int = EPISODES
    """Episodes of each combination; episode i has the seed SEED + i."""
    details: bool = False
    """Print all tables: also efficiency, effort, false arrivals and the errors of estimate and odometry."""
    json: JsonFile = None
    """Write configuration, results and the numbers of every episode here."""
    plot: FigureFile = None
    """Draw here the first episode of each combination, and NEES and NIS of all episodes with their bounds."""

    def run(self) -> None:
        from turtlebot_gym_agents.front.comparing import compare

        if not self.policy:
            raise ValueError("policy must name at least one value, got none.")
        axes: dict[str, Any] = self.axes()
        run = self._spread if self.spread else None
        self.runner()  # refuses workers without a cluster
        with progress(self.episodes * len(self.policy) * math.prod(map(len, axes.values()))) as advance_to:
            common: dict[str, Any] = {"env": self.env, "episodes": self.episodes, "seed": self.seed, "run": run}
            common |= {"progress": advance_to, "consistency": self.plot is not None}
            compared = compare(*self.policy, **common | self.options() | axes)
        shared = [f"noise {self.noise[0]}"] if len(self.noise) == 1 else []
        shared += self.described(*(name for name in _SETTINGS if len(getattr(self, name)) > 1))
        title = ", ".join([self.env, f"{self.episodes} episodes from seed {self.seed}", f"robot {self.robot}", *shared])
        print_tables(*compared.tables(title=title, details=self.details))
        print(compared.verdict())
        self.report(compared.content()[0])
        if self.plot is not None:
            save_figure(compared.paths(), self.plot)

    def axes(self) -> dict[str, list[Any]]:
        """Return the values of each option of which several are compared, with their changed fields."""
        return {name: [self.variant(name, value) for value in getattr(self, name)] for name in _SETTINGS}

    def resuming(self) -> str:
        """Return how to continue after an interruption."""
        return "Nothing was kept; a study keeps what is finished: turtlebot-gym study FILE.yaml."

    def _spread(self, requests: Sequence[Mapping[str, Any]], advance_to: Callable[[int], None]) -> list[Evaluation]:
        from turtlebot_gym_agents.cluster.drives import evaluate_all

        return evaluate_all(requests, run=self.runner(), progress=advance_to)


_SETTINGS = ("noise", "filter", "observation")
"""Options of which evaluate compares several."""
COMMANDS: dict[str, type[_CommandLine]] = {
    "evaluate": Evaluate,
    "train": Train,
    "export": Export,
    "card": ShowCard,
    "study": Study,
    "benchmark": Benchmark,
    "compile": Compile,
}
"""The product's subcommands by name; `commands` adds those of satellites."""
GROUP = "turtlebot_gym.commands"
"""Group of the entry points that name further subcommands."""


def commands() -> dict[str, type[_CommandLine]]:
    """Return all subcommands by name; an entry point that cannot be loaded is left out."""
    return COMMANDS | loadable(GROUP)


def main(argv: Sequence[str] | None = None) -> int:
    """Run a subcommand and return the exit status: 0, or 2 with one line of explanation if the request is invalid.

    A command that checks something raises `SystemExit` with status 1 if it found a fault.

    Args:
        argv: Arguments; None for those of the process.
    """
    with warnings.catch_warnings():
        warnings.showwarning = _as_text(warnings.showwarning)
        return _run(list(sys.argv[1:] if argv is None else argv))


def _run(words: list[str]) -> int:
    write_anywhere(sys.stdout, sys.stderr)
    if (here := str(Path.cwd())) not in sys.path:
        sys.path.append(here)  # for users' policies, which a console script would not find
    command: Any = None
    try:
        known = commands()
        if words and not words[0].startswith("-"):
            if words[0] not in known and words[0] in names_in(GROUP):
                load_entry_point(GROUP, words[0])  # raises the reason
            choose("command", words[0], known)
        if (text := help_of(known, words)) is not None:
            print(text)
            raise SystemExit(0)
        kept, pairs = extract(known[words[0]], words) if words and words[0] in known else (words, [])
        command = tyro.extras.subcommand_cli_from_dict(known, prog="turtlebot-gym", args=kept, registry=REGISTRY)
        command = override(command, words[0], pairs, kept) if pairs else command
        require_outputs(outputs_of(command), inputs=inputs_of(command), force=getattr(command, "force", False))
        if remark := getattr(command, "remark", str)():
            print(f"turtlebot-gym: {remark}", file=sys.stderr)
        command.run()
    except MemoryError:
        print("turtlebot-gym: there is not enough memory for this request.", file=sys.stderr)
        return 2
    except BrokenPipeError:
        raise  # see `process.ending_quietly`
    except (ValueError, OSError, ImportError) as error:
        print(f"turtlebot-gym: {' '.join(str(error).split())}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        resuming = getattr(command, "resuming", str)()
        print(f"turtlebot-gym: interrupted. {resuming}".rstrip(), file=sys.stderr)
        return 130
    return 0


def _as_text(show: Callable[..., None]) -> Callable[..., None]:
    """Return a function that prints a notice as one line, and shows other warnings by another function."""

    def shown(message: Any, category: type[Warning], *where: Any, **more: Any) -> None:
        if issubclass(category, Notice):
            print(f"turtlebot-gym: {message}", file=sys.stderr)
        else:
            show(message, category, *where, **more)

    return shown
