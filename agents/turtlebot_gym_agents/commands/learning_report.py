"""Trainings and searches for people: tables for the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from rich.table import Table

if TYPE_CHECKING:
    from optuna.trial import FrozenTrial

    from turtlebot_gym_agents.training.train import TrainingResult

SHOWN = 5
"""Trials in the table of a search, the best first."""


class Trained(NamedTuple):
    """One training."""

    seed: int
    folder: Path
    result: TrainingResult


def training_table(trainings: Sequence[Trained], *, title: str) -> Table:
    """Return how trainings went, and what their best models do.

    Args:
        trainings: The trainings, in the order of the rows.
        title: What stands above.
    """
    table = Table("seed", "steps", "s", "steps/s", "success, %", "return", "steps to end", "policy", title=title)
    for seed, folder, result in trainings:
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
    return table


def search_table(trials: Sequence[FrozenTrial], *, title: str) -> Table:
    """Return the best trials of a search, at most `SHOWN`.

    Args:
        trials: All trials; those without a value are left out.
        title: What stands above.
    """
    table = Table("trial", "return", "hyper-parameters", title=title)
    complete = sorted((trial for trial in trials if trial.value is not None), key=lambda trial: -(trial.value or 0.0))
    for trial in complete[:SHOWN]:
        table.add_row(str(trial.number), f"{trial.value:.3f}", ", ".join(f"{k} {v}" for k, v in trial.params.items()))
    return table
