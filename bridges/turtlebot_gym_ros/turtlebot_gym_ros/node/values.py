"""Values sent between nodes that are not part of the core. This module does not depend on ROS."""

from __future__ import annotations

from typing import NamedTuple


class Nis(NamedTuple):
    """The normalized innovation squared of a filter's last measurement, 1."""

    value: float
