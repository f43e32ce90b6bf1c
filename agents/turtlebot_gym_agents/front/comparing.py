"""Policies compared on the same seeds: ``compare``."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.plotting import BLUE
from turtlebot_gym_agents.evaluation.evaluate import evaluate
from turtlebot_gym_agents.evaluation.metrics import Interval
from turtlebot_gym_agents.evaluation.result import Evaluation, title_of
from turtlebot_gym_agents.front.defaults import EPISODES, NAV, POLICIES, SEED
from turtlebot_gym_agents.front.results import Result, axes_or_new, name_of
from turtlebot_gym_agents.ids import environment_id

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from rich.table import Table

_Progress = Callable[[int], None]
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

    @property
    def arrays(self) -> dict[str, NDArray[Any]]:
        """The numbers of each evaluation, by name, shape (evaluations, episodes)."""
        each = [evaluation.arrays for evaluation in self.evaluations.values()]
        return {name: np.array([arrays[name] for arrays in each]) for name in each[0]}

    def rows(self) -> dict[str, Sequence[Any] | NDArray[Any]]:
        """Return a row per evaluation and episode."""
        labels = np.repeat([*self.evaluations], [len(each.episodes.seed) for each in self.evaluations.values()])
        return {"label": labels, **{name: array.ravel() for name, array in self.arrays.items()}}

    def tables(self, *, details: bool = False, title: str | None = None) -> tuple[Table, ...]:
        """Return the tables of `turtlebot-gym evaluate`.

        Args:
            details: Whether to return all of them.
            title: Their title; None for one that names what was given.
        """
        from turtlebot_gym_agents.commands.report import evaluation_tables

        return evaluation_tables(self.evaluations, title=title or self._title(), details=details)

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


def compare(
    *policies: Any,
    env: str = NAV,
    episodes: int = EPISODES,
    seed: int = SEED,
    progress: _Progress = lambda ended: None,
    run: Callable[[Sequence[Mapping[str, Any]], _Progress], list[Evaluation]] | None = None,
    **options: Any,
) -> Comparison:
    """Drive policies on the same seeds, in every combination with the options that are lists.

    For example ``compare("bearing", "ppo-nav", filter=["matched", "gated"])``. A list gives the values of an option in turn; a
    tuple is one value, such as the terms of an observation.

    Args:
        *policies: As for `evaluate`; by default the baselines `POLICIES`.
        env: The id of an environment of this package, or its short name, such as "nav".
        episodes: Episodes of each combination; episode i has the seed ``seed + i``.
        seed: The first seed.
        progress: Called with the number of episodes that have ended so far.
        run: Evaluates requests, which are keyword arguments of `evaluate`; None for one after the other in this process.
        **options: The environment's, see `turtlebot_gym.Options`, and ``allow_mismatch``.

    Raises:
        ValueError: If an argument is unknown or out of its range, or a list is empty.
    """
    axes = {name: value for name, value in options.items() if isinstance(value, list) and name not in _VALUES}
    axes = {"policy": list(policies or POLICIES), **axes}
    for name, values in axes.items():
        if not values:
            raise ValueError(f"{name} must name at least one value, got none.")
    common = {"env": environment_id(env), "episodes": episodes, "seed": seed, **options}
    combinations = [dict(zip(axes, values, strict=True)) for values in itertools.product(*axes.values())]
    results = (run or _in_turn)([common | combination for combination in combinations], progress)
    varied = [name for name, values in axes.items() if len(values) > 1] or ["policy"]
    labels = _distinct([", ".join(name_of(each[name]) for name in varied) for each in combinations])
    return Comparison(evaluations=dict(zip(labels, results, strict=True)), size=len(combinations) // len(axes["policy"]))


def _in_turn(requests: Sequence[Mapping[str, Any]], progress: _Progress) -> list[Evaluation]:
    done, results = 0, []
    for request in requests:
        results.append(evaluate(**request, progress=lambda ended, done=done: progress(done + ended)))
        done += request["episodes"]
    return results


def _distinct(labels: Sequence[str]) -> Iterator[str]:
    """Yield labels; one that was there before, such as the class of a second object, gets a number."""
    for at, label in enumerate(labels):
        before = labels[:at].count(label)
        yield f"{label} ({before + 1})" if before else label


def _draw_intervals(axes: Axes, intervals: Mapping[str, Interval], *, label: str) -> Axes:
    """Draw numbers with their 95 % intervals, one under the other.

    Args:
        axes: Axes to draw into.
        intervals: Number by name.
        label: What the number is, with its unit.
    """
    values, lows, highs = (np.array(numbers) for numbers in zip(*intervals.values(), strict=True))
    at = np.arange(len(values))
    axes.errorbar(values, at, xerr=(values - lows, highs - values), fmt="o", color=BLUE, capsize=3.0)
    axes.set_yticks(at, list(intervals))
    axes.set(xlabel=f"{label}, with 95 % intervals", ylim=(len(values) - 0.5, -0.5))
    axes.grid(axis="x", alpha=0.3)
    return axes
