"""The nodes and tools of the package: the only list of them.

This is plain data without ROS; a node's code is loaded when it is needed. The command line, the ROS package's executables, the
graph's modes, the diagnostics, the reference and the tests read it.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any, NamedTuple


class Entry(NamedTuple):
    """A node or a tool."""

    target: str
    """Its block, or the function that runs it: "module:name", of this package."""
    summary: str
    """One line of help."""


NODES = {
    "waypoint_generator": Entry(
        "blocks.waypoints:WaypointGenerator", "publishes waypoints, by time or on arrival, on /reference"
    ),
    "velocity_controller": Entry(
        "blocks.controller:VelocityController", "drives by a policy: /estimate and /reference to /cmd_vel"
    ),
    "turtlebot_simulator": Entry(
        "blocks.simulator:TurtlebotSimulator", "simulates the robot: /cmd_vel to /odom and /true_state"
    ),
    "kalman_filter": Entry("blocks.kalman_filter:KalmanFilter", "estimates the pose: /odom to /estimate"),
    "localizer": Entry("blocks.localizer:Localizer", "estimates the pose in a map: /odom and /scan to /estimate, /amcl_pose"),
    "people_tracker": Entry("blocks.people_tracker:PeopleTracker", "tracks people: /odom and /scan to /tracks"),
    "data_logger": Entry("recording.logger:main", "records every message to a bag"),
    "bringup": Entry("graph.bringup:main", "runs the whole graph, prints its metrics and draws its figure"),
    "status": Entry("graph.status:main", "prints which node waits for what"),
}
TOOLS = {
    "topics": Entry("tools.topics:topics", "lists topics and who is at them, or prints the messages of one"),
    "button": Entry("tools.telling:button", "is an emergency stop: Ctrl-C stops the robot"),
    "enable": Entry("tools.telling:enable", "enables nodes, or disables them"),
    "goal": Entry("tools.telling:goal", "sends the robot to a place"),
    "foxglove": Entry("tools.foxglove:foxglove", "serves the live graph to Foxglove"),
}
"""What ros2cli does on a ROS installation."""
MODES = {
    "autonomous": ("waypoint_generator", "velocity_controller", "turtlebot_simulator", "kalman_filter"),
    "teleoperation": ("turtlebot_simulator", "kalman_filter"),
}
"""The nodes of each mode of the graph; in teleoperation a person publishes ``/cmd_vel``."""
BLOCKS = tuple(name for name, entry in NODES.items() if entry.target.startswith("blocks."))
"""The nodes that are blocks in the shell rather than separate programs."""
EXPLAINED = (*BLOCKS, "data_logger")
"""The nodes that take ROS arguments; all others, and the tools, parse options of their own."""


def entry_of(name: str) -> Entry:
    """Return the entry of a node or a tool; raise `ValueError` if the name is unknown."""
    if entry := NODES.get(name) or TOOLS.get(name):
        return entry
    from turtlebot_gym.config import did_you_mean

    names = (*NODES, *TOOLS)
    raise ValueError(f"there is no node {name!r}; there are {', '.join(names)}.{did_you_mean(name, names)}")


def load(name: str) -> Any:
    """Return the code of a node or a tool: the class of its block, or a function of arguments; see `entry_of`."""
    module, _, attribute = entry_of(name).target.partition(":")
    return getattr(import_module(f"turtlebot_gym_ros.{module}"), attribute)
