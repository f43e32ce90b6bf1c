"""Column names of a recording; separate from their reader, so that a command line can offer them without its imports."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Columns:
    """Names of the columns of a recording."""

    time: str = "t"
    """Time, s; increasing."""
    v: str = "vx"
    """Forward speed by the wheels since the previous row, m/s."""
    omega: str = "gyro"
    """Turning rate by the wheels since the previous row, rad/s."""
    x: str = "px"
    """True position, m."""
    y: str = "py"
    """True position, m."""
    theta: str = "theta"
    """True heading, rad."""
