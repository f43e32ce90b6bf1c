"""Inference about a training method from a few trained policies that drove the same episodes.

Two effects vary: trainings by their seed, episodes by their start, goal and noise. Episodes are many and trainings are few, and
an interval that ignores the variation between trainings holds for these policies only. Values form a table with a row per
training and a column per episode, and both are random effects: value = mean + training + episode + rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from turtlebot_gym_agents.evaluation import metrics
from turtlebot_gym_agents.evaluation.metrics import CONFIDENCE, Interval
from turtlebot_gym_agents.evaluation.result import Evaluation

_LEAST_P = 1e-12  # smaller p-values are not distinguished


class _Spread(NamedTuple):
    """Mean of a table of trainings and episodes, with the standard errors due to each."""

    value: float
    trainings: float
    """Standard error due to the choice of trainings."""
    episodes: float
    """Standard error due to the choice of episodes."""
    shape: tuple[int, int]
    """Numbers of trainings and of episodes."""

    def error(self) -> float:
        return float(np.hypot(self.trainings, self.episodes))

    def margin(self, confidence: float = CONFIDENCE) -> float:
        """Return half the width of the interval: Student's if only trainings or only episodes vary, and else conservative."""
        from scipy import stats  # slow to import

        t = stats.t.isf(0.5 * (1.0 - confidence), np.array(self.shape) - 1)
        return float(np.hypot(t[0] * self.trainings, t[1] * self.episodes))

    def interval(self) -> Interval:
        return Interval(self.value, self.value - self.margin(), self.value + self.margin())

    def p_value(self) -> float:
        """Return the smallest level at which zero is outside the interval."""
        from scipy import optimize

        if self.error() == 0.0:
            return 1.0 if self.value == 0.0 else 0.0
        if not self.margin(1.0 - _LEAST_P) > abs(self.value):
            return _LEAST_P
        # Solved for its logarithm, since p-values span decades.
        bracket = (np.log(_LEAST_P), 0.0)
        root = optimize.root_scalar(lambda log: self.margin(1.0 - np.exp(log)) - abs(self.value), bracket=bracket)
        return float(np.exp(root.root))


def spread(table: ArrayLike) -> _Spread:
    """Return the mean of a table of k > 1 trainings and n > 1 episodes, shape (k, n), with its standard errors.

    The square of each error is the variance of the row means, or of the column means, divided by their number. The rest that is
    neither training nor episode enters both, so the total is slightly conservative.
    """
    values = np.asarray(table, np.float64)
    k, n = values.shape
    trainings, episodes = values.mean(axis=1).std(ddof=1) / np.sqrt(k), values.mean(axis=0).std(ddof=1) / np.sqrt(n)
    return _Spread(float(values.mean()), float(trainings), float(episodes), (k, n))


def share(table: ArrayLike) -> Interval:
    """Return the share of cases in which something happened, booleans (k, n) as in `spread`, with Wilson's interval.

    It is that for the effective number of episodes: the number of independent episodes whose share would have the same error,
    at most the number that each training drove, since all drove the same ones.
    """
    result = spread(table)
    n, error = result.shape[1], result.error()
    if error == 0.0:
        return metrics.share(np.asarray(table, np.bool_)[0])  # all trainings and all episodes are equal
    return metrics.wilson(result.value, min(result.value * (1.0 - result.value) / error**2, n), result.margin() / error)


class PairedOutcome(NamedTuple):
    """What comparisons need of an evaluation; arrays of shape (n,), one value per episode."""

    seed: int
    """Seed of the first episode."""
    times: NDArray[np.float64]
    """Time, s; a failure counts as the limit."""
    success: NDArray[np.bool_]
    false_arrival: NDArray[np.bool_]
    """Whether the first belief of having arrived was false."""

    @classmethod
    def of(cls, evaluation: Evaluation) -> PairedOutcome:
        episodes = evaluation.episodes
        return cls(int(episodes.seed[0]), evaluation.times(), episodes.success, episodes.false_arrival)


def compare(learned: Sequence[PairedOutcome], baseline: PairedOutcome) -> dict[str, Any]:
    """Return metrics of trainings and their differences from a baseline on the same seeds."""
    if any((outcome.seed, len(outcome.times)) != (baseline.seed, len(baseline.times)) for outcome in learned):
        raise ValueError("Evaluations can be compared in pairs only if they have the same seeds.")
    times = np.array([outcome.times for outcome in learned])
    difference = spread(times - baseline.times)
    shares = {name: share(np.array([getattr(outcome, name) for outcome in learned])) for name in ("success", "false_arrival")}
    base = {name: metrics.share(getattr(baseline, name)) for name in shares}
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
