"""The subcommand ``train``."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import tyro

from turtlebot_gym.variants import flattened
from turtlebot_gym_agents.commands.console import (
    EnvironmentOptions,
    FigureFile,
    Placement,
    ReportingOptions,
    needs,
    print_tables,
    progress,
    save_figure,
)
from turtlebot_gym_agents.commands.flags import Learning
from turtlebot_gym_agents.commands.overrides import Hidden, phrase, unknown_key
from turtlebot_gym_agents.front.defaults import RUN, SEEDS
from turtlebot_gym_agents.outputs import FOLDER

if TYPE_CHECKING:
    from turtlebot_gym_agents.cluster.workers import Run
    from turtlebot_gym_agents.training.config import TrainingConfig
    from turtlebot_gym_agents.training.train import TrainingResult


@dataclass(frozen=True, kw_only=True)
class _LearningOptions(Learning, ReportingOptions, EnvironmentOptions):
    GROUP: ClassVar[str] = "learning"

    overrides: Hidden = field(default_factory=dict)
    """Hyper-parameters by name, with a dot if nested."""

    def training(self, **changes: Any) -> TrainingConfig:
        from turtlebot_gym_agents.training.config import TrainingConfig

        self.require_read(learning=True)
        names = {item.name for item in fields(TrainingConfig)} & {item.name for item in fields(self)}
        options = {name: value for name in names if (value := getattr(self, name)) is not None}
        return TrainingConfig(**self.varied(options) | changes)

    def take(self, name: str, unknown: Mapping[str, Any]) -> dict[str, Any]:
        """Return the hyper-parameters among the overrides; see `commands.overrides.Overridable.take`."""
        with needs("agents"):
            from turtlebot_gym_agents.training.arguments import ELSEWHERE, names_of
        known = names_of(self.algo)
        for key in unknown:
            if key in ELSEWHERE:
                raise ValueError(f"{key} is {ELSEWHERE[key]}.")
            if not any(key == one or key.startswith(f"{one}.") for one in known):
                raise unknown_key(type(self), name, key, known)
        return {"overrides": {**self.overrides, **unknown}}

    def described(self, *left_out: str) -> list[str]:
        """Return all that differs from the default, each as a phrase of a table's header, but for some options."""
        usual = {"robot": "burger", "noise": "tutorial", **{item.name: item.default for item in fields(Learning)}}
        names = [name for name in usual if getattr(self, name) != usual[name] and name not in ("algo", *left_out)]
        phrases = [f"{name.removesuffix('_policy')} {phrase(getattr(self, name))}".removesuffix(" True") for name in names]
        hyper = [f"{key} {phrase(value)}" for key, value in flattened(self.overrides)]
        return [*phrases, *super().described(*left_out), *hyper]


@dataclass(frozen=True, kw_only=True)
class Train(Placement, _LearningOptions):
    """Train policies with Stable-Baselines3, and write each as a policy bundle, OUT/policy.onnx."""

    COMMON: ClassVar = ("env", "algo", "steps", "seeds", "out", "robot", "noise", "filter", "world", "randomize")
    EXAMPLE: ClassVar = "reward.effort=0.2 learning_rate=3e-4 'policy_kwargs.net_arch=[32,32]' dt=0.05"

    out: Annotated[Path, FOLDER] = Path(RUN)
    """Folder of the run; each of several seeds has a folder seed-N in it."""
    seeds: int = SEEDS
    """Number of seeds to train."""
    until: Annotated[str | None, tyro.conf.arg(metavar="success=SHARE")] = None
    """Stop when an evaluation during training reaches this, success=SHARE or return=VALUE. Its --episodes are the same ones
    each time, and `evaluate` drives other ones. Schedules follow --steps."""
    plot: FigureFile = None
    """Draw here success and return over the steps; for several seeds their mean, with its 95 % interval."""
    wandb: Annotated[str | None, tyro.conf.arg(metavar="PROJECT")] = None
    """Send configuration and TensorBoard's curves to this project of Weights & Biases; needs the extra [wandb]."""

    def run(self) -> None:
        from turtlebot_gym_agents.front.learning import Training, folders_of, train, trainer
        from turtlebot_gym_agents.training.config import require_no_run

        folders, runner = folders_of(self.out, self.seed, self.seeds), self.runner()
        if self.wandb and self.spread:
            raise ValueError("wandb follows trainings in this process: leave out --cluster.")
        for folder in folders.values() if not self.spread else ():
            require_no_run(folder)
        config = self.training()
        with _loading(config):
            trainer()
        if self.spread:
            results = self._spread(config, folders, runner)
            trained = Training(config=config, folders=folders, results=dict(zip(folders, results, strict=True)))
        else:
            trained = train(config, self.out, seeds=self.seeds, within=self._tracked)
        title = ", ".join([self.env, self.algo, *self.described(), "the best model on the evaluation's seeds"])
        print_tables(*trained.tables(title=title))
        if ends := trained.ends():
            print(ends)
        self.report(trained.content()[0])
        if self.plot is not None:
            from turtlebot_gym_agents.figures import learning_figure

            histories = [result.history for result in trained.results.values()]
            save_figure(learning_figure(histories, title=f"{self.env}, {self.algo}"), self.plot)

    def resuming(self) -> str:
        """Return how to continue after an interruption."""
        return f"The same command continues: finished trainings are in {self.out}." if self.spread else ""

    def _spread(self, config: TrainingConfig, folders: dict[int, Path], runner: Run) -> list[TrainingResult]:
        from turtlebot_gym_agents.cluster.trainings import train_seeds

        if self.seeds == 1:
            raise ValueError("cluster trains several seeds at once: add --seeds.")
        with progress(self.seeds) as advance_to:
            return train_seeds(config, folders, run=runner, progress=advance_to)

    def _tracked(self, config: TrainingConfig, folder: Path) -> Any:
        """Return the context of a run of Weights & Biases, if requested, which reads what goes to TensorBoard."""
        if self.wandb is None:
            return nullcontext()
        with needs("wandb"):
            import wandb  # pyright: ignore[reportMissingImports]
        folder.mkdir(parents=True, exist_ok=True)
        return wandb.init(project=self.wandb, name=config.title, dir=folder, config=config.record(), sync_tensorboard=True)


@contextmanager
def _loading(config: TrainingConfig) -> Iterator[None]:
    """Load a training's compiled loops in a second thread during this block, which imports torch."""

    def load() -> None:
        import numpy as np

        from turtlebot_gym.compiled.threads import limited

        # The training reports errors of the configuration.
        with suppress(Exception), limited(config.threads):
            envs = config.make(1)
            envs.reset(seed=0)
            envs.step(np.zeros((1, 2), np.float32))
            envs.close()

    beside = threading.Thread(target=load)
    beside.start()
    try:
        yield
    finally:
        beside.join()
