"""Tasks as pure functions: starts and goals, arrival, reward and observation."""

from turtlebot_gym.tasks.observation import (
    OBSERVATION_HIGH,
    OBSERVATION_LAYOUT,
    OBSERVATION_LOW,
    Observation,
    observe,
    stated_deviations,
)
from turtlebot_gym.tasks.rules import (
    arrived,
    believed_to_arrive,
    by_time,
    distance_to,
    draw_goal,
    due,
    remaining,
    reward_of,
    start_pose,
)
from turtlebot_gym.tasks.task import (
    NAV,
    POSE,
    ROOM,
    SQUARE,
    SQUARE_PERIOD,
    SQUARE_WAYPOINTS,
    TASKS,
    Task,
)

__all__ = [
    "NAV",
    "OBSERVATION_HIGH",
    "OBSERVATION_LAYOUT",
    "OBSERVATION_LOW",
    "POSE",
    "ROOM",
    "SQUARE",
    "SQUARE_PERIOD",
    "SQUARE_WAYPOINTS",
    "TASKS",
    "Observation",
    "Task",
    "arrived",
    "believed_to_arrive",
    "by_time",
    "distance_to",
    "draw_goal",
    "due",
    "observe",
    "remaining",
    "reward_of",
    "start_pose",
    "stated_deviations",
]
