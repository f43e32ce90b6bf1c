"""A drive, recorded or simulated: one type for recorders, filters, fits, plots and the viewer, and one reader of files."""

from typing import TYPE_CHECKING

from turtlebot_gym.lazy import lazy_names

if TYPE_CHECKING:
    from turtlebot_gym.drives.drive import Drive, Growing, RoomData, Seen, concatenate, heading_error, known, position_error
    from turtlebot_gym.drives.reading import read
else:  # a command line offers `topics` without the imports of the rest
    _HOMES = {
        "drive": ("Drive", "Growing", "Seen", "RoomData", "concatenate", "heading_error", "known", "position_error"),
        "reading": ("read",),
    }
    __getattr__, __dir__ = lazy_names(__name__, _HOMES)

__all__ = ["Drive", "Growing", "RoomData", "Seen", "concatenate", "heading_error", "known", "position_error", "read"]
