"""Read a recorded drive, whatever it is recorded as."""

from typing import Any

__all__ = ["read"]


def __getattr__(name: str) -> Any:
    """Import at first use: a command line offers `topics` without the imports of the rest."""
    if name != "read":
        raise AttributeError(name)
    from turtlebot_gym_lab.drives.reading import read

    return read
