"""What can be said of a way of training, from a few policies that were trained so and drove the same episodes.

Two things vary: a training by its seed, an episode by its start, goal and noise. Episodes are many, trainings are few, and an
interval that leaves out how trainings differ tells of these policies only. Values are a table, a row for each training and a
column for each episode, and both rows and columns are random: value = mean + training + episode + rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from turtlebot_gym_agents.evaluation import metrics
from turtlebot_gym_agents.evaluation.evaluate import Evaluation
from turtlebot_gym_agents.evaluation.metrics import CONFIDENCE, Interval

_LEAST_P = 1e-12  # smaller p-values are not told apart


class Spread(NamedTuple):
    """Mean of a table of trainings and episodes, with the standard errors that trainings and episodes make of it."""

    value: float
    trainings: float
    """Standard error by the choice of trainings."""
    episodes: float
    """Standard error by the choice of episodes."""
    shape: tuple[int, int]
    """Number of trainings and of episodes."""

    def error(self) -> float:
        """Return the standard error by both."""
        return float(np.hypot(self.trainings, self.episodes))

    def margin(self, confidence: float = CONFIDENCE) -> float:
        """Return half the width of the interval: Student's margins for trainings and for episodes, squared and added.

        It is Student's interval where one of the two is all that varies, and errs on the safe side between.
        """
        from scipy import stats  # slow to import

        t = stats.t.isf(0.5 * (1.0 - confidence), np.array(self.shape) - 1)
        return float(np.hypot(t[0] * self.trainings, t[1] * self.episodes))

    def interval(self) -> Interval:
        """Return the mean with its interval."""
        return Interval(self.value, self.value - self.margin(), self.value + self.margin())

    def p_value(self) -> float:
        """Return the smallest level at which zero is outside the interval."""
        from scipy import optimize

        if self.error() == 0.0:
            return 1.0 if self.value == 0.0 else 0.0
        if not self.margin(1.0 - _LEAST_P) > abs(self.value):
            return _LEAST_P
        bracket = (np.log(_LEAST_P), 0.0)
        found = optimize.root_scalar(lambda log: self.margin(1.0 - np.exp(log)) - abs(self.value), bracket=bracket)
        return float(np.exp(found.root))


def spread(table: ArrayLike) -> Spread:
    """Return the mean of a table and how sure it is.

    Each error's square is the variance of the rows', or of the columns', means over their number. What is neither training
    nor episode is in both, so the whole is a little too large rather than too small.

    Args:
        table: Shape (k, n): k > 1 trainings, n > 1 episodes, the same for all.
    """
    values = np.asarray(table, np.float64)
    if values.ndim != 2 or min(values.shape) < 2:
        raise ValueError(f"table must have at least two trainings and two episodes, got shape {values.shape}.")
    k, n = values.shape
    trainings, episodes = values.mean(axis=1).std(ddof=1) / np.sqrt(k), values.mean(axis=0).std(ddof=1) / np.sqrt(n)
    return Spread(float(values.mean()), float(trainings), float(episodes), (k, n))


def share(table: ArrayLike) -> Interval:
    """Return how often something happened, with Wilson's interval for as many episodes as the table is worth.

    That is the number of independent episodes whose share would have the same error, at most the number that each training
    drove: all drove the same ones.

    Args:
        table: Booleans, shape (k, n), as in `spread`.
    """
    told = spread(table)
    n, error = told.shape[1], told.error()
    if error == 0.0:
        return metrics.share(np.asarray(table, np.bool_)[0])  # all trainings agree in every episode, and all episodes too
    return metrics.wilson(told.value, min(told.value * (1.0 - told.value) / error**2, n), told.margin() / error)


def compare(learned: Sequence[Evaluation], baseline: Evaluation) -> dict[str, Any]:
    """Return figures of trainings and how they differ from a baseline; times count a failure as the limit.

    Args:
        learned: An evaluation of each training.
        baseline: Of the baseline, with the same seeds.

    Raises:
        ValueError: If the seeds are not the same.
    """
    if not all(np.array_equal(one.episodes.seed, baseline.episodes.seed) for one in learned):
        raise ValueError("Evaluations can be compared in pairs only if they have the same seeds.")

    def table(name: str) -> NDArray[Any]:
        return np.array([getattr(one.episodes, name) for one in learned])

    times = np.array([one.times() for one in learned])
    difference = spread(times - baseline.times())
    shares = {name: share(table(name)) for name in ("success", "false_arrival")}
    base = {name: metrics.share(getattr(baseline.episodes, name)) for name in shares}
    return {
        "trainings": len(learned),
        "episodes": times.shape[1],
        "time": spread(times).interval(),
        "time_of_each_training": times.mean(axis=1),
        "difference": difference.interval(),
        "p": difference.p_value(),
        **shares,
        **{f"{name}_difference": metrics.share_difference(shares[name], base[name]) for name in shares},
    }
