"""Drives in a browser: episodes and recordings, and a view that draws them.

A satellite: it builds on the product, which finds its command by an entry point and never imports it; recordings are read by
`turtlebot_gym_lab`. The view needs Bokeh, the extra [view]; the drives do not.
"""

from typing import TYPE_CHECKING

from turtlebot_gym.lazy import lazy_names

if TYPE_CHECKING:
    from turtlebot_gym_view.episode import read_recorded, record_episode
else:  # a command line offers `command` without the imports of the rest
    __getattr__, __dir__ = lazy_names(__name__, {"episode": ("read_recorded", "record_episode")})

__all__ = ["read_recorded", "record_episode"]
