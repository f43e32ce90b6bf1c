"""The nodes of the package: the only list of them.

This is plain data without ROS; a node's code is loaded when it is needed. The command line, the ROS package's executables, the
graph's modes, the diagnostics, the reference and the tests read it.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any, NamedTuple


class Entry(NamedTuple):
    """A node."""

    target: str
    """Its block, or the function that runs it: "module:name" inside `package`."""
    summary: str
    """One line of help."""
    modes: tuple[str, ...] = ()
    """Modes of the graph to which it belongs."""
    package: str = "turtlebot_gym_ros"
    """Package of the target."""

    @property
    def guards(self) -> bool:
        """Whether it is a node of ``cmd_vel_guard``."""
        return self.package == GUARD

    @property
    def is_block(self) -> bool:
        """Whether it is a block in the shell rather than a separate program."""
        return not self.target.endswith(":main")


BOTH = ("autonomous", "teleoperation")
GUARD = "cmd_vel_guard"
"""The package of the nodes that run on the robot itself."""
NODES = {
    "waypoint_generator": Entry(
        "blocks.waypoints:WaypointGenerator", "publishes waypoints, by time or on arrival, on /reference", modes=("autonomous",)
    ),
    "velocity_controller": Entry(
        "blocks.controller:VelocityController",
        "drives by a policy: /estimate and /reference to /cmd_vel",
        modes=("autonomous",),
    ),
    "turtlebot_simulator": Entry(
        "blocks.simulator:TurtlebotSimulator", "simulates the robot: /cmd_vel to /odom and /true_state", modes=BOTH
    ),
    "kalman_filter": Entry("blocks.kalman_filter:KalmanFilter", "estimates the pose: /odom to /estimate", modes=BOTH),
    "localizer": Entry(
        "blocks.localizer:Localizer", "estimates the pose in a map: /odom and /scan to /estimate and /amcl_pose"
    ),
    "people_tracker": Entry("blocks.people_tracker:PeopleTracker", "tracks people: /odom and /scan to /tracks and /people"),
    "simulated_teleop": Entry("blocks.teleop:SimulatedTeleop", "drives by hand, by a script of 30 s, on /cmd_vel"),
    "data_logger": Entry("recording.logger:main", "records every message to a bag"),
    "bringup": Entry("graph.bringup:main", "runs the whole graph, prints its metrics and draws its figure"),
    "status": Entry("graph.status:main", "prints which node waits for what"),
    "cmd_vel_guard": Entry("guard:main", "on the robot: the only one on /cmd_vel; limits, watches and stops", package=GUARD),
    "cmd_vel_standby": Entry(
        "standby:main", "on the robot: sends zeros on /cmd_vel if the guard dies while it drives", package=GUARD
    ),
}
TOOLS = {
    "topics": Entry("tools.topics:topics", "lists topics and who is at them, or prints the messages of one"),
    "button": Entry("tools.topics:button", "is an emergency stop: Ctrl-C stops the robot"),
    "enable": Entry("tools.enable:enable", "enables nodes, or disables them"),
    "goal": Entry("tools.goal:goal", "sends the robot to a place"),
    "foxglove": Entry("tools.foxglove:foxglove", "serves the live graph to Foxglove"),
}
"""What ros2cli does on a ROS installation."""
MODES = {mode: tuple(name for name, entry in NODES.items() if mode in entry.modes) for mode in BOTH}
"""The nodes of each mode of the graph; in teleoperation a person publishes ``/cmd_vel``."""
BLOCKS = tuple(name for name, entry in NODES.items() if entry.is_block)
"""The nodes that are blocks."""
EXPLAINED = (*BLOCKS, "data_logger", *(name for name, entry in NODES.items() if entry.guards))
"""The nodes that take ROS arguments; all others, and the tools, parse options of their own."""


def entry_of(name: str) -> Entry:
    """Return the entry of a node or a tool.

    Raises:
        ValueError: If the name is unknown.
    """
    if entry := NODES.get(name) or TOOLS.get(name):
        return entry
    from turtlebot_gym.validation import did_you_mean  # slow to import

    names = (*NODES, *TOOLS)
    raise ValueError(f"there is no node {name!r}; there are {', '.join(names)}.{did_you_mean(name, names)}")


def load(name: str) -> Any:
    """Return the code of a node or a tool: the class of its block, or a function of arguments.

    Raises:
        ValueError: If the name is unknown.
    """
    entry = entry_of(name)
    module, _, attribute = entry.target.partition(":")
    return getattr(import_module(f"{entry.package}.{module}"), attribute)
