"""Values that travel between nodes and are no values of the core. There is no ROS in here."""

from __future__ import annotations

from typing import NamedTuple


class Nis(NamedTuple):
    """The normalized innovation squared of a filter's last measurement, 1."""

    value: float
