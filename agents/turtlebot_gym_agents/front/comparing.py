"""Policies compared on the same seeds: ``compare``."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym import Options
from turtlebot_gym.config import as_int
from turtlebot_gym.plotting import BLUE
from turtlebot_gym_agents.commands.console import progress, save_figure
from turtlebot_gym_agents.evaluation.evaluate import evaluate, joined
from turtlebot_gym_agents.evaluation.metrics import Interval
from turtlebot_gym_agents.evaluation.result import Evaluation, title_of
from turtlebot_gym_agents.flags import Text, takes
from turtlebot_gym_agents.front.results import Result, axes_or_new, name_of
from turtlebot_gym_agents.ids import environment_id
from turtlebot_gym_agents.outputs import FIGURE, JSON, require_outputs

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from rich.table import Table

CHUNK = 250
"""Episodes of a job on a cluster; results do not depend on it."""
_VALUES = ("waypoints",)
"""Options that are lists themselves."""


@dataclass(frozen=True, kw_only=True, repr=False)
class Comparison(Result):
    """Evaluations on the same seeds.

    It prints as a table and a sentence for each comparison. ``comparison["success"]`` is an array (evaluations, episodes), and
    ``comparison["bearing"]`` the evaluation of that label.
    """

    evaluations: Mapping[str, Evaluation]
    """By label: all settings of the first policy, then of the next."""
    size: int = 1
    """Number of settings of each policy."""
    details: bool = False
    """Whether all tables are shown."""

    @property
    def arrays(self) -> dict[str, NDArray[Any]]:
        """The numbers of each evaluation, by name, shape (evaluations, episodes)."""
        each = [evaluation.arrays for evaluation in self.evaluations.values()]
        return {name: np.array([arrays[name] for arrays in each]) for name in each[0]}

    def rows(self) -> dict[str, Sequence[Any] | NDArray[Any]]:
        """Return a row per evaluation and episode."""
        labels = np.repeat([*self.evaluations], [len(each.episodes.seed) for each in self.evaluations.values()])
        return {"label": labels, **{name: array.ravel() for name, array in self.arrays.items()}}

    def tables(self) -> tuple[Table, ...]:
        """Return the tables of `turtlebot-gym evaluate`."""
        from turtlebot_gym_agents.commands.report import evaluation_tables

        return evaluation_tables(self.evaluations, title=self._title(), details=self.details)

    def verdict(self) -> str:
        """Return a sentence per comparison."""
        from turtlebot_gym_agents.commands.verdict import verdicts

        return "\n".join(verdicts(self.evaluations, size=self.size))

    def content(self) -> tuple[Mapping[str, Any], Mapping[str, Any]]:
        """Return the runs, and the first one's configuration."""
        runs = [
            {"label": label, "config": each.config, "summary": each.summary(), "episodes": each.episodes}
            for label, each in self.evaluations.items()
        ]
        return {"runs": runs}, runs[0]["config"]

    def plot(self, axes: Axes | None = None) -> Axes:
        """Draw what the table compares, with intervals: the goals of missions, else the time, else the waypoints reached."""
        summaries = {label: each.summary() for label, each in self.evaluations.items()}
        by_time = any(each.config.get("switch") == "time" for each in self.evaluations.values())
        name, label = "time", "time to the goal, a failure counted as the limit (s)"
        if all("goals_an_hour" in summary for summary in summaries.values()):
            name, label = "goals_an_hour", "goals truly reached (1/h)"
        elif by_time:
            name, label = "reached", "waypoints reached"
        intervals: dict[str, Interval] = {key: summary[name] for key, summary in summaries.items()}
        return _draw_intervals(axes_or_new(axes), intervals, label=label)

    def paths(self) -> Figure:
        """Return a figure of the first episode: one drive at a glance, or the paths of several."""
        from turtlebot_gym_agents.commands.report import evaluation_figure

        first = next(iter(self.evaluations.values())).config
        return evaluation_figure(self.evaluations, title=f"{first['env']}, seed {first['seed']}")

    def __getitem__(self, name: str) -> Any:
        """Return the evaluation of a label, or an array by its name."""
        return self.evaluations[name] if name in self.evaluations else Result.__getitem__(self, name)

    def _title(self) -> str:
        first, *others = (each.config for each in self.evaluations.values())
        return title_of(first, *(name for name in first if any(other.get(name) is not first[name] for other in others)))


@takes(Options, "task")
def compare(
    *policy: Text,
    env: str | None = None,
    episodes: int = 1000,
    seed: int = 0,
    allow_mismatch: bool = False,
    details: bool = False,
    cluster: str | None = None,
    workers: int | None = None,
    json: Path | None = None,
    plot: Path | None = None,
    force: bool = False,
    **options: Any,
) -> Comparison:
    """Drive policies on the same seeds, in every combination with the options that are lists.

    For example ``compare("bearing", "ppo-nav", filter=["matched", "gated"])``. A list gives the values of an option in turn; a
    tuple is one value, such as the terms of an observation. On the command line a value is YAML, and several are a list:
    ``--filter matched gated --noise "{base: rough, odometry: {spike: 0.1}}"``.

    Args:
        policy: bearing, proportional, in rooms vfh and planner, ppo-nav, ppo-rooms, FILE.onnx, MODULE:NAME of your own, and all
            that `evaluate` takes; by default the baselines proportional and bearing.
        env: Environment: nav, pose, square, rooms, missions, or the id of another one; by default rooms
            where a world or a LiDAR is given, otherwise nav.
        episodes: Episodes of each combination; episode i has the seed SEED + i.
        seed: The first seed.
        allow_mismatch: Also drive policies made for another task, observation, robot or rate.
        details: Show all tables: also efficiency, effort, false arrivals and the errors of estimate and odometry.
        cluster: Where the work runs: "local" for several processes, or the address of a Ray cluster; by default here.
        workers: With "local": number of processes, by default one per core.
        json: Write configuration, results and the numbers of every episode here.
        plot: Draw here the first episode of each combination, and NEES and NIS of all episodes with their bounds.
        force: Overwrite files that exist.
        **options: The environment's, see `turtlebot_gym.Options`.

    Raises:
        ValueError: If an argument is unknown or out of its range, or a list is empty.
    """
    require_outputs([("--json", json, JSON), ("--plot", plot, FIGURE)], inputs=policy, force=force)
    axes = {name: value for name, value in options.items() if isinstance(value, list) and name not in _VALUES}
    axes = {"policy": list(policy or ("proportional", "bearing")), **axes}
    for name, values in axes.items():
        if not values:
            raise ValueError(f"{name} must name at least one value, got none.")
    common = {"env": environment_id(env, options), "allow_mismatch": allow_mismatch, "consistency": plot is not None, **options}
    combinations = [dict(zip(axes, values, strict=True)) for values in itertools.product(*axes.values())]
    requests = [common | combination for combination in combinations]
    if cluster or workers:
        from turtlebot_gym_agents.cluster.workers import run

        firsts = range(0, as_int("episodes", episodes, 1), CHUNK)
        sizes = [{"seed": seed + first, "episodes": min(CHUNK, episodes - first)} for first in firsts]
        parts = iter(run([partial(evaluate, **request, **size) for request in requests for size in sizes], cluster, workers))
        results = [joined(list(itertools.islice(parts, len(sizes)))) for _ in requests]
    else:
        with progress(episodes * len(combinations)) as advance_to:
            results = []
            for done, request in enumerate(requests):
                so_far = lambda ended, done=done: advance_to(done * episodes + ended)  # noqa: E731
                results.append(evaluate(**request, seed=seed, episodes=episodes, progress=so_far))
    varied = [name for name, values in axes.items() if len(values) > 1] or ["policy"]
    labels = _distinct([", ".join(name_of(each[name]) for name in varied) for each in combinations])
    size = len(combinations) // len(axes["policy"])
    compared = Comparison(evaluations=dict(zip(labels, results, strict=True)), size=size, details=details)
    if json is not None:
        compared.to_json(json)
    if plot is not None:
        save_figure(compared.paths(), Path(plot))
    return compared


def _distinct(labels: Sequence[str]) -> Iterator[str]:
    """Yield labels; one that was there before, such as the class of a second object, gets a number."""
    for at, label in enumerate(labels):
        before = labels[:at].count(label)
        yield f"{label} ({before + 1})" if before else label


def _draw_intervals(axes: Axes, intervals: Mapping[str, Interval], *, label: str) -> Axes:
    """Draw numbers by name with their 95 % intervals, one under the other; ``label`` says what they are."""
    values, lows, highs = (np.array(numbers) for numbers in zip(*intervals.values(), strict=True))
    at = np.arange(len(values))
    axes.errorbar(values, at, xerr=(values - lows, highs - values), fmt="o", color=BLUE, capsize=3.0)
    axes.set_yticks(at, list(intervals))
    axes.set(xlabel=f"{label}, with 95 % intervals", ylim=(len(values) - 0.5, -0.5))
    axes.grid(axis="x", alpha=0.3)
    return axes
