"""The result of an evaluation: a policy's episodes in one setting."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.config import flattened, split
from turtlebot_gym.drive import Drive
from turtlebot_gym_agents.evaluation import metrics
from turtlebot_gym_agents.evaluation.episodes import Episodes, outcome_of
from turtlebot_gym_agents.evaluation.metrics import Errors, Interval
from turtlebot_gym_agents.evaluation.record import Consistency
from turtlebot_gym_agents.front.results import Result, axes_or_new, name_of, with_legend

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from rich.table import Table


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Evaluation(Result):
    """A policy's episodes in one setting.

    It prints as a table and a verdict; ``evaluation["success"]`` is an array with a number per episode.
    """

    config: dict[str, Any]
    """Configuration of the evaluation, including the first seed."""
    limit: float
    """Longest time of an episode, s."""
    max_linear: float
    """The robot's highest speed, m/s."""
    episodes: Episodes
    consistency: Consistency | None = None
    """How consistent the filter was; None if that was not asked for."""

    @property
    def trajectory(self) -> Drive:
        """The first episode, driven once more, with its room and how it ended."""
        from turtlebot_gym_agents.evaluation.recording import record_episode

        options = {name: value for name, value in self.config.items() if name != "episodes"}
        outcome = outcome_of(self.episodes, by_time=self.config.get("switch") == "time")
        return replace(record_episode(**options, allow_mismatch=True), outcome=outcome)

    def times(self) -> NDArray[np.float64]:
        """Return the time of each episode, shape (n,), s; a failure counts as the limit."""
        return np.where(self.episodes.success, self.episodes.time, self.limit)

    def summary(self) -> dict[str, Interval]:
        """Return the episodes in numbers: means and shares, with 95 % intervals."""
        e = self.episodes
        return {
            "success": metrics.share(e.success),
            "time_to_goal": metrics.mean(e.time[e.success]),
            "time": metrics.mean(self.times()),
            "efficiency": metrics.mean((e.ideal / e.time)[e.success]),
            "reached": metrics.mean(e.reached),
            "miss": metrics.mean(e.miss),
            "path": metrics.mean(e.path),
            "effort": metrics.mean(e.effort),
            "false_arrival": metrics.share(e.false_arrival),
            "arrival_distance": metrics.mean(e.arrival_distance),
            **(self._on_missions() if e.given.max() > 1 and np.isfinite(e.clearance).all() else {}),
            **(self._in_rooms() if np.isfinite(e.clearance).all() else {}),
            **{f"estimate_{name}": metrics.mean(values) for name, values in e.estimate._asdict().items()},
            **{f"odometry_{name}": metrics.mean(values) for name, values in e.odometry._asdict().items()},
        }

    def _on_missions(self) -> dict[str, Interval]:
        """Return the summary of missions: shares of the goals given, and of the time."""
        e = self.episodes
        return {
            "goals": metrics.ratio(e.arrivals, e.given, 1.0),
            "false_goals": metrics.ratio(e.false_arrivals, e.given, 1.0),
            "goals_an_hour": metrics.ratio(e.arrivals, e.time / 3600.0),
            "lost": metrics.ratio(e.astray * e.time, e.time, 1.0),
        }

    def _in_rooms(self) -> dict[str, Interval]:
        """Return the summary of episodes in rooms.

        "spl" is success times shortest over driven length, "barn" the score of the BARN challenge, at most 0.5: Xiao et al.,
        *IEEE Robotics & Automation Magazine* 29 (2022).
        """
        e, fastest = self.episodes, self.episodes.shortest / self.max_linear
        return {
            "collision": metrics.share(e.collision),
            "timeout": metrics.share(~e.success & ~e.collision),
            "spl": metrics.mean(e.success * e.shortest / np.maximum(e.path, e.shortest)),
            "clearance": metrics.mean(e.clearance),
            "clearance_5th": metrics.quantile(e.clearance, 0.05),
            "barn": metrics.mean(e.success * fastest / np.clip(e.time, 2.0 * fastest, 8.0 * fastest)),
        }

    @property
    def label(self) -> str:
        """Name of its policy."""
        return name_of(self.config["policy"])

    @property
    def arrays(self) -> dict[str, NDArray[Any]]:
        """The numbers of `Episodes`, by name, shape (n,); errors as ``estimate_position_mean``."""
        columns: dict[str, NDArray[Any]] = {}
        for name, value in self.episodes._asdict().items():
            parts = value._asdict() if isinstance(value, Errors) else {"": value}
            columns |= {f"{name}_{part}".rstrip("_"): column for part, column in parts.items()}
        return columns

    def tables(self, *, details: bool = False) -> tuple[Table, ...]:
        """Return the tables of `turtlebot-gym evaluate`, with ``details`` all of them."""
        from turtlebot_gym_agents.commands.report import evaluation_tables

        return evaluation_tables({self.label: self}, title=title_of(self.config), details=details)

    def verdict(self) -> str:
        """Return it in a sentence."""
        from turtlebot_gym_agents.commands.verdict import verdicts

        return " ".join(verdicts({self.label: self}))

    def content(self) -> tuple[Mapping[str, Any], Mapping[str, Any]]:
        """Return summary and episodes, and the configuration."""
        return {"summary": self.summary(), "episodes": self.episodes}, self.config

    def plot(self, axes: Axes | None = None) -> Axes:
        """Draw the first episode seen from above."""
        from turtlebot_gym_agents.figures import plot_drive

        return with_legend(plot_drive(axes_or_new(axes), self.trajectory))


def title_of(config: Mapping[str, Any], *left_out: str) -> str:
    """Return what a result depends on, as a title: environment, episodes, and the options that were given."""
    given = {name: value for name, value in config.items() if name not in (*_HEAD, *left_out) and value is not None}
    seeds = f"{config['episodes']} episodes from seed" if "episodes" in config else "seed"
    options = (f"{name} {name_of(value)}{_changes(value)}" for name, value in given.items())
    return ", ".join([config["env"], f"{seeds} {config['seed']}", *options])


def _changes(value: Any) -> str:
    """Return the changed fields of a variant, see `turtlebot_gym.config`."""
    return "".join(f" {key} {name_of(changed)}" for key, changed in flattened(split(value)[1]))


_HEAD = ("env", "policy", "episodes", "seed")
