"""The evaluations during a training, as they are kept in the folder of its run."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

from turtlebot_gym.files import read_text

NAME = "evaluations.json"
"""File in the folder of a run: the figures of each evaluation so far, also those before an interruption."""


def read_history(folder: Path, *, steps: float = math.inf) -> list[dict[str, float]]:
    """Return the figures of each evaluation of a run, in the order of the steps.

    Args:
        folder: Folder of a run, as `train` leaves it, finished or not.
        steps: Steps of the training up to which evaluations count.

    Raises:
        ValueError: If it holds no evaluations.
    """
    path = folder / NAME
    if not path.is_file():
        raise ValueError(f"{path} is missing: name the folder of a training that has evaluated its policy.")
    try:
        rows: Any = json.loads(read_text(path))
    except json.JSONDecodeError as error:
        raise ValueError(f"{path} is not JSON: {error}.") from error
    is_figures = isinstance(rows, list) and all(
        isinstance(row, dict) and {"steps", "success", "return"} <= set(row) and all(map(_is_number, row.values()))
        for row in rows
    )
    if not is_figures:
        raise ValueError(f"{path} must be a list of evaluations, each with the numbers steps, success and return.")
    return [row for row in rows if row["steps"] <= steps]


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
