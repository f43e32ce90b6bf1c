"""Read a recorded drive, whatever it is recorded as."""

from typing import TYPE_CHECKING

from turtlebot_gym.lazy import lazy_names

if TYPE_CHECKING:
    from turtlebot_gym_lab.drives.reading import read
else:  # a command line offers `topics` without the imports of the rest
    __getattr__, __dir__ = lazy_names(__name__, {"reading": ("read",)})

__all__ = ["read"]
