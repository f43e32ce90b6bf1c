"""Drives in a browser: episodes and recordings, and a view that draws them.

A satellite: it builds on the product, which finds its command by an entry point and never imports it; recordings are read by
`turtlebot_gym_lab`. The view needs Bokeh, the extra [view]; the drives do not.
"""

from typing import Any

__all__ = ["read_recorded", "record_episode"]


def __getattr__(name: str) -> Any:
    """Import at first use: a command line offers `command` without the imports of the rest."""
    if name not in __all__:
        raise AttributeError(name)
    from turtlebot_gym_view import episode

    return getattr(episode, name)
