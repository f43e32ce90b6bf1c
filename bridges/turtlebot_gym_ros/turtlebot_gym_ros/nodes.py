"""The nodes of the package: the only list of them.

This is plain data without ROS; a node's code is loaded when it is needed. The command line, the ROS package's executables, the
graph's modes, the diagnostics, the reference and the tests read it.
"""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from typing import Any, NamedTuple


class Entry(NamedTuple):
    """A node."""

    target: str
    """Its block, or the function that runs it: "module:name" inside this package, or of ``cmd_vel_guard``."""
    summary: str
    """One line of help."""
    modes: tuple[str, ...] = ()
    """Modes of the graph to which it belongs."""

    given: tuple[str, ...] = ()
    """ROS arguments that hold where others do not say otherwise."""

    @property
    def guards(self) -> bool:
        """Whether it is a node of ``cmd_vel_guard``."""
        return self.target.startswith(GUARD)

    @property
    def is_block(self) -> bool:
        """Whether it is a block in the shell rather than a separate program."""
        return not self.target.endswith(":main")


BOTH = ("autonomous", "teleoperation")
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
    "simulated_teleop": Entry("blocks.teleop:SimulatedTeleop", "drives by hand, by a script of 30 s, on /cmd_vel"),
    "calibration_drive": Entry(
        "blocks.calibration_drive:CalibrationDrive", "drives a script that calibration needs: /odom to /cmd_vel"
    ),
    "data_logger": Entry("recording.logger:main", "records every message to a bag, and 10 Hz snapshots to CSV"),
    "visualization": Entry("graph.markers:Visualization", "publishes waypoints and paths for RViz on /markers"),
    "bringup": Entry("graph.bringup:main", "runs the whole graph, prints its metrics and draws its figure"),
    "watch": Entry("graph.watch:main", "shows the running graph in a browser"),
    "field_test": Entry("field.program:main", "guides a person through the first afternoon with a robot"),
    "status": Entry("graph.status:main", "prints which node waits for what"),
}
GUARD = "cmd_vel_guard"
"""The package of the nodes that run on the robot itself, which may be missing: it is found by its name."""
if find_spec(GUARD):
    NODES |= {
        "cmd_vel_guard": Entry(
            f"{GUARD}.guard:main",
            "on the robot: the only one on /cmd_vel; limits, watches and stops",
            given=("-p", "robot:=burger"),
        ),
        "cmd_vel_standby": Entry(
            f"{GUARD}.standby:main", "on the robot: sends zeros on /cmd_vel if the guard dies while it drives"
        ),
    }
MODES = {mode: tuple(name for name, entry in NODES.items() if mode in entry.modes) for mode in BOTH}
"""The nodes of each mode of the graph; in teleoperation a person publishes ``/cmd_vel``."""
BLOCKS = tuple(name for name, entry in NODES.items() if entry.is_block)
"""The nodes that are blocks."""


def unknown(name: str) -> str:
    """Return what is said of a name that no node has."""
    from turtlebot_gym.validation import did_you_mean  # slow to import

    if name.startswith("cmd_vel_"):
        return f"{name} is a node of the package {GUARD}, which is missing: pip install ./bridges/{GUARD} in a checkout."
    return f"there is no node {name!r}; there are {', '.join(NODES)}.{did_you_mean(name, NODES)}"


def load(name: str) -> Any:
    """Return the code of a node: the class of its block, or its ``main``, which takes the arguments.

    Raises:
        ValueError: If there is no such node.
    """
    if name not in NODES:
        raise ValueError(unknown(name))
    module, _, attribute = NODES[name].target.partition(":")
    if not NODES[name].guards:
        return getattr(import_module(f"turtlebot_gym_ros.{module}"), attribute)
    from turtlebot_gym_ros.guarded import numbers_of  # slow to import

    import_module(f"{GUARD}.robots").SOURCES.append(numbers_of)  # also where nothing is installed
    main = getattr(import_module(module), attribute)
    return lambda argv: main(["--ros-args", *NODES[name].given, "--", *argv])
