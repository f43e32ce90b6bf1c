"""The subcommands that learn: ``train``, ``tune`` and ``export``."""

from __future__ import annotations

import json as json_format
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tyro
from rich.console import Console
from rich.table import Table

from turtlebot_gym_agents.commands.console import File, Setting, print_tables
from turtlebot_gym_agents.provenance import write_json

if TYPE_CHECKING:
    from turtlebot_gym_agents.training.train import TrainingConfig


@dataclass(frozen=True, kw_only=True)
class _Learned(Setting):
    """What is driven, and by what it learns."""

    algo: str = "ppo"
    """ppo, sac or td3; others of Stable-Baselines3 with a FILE of hyper-parameters."""
    noise: str = "tutorial"
    """Noise preset: clean, tutorial, documented, wheel, rough, or a file of your own (FILE.yaml)."""
    observation: str = "ekf"
    """What the policy is shown as the robot's pose: ekf, odometry, truth."""
    delay: int = 0
    """Steps by which commands come late."""
    randomize: bool = False
    """Let noise, speed scale and delay (in rooms: world and LiDAR, too) differ from environment to environment; those given are
    then the evaluation's."""
    speed_error: float = 0.02
    """With --randomize: greatest error of the executed speed, as a share of it; the filter does not know it. On a
    slippery floor wheels lose a tenth."""
    config: File = None
    """Hyper-parameters, YAML in the form of rl-baselines3-zoo; without it, those that come with the package."""
    steps: int | None = None
    """Environment steps; n_timesteps of the hyper-parameters if not told."""
    json: File = None
    """Write configuration and results here."""

    def training(self, **changes: Any) -> TrainingConfig:
        """Return the configuration of a training."""
        from turtlebot_gym_agents.training.train import TrainingConfig

        self.given()
        names = {item.name for item in fields(TrainingConfig)} & {item.name for item in fields(_Learned)}
        return TrainingConfig(**{name: getattr(self, name) for name in names} | changes)


@dataclass(frozen=True, kw_only=True)
class Train(_Learned):
    """Train policies with Stable-Baselines3, and leave each as a policy bundle, OUT/policy.onnx."""

    out: Path = Path("runs/nav")
    """Folder of the run; of several seeds, each has a folder seed-N in it."""
    seeds: int = 1
    """How many seeds to train."""
    resume: bool = False
    """Go on from the folder's checkpoints."""
    evaluations: int = 8
    """How often the policy is evaluated on the way."""
    watch: bool = False
    """Show the current policy in a browser every few seconds, at localhost:5006; needs the extra [watch]."""

    def run(self) -> None:
        """Train, print a table, and write what is asked for."""
        with _needs_agents():
            from turtlebot_gym_agents.training.train import train
        if not self.seeds > 0:
            raise ValueError(f"seeds must be positive, got {self.seeds}.")
        table = Table(
            "seed", "steps", "s", "steps/s", "success, %", "return", "steps to end", "policy",
            title=f"{self.env}, {self.algo}, the best model on the evaluation's seeds",
        )  # fmt: skip
        runs = []
        for seed in range(self.seed, self.seed + self.seeds):
            folder = self.out / f"seed-{seed}" if self.seeds > 1 else self.out
            config = self.training(seed=seed, evaluations=self.evaluations)
            result = train(config, folder, resume=self.resume, callbacks=self._watching(config))
            best = result.best
            table.add_row(
                str(seed),
                f"{result.steps:,}",
                f"{result.seconds:.1f}",
                f"{result.steps_per_second:,.0f}",
                f"{100.0 * best['success']:.1f}",
                f"{best['return']:.2f}",
                f"{best['steps_to_end']:.1f}",
                str(folder / "policy.onnx"),
            )
            runs.append({"seed": seed, "folder": folder, **asdict(result)})
        print_tables(table)
        if self.json is not None:
            write_json(self.json, {"runs": runs}, config=asdict(self))

    def _watching(self, config: TrainingConfig) -> list[Any]:
        """Return the callback that shows the policy, if that is asked for."""
        if not self.watch:
            return []
        try:
            from turtlebot_gym_agents.training.watching import WatchCallback
        except ModuleNotFoundError as error:
            raise ImportError(f"{error.name} is not installed: pip install 'turtlebot-gym[watch]'.") from error
        return [WatchCallback(config)]


@dataclass(frozen=True, kw_only=True)
class Tune(_Learned):
    """Search for hyper-parameters with Optuna, and leave the best as OUT/best.yaml, for train --config.

    A search that was stopped goes on when the same is asked for again.
    """

    out: Path = Path("runs/tune")
    """Folder of the study."""
    trials: int = 50
    """How many finished trials the study is to have, earlier ones included."""

    def run(self) -> None:
        """Search, print a table, and write what is asked for."""
        with _needs_agents():
            from turtlebot_gym_agents.training.tuning import tune
        console = Console(stderr=True)
        with console.status("") as status:
            study = tune(
                self.training(),
                self.out,
                trials=self.trials,
                progress=lambda ended: status.update(f"{ended} of {self.trials} trials"),
            )
        complete = [trial for trial in study.trials if trial.value is not None]
        complete.sort(key=lambda trial: -(trial.value or 0.0))
        table = Table("trial", "return", "hyper-parameters", title=f"{self.env}, {self.algo}: the best of {len(study.trials)}")
        for trial in complete[:5]:
            table.add_row(str(trial.number), f"{trial.value:.3f}", ", ".join(f"{k} {v}" for k, v in trial.params.items()))
        print_tables(table)
        if self.json is not None:
            trials = [
                {"number": one.number, "state": one.state.name, "return": one.value, "parameters": one.params}
                for one in study.trials
            ]
            write_json(self.json, {"trials": trials}, config=asdict(self))


@dataclass(frozen=True, kw_only=True)
class Export:
    """Make a policy bundle of a model that Stable-Baselines3 has saved, and check that both do the same.

    What it was trained for is read from the config.json that training leaves beside it; else it has to be told.
    """

    model: tyro.conf.Positional[Path]
    """The model, a zip file."""
    out: Path = Path("policy.onnx")
    """The bundle."""
    allow_pickle: bool = False
    """Loading a zip file can run any code that is in it: say that you trust it."""
    env: str | None = None
    """The environment's id."""
    robot: str | None = None
    """burger, waffle, turtlebot4, tutorial, or a file of your own (FILE.yaml)."""
    rate: float | None = None
    """Commands per second; 10 if nothing else is known."""
    noise: str | None = None
    """Noise preset."""
    filter: str | None = None
    """The filter's tuning."""
    observation: str | None = None
    """What the policy is shown as the robot's pose."""

    def run(self) -> None:
        """Export, and print how far the two differ."""
        with _needs_agents():
            from turtlebot_gym_agents.policies.bundle import Card
            from turtlebot_gym_agents.policies.fit import describe_robot
            from turtlebot_gym_agents.training.export import export, load_model
            from turtlebot_gym_agents.training.train import TrainingConfig

        model = load_model(self.model, allow_pickle=self.allow_pickle)
        beside = self.model.parent / "config.json"
        record = json_format.loads(beside.read_text(encoding="utf-8")) if beside.is_file() else {}
        default = asdict(TrainingConfig()) | record.get("config", {})

        def told(name: str) -> Any:
            given = getattr(self, name)
            return default[name] if given is None else given

        robot = told("robot")
        card = Card(
            env=told("env"),
            robot=describe_robot(robot) if isinstance(robot, str) else {"name": "custom", **robot},
            dt=0.1 if self.rate is None else 1.0 / self.rate,
            noise="randomized" if default["randomize"] and self.noise is None else told("noise"),
            filter=told("filter"),
            observation=told("observation"),
            training={**record, "steps": model.num_timesteps},
        )
        difference = export(model, self.out, card)
        Console().print(
            f"{self.out}: {self.out.stat().st_size:,} bytes; its actions differ from the model's by at most "
            f"{difference:.1g} on 10,000 observations."
        )


@contextmanager
def _needs_agents() -> Iterator[None]:
    """Say what to install where an import fails."""
    try:
        yield
    except ModuleNotFoundError as error:
        raise ImportError(f"{error.name} is not installed: pip install 'turtlebot-gym[agents]'.") from error
