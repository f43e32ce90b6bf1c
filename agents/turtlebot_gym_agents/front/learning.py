"""Policies trained with Stable-Baselines3: ``train``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import tyro
from numpy.typing import NDArray

from turtlebot_gym import Options
from turtlebot_gym.config import as_int, choose
from turtlebot_gym_agents.commands.console import needs, save_figure
from turtlebot_gym_agents.evaluation import metrics
from turtlebot_gym_agents.figures import LEARNING, learning_figure, plot_learning
from turtlebot_gym_agents.flags import Text, takes
from turtlebot_gym_agents.front.results import Result, axes_or_new, with_legend
from turtlebot_gym_agents.outputs import FIGURE, JSON, require_outputs
from turtlebot_gym_agents.training.config import RANDOMIZED, TrainingConfig, forget_run, require_no_run

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from rich.table import Table

    from turtlebot_gym_agents.training.train import TrainingResult

LAST = {*Options.__dataclass_fields__, *RANDOMIZED}
"""Flags that the help of `train` shows last: those of the environment, and of randomization."""
BUNDLE = "policy.onnx"
"""Name of the bundle in the folder of a run."""


@dataclass(frozen=True, kw_only=True, repr=False)
class Training(Result):
    """Trainings of one configuration, with a seed each.

    It prints as a table and a verdict. ``training["success"]`` is an array (seeds, evaluations), and ``training["steps"]`` the
    environment steps of the evaluations. `evaluate` and `compare` take it for the policy of its best seed.
    """

    config: TrainingConfig
    """Configuration of the first seed."""
    folders: Mapping[int, Path]
    """Folder of each seed's run."""
    results: Mapping[int, TrainingResult]
    """What each seed reached."""

    @property
    def name(self) -> str:
        """Folder of the runs, which names the policy in comparisons."""
        first = next(iter(self.folders.values()))
        return str(first.parent if len(self.folders) > 1 else first)

    @property
    def policy(self) -> Path:
        """Bundle of the seed with the highest return."""
        best = max(self.results, key=lambda seed: self.results[seed].best["return"])
        return self.folders[best] / BUNDLE

    @property
    def arrays(self) -> dict[str, NDArray[Any]]:
        """Figures of the evaluations, shape (seeds, evaluations), and their steps, which all seeds have in common."""
        histories = [result.history for result in self.results.values()]
        arrays = {name: np.array([[figures[name] for figures in history] for history in histories]) for name in LEARNING}
        return {"steps": np.array([figures["steps"] for figures in histories[0]]), **arrays}

    def rows(self) -> dict[str, Sequence[Any] | NDArray[Any]]:
        """Return a row per seed and evaluation."""
        rows = [{"seed": seed, **figures} for seed, result in self.results.items() for figures in result.history]
        return {name: [row[name] for row in rows] for name in ("seed", "steps", *LEARNING)}

    def tables(self) -> tuple[Table, ...]:
        """Return the table of `turtlebot-gym train`."""
        from rich.table import Table

        title = f"{self.config.env}, {self.config.algo}, the best model on the evaluation's seeds"
        table = Table("seed", "steps", "s", "steps/s", "success, %", "return", "steps to end", "policy", title=title)
        for (seed, result), folder in zip(self.results.items(), self.folders.values(), strict=True):
            best, speed = result.best, f"{result.steps / result.seconds:,.0f}"
            figures = (f"{100.0 * best['success']:.1f}", f"{best['return']:.2f}", f"{best['steps_to_end']:.1f}")
            table.add_row(str(seed), f"{result.steps:,}", f"{result.seconds:.1f}", speed, *figures, str(folder / BUNDLE))
        return (table,)

    def verdict(self) -> str:
        """Return how many of the goals the best models reach."""
        shares = [100.0 * result.best["success"] for result in self.results.values()]
        value, low, high = metrics.mean(shares)
        among = f"{min(shares):.1f} to {max(shares):.1f}" if min(shares) < max(shares) else f"{value:.1f}"
        said = f"The best models of {len(shares)} seeds reach" if len(shares) > 1 else "The best model reaches"
        said += f" the goal in {among} % of {self.config.episodes} episodes"
        if min(shares) < max(shares):
            said += f", {value:.1f} % on average (95 % interval over the seeds {max(low, 0.0):.1f} to {min(high, 100.0):.1f})"
        return f"{said}; the best: {self.policy}."

    def content(self) -> tuple[Mapping[str, Any], Mapping[str, Any]]:
        """Return what each seed reached, and the configuration."""
        runs = [{"seed": seed, "folder": self.folders[seed], **asdict(result)} for seed, result in self.results.items()]
        return {"runs": runs}, self.config.settings()

    def plot(self, axes: Axes | None = None, name: str = "success") -> Axes:
        """Draw the learning curves of a figure in `LEARNING`, and with several seeds their mean with its 95 % interval."""
        choose("name", name, {figure: figure for figure in LEARNING})
        runs = [result.history for result in self.results.values()]
        return with_legend(plot_learning(axes_or_new(axes), runs, measure=name))


@takes(TrainingConfig, "task", "env", last=LAST)
def train(
    env: Text = "nav",
    out: str | Path = "runs/nav",
    *,
    seeds: int = 1,
    cluster: str | None = None,
    workers: int | None = None,
    json: Path | None = None,
    plot: Path | None = None,
    force: bool = False,
    progress: tyro.conf.Suppress[bool] = True,
    callbacks: tyro.conf.Suppress[Any] = (),
    **options: Any,
) -> Training:
    """Train policies with Stable-Baselines3, and write each as a policy bundle, OUT/policy.onnx.

    For example ``train("nav", "runs/a", steps=200_000, seeds=3)``. On the command line a value is YAML, such as
    ``--reward "{effort: 0.2}"``, ``--overrides "{learning_rate: 3e-4}"``, ``--noise "{base: rough, odometry: {spike: 0.1}}"``.

    Args:
        env: Environment: nav, pose, square, rooms, missions, or the id of another one; in Python also a `TrainingConfig`, whose
            fields ``options`` then change.
        out: Folder of the run; each of several seeds has a folder seed-N in it.
        seeds: Number of seeds to train, from the option seed on.
        cluster: Where several seeds are trained: "local" for several processes, or the address of a Ray cluster.
        workers: With "local": number of processes, by default one per core.
        json: Write configuration and results here.
        plot: Draw here success and return over the steps; for several seeds their mean, with its 95 % interval.
        force: Overwrite files that exist, also those of a run in the folder.
        progress: Whether to show a bar.
        callbacks: Additional callbacks of Stable-Baselines3.
        **options: Fields of `TrainingConfig`: steps, algo, config (hyper-parameters), the environment's, and so on.

    Raises:
        ValueError: If an argument is unknown or out of its range, or the folder holds a run.
        ImportError: If Stable-Baselines3 is missing.
    """
    require_outputs([("--json", json, JSON), ("--plot", plot, FIGURE)], force=force)
    first = replace(env, **options) if isinstance(env, TrainingConfig) else TrainingConfig(env=env, **options)
    numbers = range(first.seed, first.seed + as_int("seeds", seeds, 1))
    folders = {number: Path(out) / f"seed-{number}" if seeds > 1 else Path(out) for number in numbers}
    for path in folders.values():
        if force:
            forget_run(path)
        require_no_run(path)
    with needs("agents"):
        from turtlebot_gym_agents.training.train import train as train_one
    if cluster or workers:
        from turtlebot_gym_agents.cluster.workers import run

        jobs = [partial(train_one, replace(first, seed=seed), path.resolve(), progress=False) for seed, path in folders.items()]
        results = dict(zip(folders, run(jobs, cluster, workers), strict=True))
    else:
        watched = {"progress": progress, "callbacks": callbacks}
        results = {seed: train_one(replace(first, seed=seed), path, **watched) for seed, path in folders.items()}
    trained = Training(config=first, folders=folders, results=results)
    if json is not None:
        trained.to_json(json)
    if plot is not None:
        histories = [result.history for result in results.values()]
        save_figure(learning_figure(histories, title=f"{first.env}, {first.algo}"), Path(plot))
    return trained
