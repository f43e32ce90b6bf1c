"""The step put together: systems, their parameters, and one environment in plain Python."""

from turtlebot_gym.systems.episode import Episode
from turtlebot_gym.systems.open_ground import open_ground, system_for
from turtlebot_gym.systems.parameters import MAX_DELAY, OBSERVED, Parameters, make_parameters
from turtlebot_gym.systems.system import Step, System, step_of
from turtlebot_gym.systems.world import Body, Course, Outcome, World

__all__ = [
    "MAX_DELAY",
    "OBSERVED",
    "Body",
    "Course",
    "Episode",
    "Outcome",
    "Parameters",
    "Step",
    "System",
    "World",
    "make_parameters",
    "open_ground",
    "step_of",
    "system_for",
]
