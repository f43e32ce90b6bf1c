"""The command line, ``turtlebot-gym``: one dataclass for each subcommand, whose fields are its options.

To add one: write a frozen dataclass with a docstring under each field and a ``run`` method, and name it in `COMMANDS`. Results
go to standard output, progress and errors to standard error. What is heavy to import is imported in ``run``.
"""

from __future__ import annotations

import itertools
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import tyro

from turtlebot_gym.plants import make_plant
from turtlebot_gym_agents.commands.calibrate import Calibrate
from turtlebot_gym_agents.commands.console import ROOMS, File, Setting, print_tables, progress, save_figure
from turtlebot_gym_agents.commands.filters import Estimate, Replay
from turtlebot_gym_agents.commands.learning import Export, Train, Tune
from turtlebot_gym_agents.commands.tune_baseline import TuneBaseline
from turtlebot_gym_agents.provenance import write_json

if TYPE_CHECKING:
    from turtlebot_gym_agents.evaluation.evaluate import Evaluation


class Command(Protocol):
    """A subcommand, with the options that it was given."""

    def run(self) -> None:
        """Do it."""
        ...


@dataclass(frozen=True, kw_only=True)
class _Driven(Setting):
    """What is driven, and where."""

    switch: str | None = None
    """Square only: the next waypoint comes on "arrival", or after a "time" of 15 s."""
    laps: int | None = None
    """Square only: how often it is driven."""
    delay: int = 0
    """Steps by which commands come late."""
    plant: str = "unicycle"
    """What moves the robot: unicycle, or mujoco, a Burger with wheels that creep and slip, which needs the extra [mujoco]."""
    friction: float | None = None
    """With the plant mujoco only: coefficient of friction between wheels and floor; by default 1, which grips."""
    caster_friction: float | None = None
    """Likewise, between caster and floor; by default 0.05. A slippery floor is --friction 0.5 --caster-friction 0.3."""

    def options(self) -> dict[str, Any]:
        """Return the environment's keyword arguments."""
        given: dict[str, Any] = {name: value for name in ("switch", "laps") if (value := getattr(self, name)) is not None}
        if self.env == ROOMS and given:
            raise ValueError(f"switch and laps are for tasks with given waypoints, not for {ROOMS}.")
        plant = make_plant(self.plant, friction=self.friction, caster_friction=self.caster_friction)
        if plant:
            if self.env == ROOMS:
                raise ValueError(f"plant must be 'unicycle' for {ROOMS}: in MuJoCo there is open ground alone.")
            given["plant"] = plant
        return {name: getattr(self, name) for name in ("filter", "robot", "arrival", "delay")} | self.given() | given


@dataclass(frozen=True, kw_only=True)
class Evaluate(_Driven):
    """Drive policies on the same seeds, and tell how well they do.

    Of policies, noises and observations each combination is evaluated.
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
        from turtlebot_gym_agents.evaluation.evaluate import evaluate

        combinations = list(itertools.product(self.policy, self.noise, self.observation))
        if not combinations:
            raise ValueError("policy, noise and observation must name at least one each.")
        evaluations: dict[str, Evaluation] = {}
        with progress(self.episodes * len(combinations)) as advance_to:
            for at, (policy, noise, observation) in enumerate(combinations):
                evaluations[self._label(policy, noise, observation)] = evaluate(
                    policy,
                    env=self.env,
                    episodes=self.episodes,
                    seed=self.seed,
                    progress=lambda ended, done=at * self.episodes: advance_to(done + ended),
                    noise=noise,
                    observation=observation,
                    **self.options(),
                )
        shared = [f"noise {self.noise[0]}"] if len(self.noise) == 1 else []
        title = ", ".join([self.env, f"{self.episodes} episodes from seed {self.seed}", f"robot {self.robot}", *shared])
        print_tables(*report.evaluation_tables(evaluations, title=title))
        if self.json is not None:
            runs = [
                {"label": label, "config": one.config, "summary": one.summary(), "episodes": one.episodes}
                for label, one in evaluations.items()
            ]
            write_json(self.json, {"runs": runs}, config=asdict(self))
        if self.plot is not None:
            save_figure(report.evaluation_figure(evaluations, title=f"{self.env}, seed {self.seed}"), self.plot)

    def _label(self, *names: str) -> str:
        """Return what tells a combination from the others."""
        choices = (self.policy, self.noise, self.observation)
        told = [name for name, given in zip(names, choices, strict=True) if len(given) > 1]
        return ", ".join(told or names[:1])


@dataclass(frozen=True, kw_only=True)
class Video(_Driven):
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


@dataclass(frozen=True, kw_only=True)
class Watch(_Driven):
    """Show drives in a browser: an episode of each policy, side by side, or recorded drives. Play, pause, scrub.

    The live ROS graph is shown by "python -m turtlebot_gym_ros watch". Needs the extra [watch].
    """

    policy: tuple[str, ...] = ("bearing",)
    """Policies, as for evaluate; each drives the same episode."""
    noise: str = "tutorial"
    """Noise preset: clean, tutorial, documented, wheel, rough, or a file of your own (FILE.yaml)."""
    observation: str = "ekf"
    """What policies are shown as the robot's pose: ekf, odometry, truth."""
    seed: int = 0
    """The episode's."""
    drive: tuple[Path, ...] = ()
    """Recorded drives instead of episodes: bags, snapshots.csv of data_logger, or tables as replay takes them."""
    html: File = None
    """Write the view to this file, which opens without a server or a network, instead of serving it."""
    host: str = "localhost"
    """Name or address to listen on; 0.0.0.0 shows the view to everybody who reaches this machine."""
    port: int = 5006
    """Port to listen on; 0 for any that is free."""

    def run(self) -> None:
        """Record or read the drives, and write or serve the view."""
        from turtlebot_gym_agents.watch import read_recorded, record_episode

        with _needs("watch"):
            from turtlebot_gym_agents.watch.html import write_html
            from turtlebot_gym_agents.watch.server import serve
        if self.drive:
            tracks = [read_recorded(path, lidar=self.lidar or "lds01") for path in self.drive]
            title = f"Recorded: {', '.join(path.name for path in self.drive)}"
        else:
            told = {"noise": self.noise, "observation": self.observation, **self.options()}
            tracks = [record_episode(policy, env=self.env, seed=self.seed, **told) for policy in self.policy]
            title = ", ".join([self.env.partition("/")[2], *self.given().values(), f"seed {self.seed}", f"noise {self.noise}"])
        if self.html is not None:
            print(f"{self.html}: {write_html(tracks, self.html, title=title):,} bytes; open it in a browser.")
            return
        serve(tracks, title=title, host=self.host, port=self.port)


@contextmanager
def _needs(extra: str) -> Iterator[None]:
    """Say what to install where an import fails."""
    try:
        yield
    except ModuleNotFoundError as error:
        raise ImportError(f"{error.name} is not installed: pip install 'turtlebot-gym[{extra}]'.") from error


@dataclass(frozen=True, kw_only=True)
class Benchmark:
    """Measure the speed of environments, adapter and training, as ratios in one run."""

    num_envs: int = 4096
    """Size of the vector environments."""
    rounds: int = 7
    """How often each contender has its turn."""
    seconds: float = 0.5
    """How long a turn takes, s."""
    training: bool = True
    """Whether to measure training too; it needs the extra [agents]."""
    json: File = None
    """Write the results here."""

    def run(self) -> None:
        """Measure, print tables, and write what is asked for."""
        from turtlebot_gym_agents.commands import report, speed

        result = {"machine": speed.machine()}
        result["environments"] = speed.environments(num_envs=self.num_envs, rounds=self.rounds, seconds=self.seconds)
        if self.training:
            result |= {"adapter_ns": speed.adapter(rounds=self.rounds), "training": speed.training()}
        print_tables(*report.speed_tables(result))
        if self.json is not None:
            write_json(self.json, result, config=asdict(self))


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
    "benchmark": Benchmark,
}
"""Subcommands by name."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run a subcommand, and return the exit status: 0, or 2 with one line of explanation if what was asked is not possible.

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
