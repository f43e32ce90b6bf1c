"""Numbers of a block that can be set while its node runs. Does not depend on ROS."""

from __future__ import annotations

from typing import NamedTuple


class Live(NamedTuple):
    """A number, or some, of a block that can be set while it runs."""

    value: float | tuple[float, ...]
    """The current value."""
    owner: type
    """The dataclass that has it, with its rule and its text."""
    field: str
    """Its name there."""
