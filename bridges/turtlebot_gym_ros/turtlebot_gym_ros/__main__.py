"""Nodes by name: ``python -m turtlebot_gym_ros NODE --ros-args ...``."""

from __future__ import annotations

import faulthandler
import sys
from collections.abc import Sequence
from importlib import import_module

from turtlebot_gym_ros.node.discovery import LAST_WORD, prepare

NODES = {
    "waypoint_generator": ("blocks.waypoints:WaypointGenerator", "publishes waypoints, by time or on arrival, on /reference"),
    "velocity_controller": ("blocks.controller:VelocityController", "drives by a policy: /estimate and /reference to /cmd_vel"),
    "turtlebot_simulator": ("blocks.simulator:TurtlebotSimulator", "simulates the robot: /cmd_vel to /odom and /true_state"),
    "kalman_filter": ("blocks.kalman_filter:KalmanFilter", "estimates the pose: /odom and /cmd_vel to /estimate"),
    "simulated_teleop": ("blocks.teleop:SimulatedTeleop", "drives by hand, by a script of 30 s, on /cmd_vel"),
    "cmd_vel_guard": ("robot.guard:main", "on the robot: the only one on /cmd_vel; limits, watches and stops"),
    "data_logger": ("recording.logger:main", "records every message to a bag, and 10 Hz snapshots to CSV"),
    "visualization": ("graph.markers:Visualization", "publishes waypoints and paths for RViz on /markers"),
    "bringup": ("graph.bringup:main", "runs the whole graph, prints its metrics and draws its figure"),
    "status": ("graph.status:main", "prints which node waits for what"),
}

HELP = f"""usage: python -m turtlebot_gym_ros NODE [--ros-args -p NAME:=VALUE ... -r FROM:=TO ...]

{chr(10).join(f"  {name:<20} {text}" for name, (_, text) in NODES.items())}

velocity_controller has no obstacle avoidance and starts disabled: watch the robot, and call its service ~/enable.
Discovery stays on this machine unless ROS_AUTOMATIC_DISCOVERY_RANGE says otherwise; to reach a robot, set it to SUBNET.
bringup and status have options of their own: ask them with --help."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run a node, and return its exit code."""
    name, *rest = list(sys.argv[1:] if argv is None else argv) or ["--help"]
    if name in ("-h", "--help"):
        print(HELP)
        return 0
    if name not in NODES:
        print(f"error: there is no node {name!r}; there are {', '.join(NODES)}.", file=sys.stderr)
        return 2
    prepare(local=name != "cmd_vel_guard")  # the guard runs on the robot, and serves the network
    module, _, attribute = NODES[name][0].partition(":")
    try:
        entry = getattr(import_module(f"turtlebot_gym_ros.{module}"), attribute)
        if not hasattr(entry, "Params"):
            return entry(rest)
        from turtlebot_gym_ros.node.runner import run
    except ModuleNotFoundError as error:
        if error.name != "rclpy":
            raise
        print('error: rclpy is missing: source a ROS 2 installation, or pip install "turtlebot-gym[ros]".', file=sys.stderr)
        return 2
    if "-h" in rest or "--help" in rest:
        print(entry.__doc__)
        return 0
    return run(entry, entry.Params, rest)


if __name__ == "__main__":
    code = main()
    faulthandler.dump_traceback_later(LAST_WORD, exit=True)  # the interpreter's own end can hang in DDS too
    raise SystemExit(code)
