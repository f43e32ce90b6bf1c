"""The nodes and tools of the package: the only list of them.

This is plain data without ROS: by name the block or function, "module:name" of this package, which is loaded when it is needed,
and one line of help.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

NODES = {
    "waypoint_generator": ("blocks.waypoints:WaypointGenerator", "publishes waypoints, by time or on arrival, on /reference"),
    "velocity_controller": ("blocks.controller:VelocityController", "drives by a policy: /estimate and /reference to /cmd_vel"),
    "turtlebot_simulator": ("blocks.simulator:TurtlebotSimulator", "simulates the robot: /cmd_vel to /odom and /true_state"),
    "kalman_filter": ("blocks.kalman_filter:KalmanFilter", "estimates the pose: /odom to /estimate"),
    "localizer": ("blocks.localizer:Localizer", "estimates the pose in a map: /odom and /scan to /estimate, /amcl_pose"),
    "people_tracker": ("blocks.people_tracker:PeopleTracker", "tracks people: /odom and /scan to /tracks"),
    "data_logger": ("recording.logger:main", "records every message to a bag"),
    "bringup": ("graph.bringup:main", "runs the whole graph, prints its metrics and draws its figure"),
    "status": ("tools.topics:status", "prints which node waits for what"),
}
TOOLS = {
    "topics": ("tools.topics:topics", "lists topics and who is at them, or prints the messages of one"),
    "button": ("tools.telling:button", "is an emergency stop: Ctrl-C stops the robot"),
    "enable": ("tools.telling:enable", "enables nodes, or disables them"),
    "goal": ("tools.telling:goal", "sends the robot to a place"),
    "foxglove": ("tools.foxglove:foxglove", "serves the live graph to Foxglove"),
}
"""What ros2cli does on a ROS installation."""
MODES = {
    "autonomous": ("waypoint_generator", "velocity_controller", "turtlebot_simulator", "kalman_filter"),
    "teleoperation": ("turtlebot_simulator", "kalman_filter"),
}
"""The nodes of each mode of the graph; in teleoperation a person publishes ``/cmd_vel``."""
BLOCKS = tuple(name for name, (target, _) in NODES.items() if target.startswith("blocks."))
"""The nodes that are blocks in the shell rather than separate programs."""


def target_of(name: str) -> str:
    """Return the target of a node or a tool; raise `ValueError` if the name is unknown."""
    targets = NODES | TOOLS
    if name in targets:
        return targets[name][0]
    from turtlebot_gym.config import did_you_mean

    raise ValueError(f"there is no node {name!r}; there are {', '.join(targets)}.{did_you_mean(name, targets)}")


def load(name: str) -> Any:
    """Return the code of a node or a tool: the class of its block, or a function of arguments; see `target_of`."""
    module, _, attribute = target_of(name).partition(":")
    return getattr(import_module(f"turtlebot_gym_ros.{module}"), attribute)
