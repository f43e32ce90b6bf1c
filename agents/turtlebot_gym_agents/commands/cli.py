"""The command line, ``turtlebot-gym``: one dataclass for each subcommand, whose fields are its options.

To add one: write a frozen dataclass with a docstring under each field and a ``run`` method, and name it in `COMMANDS`. Results
go to standard output, progress and errors to standard error. What is heavy to import is imported in ``run``.
"""

from __future__ import annotations

import itertools
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import tyro

from turtlebot_gym_agents.commands.benchmark import Benchmark
from turtlebot_gym_agents.commands.calibrate import Calibrate
from turtlebot_gym_agents.commands.console import File, print_tables, progress, save_figure, write_json
from turtlebot_gym_agents.commands.driven import Driven
from turtlebot_gym_agents.commands.filters import Estimate, Replay
from turtlebot_gym_agents.commands.learning import Export, Train, Tune
from turtlebot_gym_agents.commands.placement import Placement
from turtlebot_gym_agents.commands.study import Study
from turtlebot_gym_agents.commands.tune_baseline import TuneBaseline
from turtlebot_gym_agents.commands.watch import Watch

if TYPE_CHECKING:
    from turtlebot_gym_agents.evaluation.evaluate import Evaluation


class Command(Protocol):
    """A subcommand, with the options that it was given."""

    def run(self) -> None:
        """Do it."""
        ...


@dataclass(frozen=True, kw_only=True)
class Evaluate(Driven, Placement):
    """Drive policies on the same seeds, and tell how well they do.

    Evaluates every combination of policy, noise and observation.
    """

    policy: tuple[str, ...] = ("proportional", "bearing")
    """Baselines (proportional, bearing, corner, polar, rotate-drive-rotate; for rooms vfh, gap, dwa), tuned ones (FILE.json),
    those that come with the package (ppo-nav, ppo-pose, ppo-square, ppo-rooms), bundles (FILE.onnx), or module:callable for
    one of your own. In rooms also oracle, which knows the map, and NAME+safety, within a safety layer."""
    noise: tuple[str, ...] = ("tutorial",)
    """Noise presets: clean, tutorial, documented, wheel, rough, or a file of your own (FILE.yaml)."""
    observation: tuple[str, ...] = ("ekf",)
    """What policies are shown as the robot's pose: ekf, odometry, truth."""
    episodes: int = 1000
    """Episodes of each combination; episode i has the seed SEED + i."""
    json: File = None
    """Write configuration, results and every episode's numbers here."""
    plot: File = None
    """Draw the first episode here; of several combinations, their paths."""

    def run(self) -> None:
        """Evaluate, print tables, and write what is asked for."""
        from turtlebot_gym_agents.commands import report

        combinations = list(itertools.product(self.policy, self.noise, self.observation))
        if not combinations:
            raise ValueError("policy, noise and observation must name at least one each.")
        names, common = ("policy", "noise", "observation"), {"env": self.env, "episodes": self.episodes, "seed": self.seed}
        asked = [common | dict(zip(names, one, strict=True)) | self.options() for one in combinations]
        with progress(self.episodes * len(combinations)) as advance_to:
            found = (self._spread if self.spread else self._here)(asked, advance_to)
        evaluations = dict(zip(itertools.starmap(self._label, combinations), found, strict=True))
        shared = [f"noise {self.noise[0]}"] if len(self.noise) == 1 else []
        title = ", ".join([self.env, f"{self.episodes} episodes from seed {self.seed}", f"robot {self.robot}", *shared])
        print_tables(*report.evaluation_tables(evaluations, title=title))
        if self.json is not None:
            runs = [
                {"label": label, "config": one.config, "summary": one.summary(), "episodes": one.episodes}
                for label, one in evaluations.items()
            ]
            write_json(self.json, {"runs": runs}, config=self.settings())
        if self.plot is not None:
            save_figure(report.evaluation_figure(evaluations, title=f"{self.env}, seed {self.seed}"), self.plot)

    def _here(self, asked: list[dict[str, Any]], advance_to: Callable[[int], None]) -> list[Evaluation]:
        from turtlebot_gym_agents.evaluation.evaluate import evaluate

        self.require_cluster()
        return [
            evaluate(**one, progress=lambda ended, done=at * self.episodes: advance_to(done + ended))
            for at, one in enumerate(asked)
        ]

    def _spread(self, asked: list[dict[str, Any]], advance_to: Callable[[int], None]) -> list[Evaluation]:
        from turtlebot_gym_agents.cluster.units import Drive
        from turtlebot_gym_agents.cluster.work import evaluate_all

        with self.place(memory=Drive.memory) as place:
            return evaluate_all(asked, **place._asdict(), progress=advance_to)

    def _label(self, *names: str) -> str:
        """Return what tells a combination from the others."""
        choices = (self.policy, self.noise, self.observation)
        told = [name for name, given in zip(names, choices, strict=True) if len(given) > 1]
        return ", ".join(told or names[:1])


@dataclass(frozen=True, kw_only=True)
class Video(Driven):
    """Drive one episode, and write it as a GIF or an MP4: true pose, estimate with its ellipse, odometry and waypoints."""

    policy: str = "bearing"
    """Baselines (proportional, bearing, corner, polar, rotate-drive-rotate; for rooms vfh, gap, dwa), tuned ones (FILE.json),
    those that come with the package (ppo-nav, ppo-pose, ppo-square), bundles (FILE.onnx), or module:callable for one of your
    own; NAME+safety drives within a safety layer."""
    noise: str = "tutorial"
    """Noise preset: clean, tutorial, documented, wheel, rough, or a file of your own (FILE.yaml)."""
    observation: str = "ekf"
    """What the policy is shown as the robot's pose: ekf, odometry, truth."""
    out: Path = Path("episode.gif")
    """The file: *.gif, or *.mp4, which needs imageio-ffmpeg."""
    seed: int = 0
    """The episode's."""
    speed: float = 4.0
    """How much faster than the robot it plays."""
    fps: int = 20
    """Frames per second; of a GIF 1, 2, 4, 5, 10, 20, 25 or 50."""
    width: int = 640
    """Of the frames, pixels: even, from 160 to 640."""

    def run(self) -> None:
        """Record, and print what it has become."""
        from turtlebot_gym_agents.commands.video import record

        with progress(100) as advance_to:
            video = record(
                self.policy,
                self.out,
                env=self.env,
                seed=self.seed,
                speed=self.speed,
                fps=self.fps,
                width=self.width,
                progress=lambda steps, limit: advance_to(100 * steps // limit),
                noise=self.noise,
                observation=self.observation,
                **self.options(),
            )
        print(
            f"{self.out}: {video.duration:.1f} s, {video.size[0]} x {video.size[1]} pixels, {self.out.stat().st_size:,} bytes; "
            f"the episode took {video.time:.1f} s and ended {'in' if video.success else 'without'} success."
        )


COMMANDS: dict[str, type[Command]] = {
    "evaluate": Evaluate,
    "video": Video,
    "watch": Watch,
    "estimate": Estimate,
    "replay": Replay,
    "calibrate": Calibrate,
    "train": Train,
    "tune": Tune,
    "tune-baseline": TuneBaseline,
    "export": Export,
    "study": Study,
    "benchmark": Benchmark,
}
"""Subcommands by name."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run a subcommand, and return the exit status: 0, or 2 with one line of explanation if what was asked is not possible.

    A command that checks something leaves by `SystemExit` with status 1 where it found a fault.

    Args:
        argv: Arguments; those of the process if not told.
    """
    command = tyro.extras.subcommand_cli_from_dict(
        dict(COMMANDS),
        prog="turtlebot-gym",
        description="A TurtleBot that navigates on what a Kalman filter believes.",
        args=argv,
    )
    sys.path.append(str(Path.cwd()))  # for policies of one's own, which a console script would not find
    try:
        command.run()
    except (ValueError, OSError, ImportError) as error:
        print(f"turtlebot-gym: {' '.join(str(error).split())}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    return 0
