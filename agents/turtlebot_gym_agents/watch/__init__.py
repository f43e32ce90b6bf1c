"""Drives in a browser: a record, `Track`, filled by episodes, recordings and live graphs, and a view that draws it.

The view needs Bokeh, the extra [watch]; the record does not.
"""

from turtlebot_gym_agents.watch.episode import record_episode
from turtlebot_gym_agents.watch.recorded import read_recorded
from turtlebot_gym_agents.watch.track import Growing, Seen, Surroundings, Track, concatenate, of_trajectory

__all__ = ["Growing", "Seen", "Surroundings", "Track", "concatenate", "of_trajectory", "read_recorded", "record_episode"]
