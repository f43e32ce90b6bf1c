"""How every command reads recordings."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from turtlebot_gym_lab.drives.topics import Topics

TOPICS = Topics()


def reading(truth: str, columns: Sequence[str], topics: Topics) -> dict[str, Any]:
    """Return the options of `turtlebot_gym_lab.drives.read`.

    A truth of auto or none is what the recording itself holds, and columns are QUANTITY=COLUMN.
    """
    named = {name: column for name, _, column in (pair.partition("=") for pair in columns)}
    return {"topics": topics, "columns": named, "truth": None if truth in ("auto", "none") else truth}
