"""Drives in a browser: episodes, recordings and live graphs, and a view that draws them.

The view needs Bokeh, the extra [watch]; the drives do not.
"""

from turtlebot_gym_agents.watch.episode import read_recorded, record_episode

__all__ = ["read_recorded", "record_episode"]
