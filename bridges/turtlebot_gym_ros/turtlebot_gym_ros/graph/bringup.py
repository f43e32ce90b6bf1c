"""Run the whole graph with one command, with the tutorial's metrics, a figure, and a page for a browser."""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from cmd_vel_guard.process import refuse
from cmd_vel_guard.session import INTERRUPTED
from turtlebot_gym.config import POSITIVE_OR_INFINITE, as_int
from turtlebot_gym.drive import Drive, RoomData, heading_error, position_error
from turtlebot_gym.files import replacing, write_text
from turtlebot_gym.models.random import MAX_SEED
from turtlebot_gym.presets import FIXES, NOISES, make_robot
from turtlebot_gym.robots import ROBOTS
from turtlebot_gym.rooms.lidar import LIDARS
from turtlebot_gym.tasks import ROOM, SQUARE, arrived
from turtlebot_gym.values import Pose, State
from turtlebot_gym_agents.figures import drives_figure, legends_below
from turtlebot_gym_agents.front.satellites import satellite, watch
from turtlebot_gym_agents.outputs import FIGURE, HTML, JSON, require_outputs
from turtlebot_gym_ros.base.process import be_interruptible
from turtlebot_gym_ros.graph.graph import PATIENCE, Graph
from turtlebot_gym_ros.nodes import MODES

REACHED = 0.3
"""Distance within which a waypoint counts as reached, m."""
NOTHING = "nothing was driven: no true state came with odometry and an estimate. Do other nodes run in this ROS_DOMAIN_ID?"
ENDINGS = {"figure": FIGURE, "html": HTML, "json": JSON}
"""Suffixes of the files that are written."""
OPTIONS: dict[str, dict[str, Any]] = {
    "--policy": {"help": "bearing (default), vfh or another baseline, ppo-square, FILE.onnx, or module:callable"},
    "--robot": {"help": f"{', '.join(ROBOTS)}, or FILE.yaml (default: burger)"},
    "--noise": {"help": f"{', '.join(NOISES)}, or FILE.yaml (default: tutorial)"},
    "--filter": {"help": "matched (default), calibrated, tutorial, gated, FILE.yaml, or MODULE:NAME"},
    "--fix": {"help": f"external pose sensor: {', '.join(FIXES)}, or FILE.yaml (default: none)"},
    "--localizer": {"help": "with a world, localize by scans instead: match, robot, or FILE.yaml"},
    "--waypoints": {"help": '"square" (default), or a .yaml file'},
    "--world": {"help": "a room: dense, office, ... or the file of a Gazebo world or a map; its goal is the waypoint"},
    "--goals": {"type": int, "help": "with a world, number of goals in turn, as in missions (default: one)"},
    "--lidar": {"help": f"the LiDAR in a world: {', '.join(LIDARS)}, or FILE.yaml (default: lds01)"},
    "--switch": {"choices": ["arrival", "time"], "help": "when to switch to the next waypoint (default: arrival)"},
    "--seed": {"type": int, "help": "seed of the noise and of the room"},
    "--namespace": {"help": "namespace of all nodes and topics, such as robot1; by default none"},
    "--frame-prefix": {"help": 'prefix of all frames; by default that of the namespace, "robot1/"'},
}
"""Options that are a graph's, and stay at its defaults where they are left out."""


def metrics(trajectory: Drive) -> dict[str, Any]:
    """Return the tutorial's metrics of a drive, by name and unit: mean errors, and the distances to waypoints."""
    truth, odometry, estimate = trajectory.true_state, trajectory.odometry, trajectory.estimate
    reference = trajectory.reference
    known = np.isfinite(truth).all(1) & np.isfinite(estimate).all(1) & np.isfinite(odometry).all(1)
    followed = np.isfinite(reference).all(1) & np.isfinite(truth).all(1)
    pieces = np.split(np.flatnonzero(followed), np.flatnonzero(np.any(np.diff(reference[followed], axis=0), axis=1)) + 1)
    # A row holds the reference that follows from it: the row in which a waypoint is reached holds the next one.
    pieces = [(np.append(piece, piece[-1] + 1)[: len(truth) - piece[0]], reference[piece[0]]) for piece in pieces if len(piece)]
    closest = [float(np.nanmin(position_error(truth[rows], waypoint))) for rows, waypoint in pieces]
    # The generator uses the estimate; fmin ignores times without one.
    believed = [np.fmin.reduce(position_error(estimate[rows], waypoint)) for rows, waypoint in pieces]
    return {
        "duration, s": float(trajectory.time[-1]),
        "odometry position error, m": float(position_error(odometry[known], truth[known]).mean()),
        "estimate position error, m": float(position_error(estimate[known], truth[known]).mean()),
        "odometry heading error, rad": float(heading_error(odometry[known], truth[known]).mean()),
        "estimate heading error, rad": float(heading_error(estimate[known], truth[known]).mean()),
        "path length, m": float(np.hypot(*np.diff(truth[np.isfinite(truth).all(1), :2], axis=0).T).sum()),
        "waypoints": len(pieces),
        "waypoints reached": sum(distance <= REACHED for distance in closest),
        "waypoints believed reached": sum(bool(distance <= REACHED) for distance in believed),
        "mean closest distance, m": float(np.mean(closest)) if closest else float("nan"),
        "worst closest distance, m": float(np.max(closest)) if closest else float("nan"),
    }


def room_metrics(trajectory: Drive) -> dict[str, Any]:
    """Return how an episode in a room ended by the true pose, as the environment judges it: at the first contact or arrival."""
    poses = zip(trajectory.true_state.tolist(), trajectory.reference.tolist(), strict=True)
    at_goal = [at > 0 and arrived(State(*state), Pose(*goal), ROOM) for at, (state, goal) in enumerate(poses)]
    contact = trajectory.clearance < 0.0
    ended = np.flatnonzero(contact | at_goal)
    end = int(ended[0]) if len(ended) else len(at_goal) - 1
    return {
        "collision": bool(contact[end]),
        "goal reached": bool(at_goal[end] and not contact[end]),
        "end of the episode, s": float(trajectory.time[end]),
        "least clearance, m": float(np.nanmin(trajectory.clearance[: end + 1])),
    }


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command's options."""
    parser = argparse.ArgumentParser(
        "python -m turtlebot_gym_ros bringup",
        description="Run the closed loop as a ROS 2 graph on this machine. Without --world the simulated robot has "
        "no obstacles to avoid; a real one has, and only a policy that reads scans, such as vfh, sees them.",
    )
    parser.add_argument("--mode", choices=list(MODES), default="autonomous", help="who drives: a policy, or you on /cmd_vel")
    parser.add_argument("--real-time", action="store_true", help="as a robot; else in lock-step, as fast as the nodes answer")
    parser.add_argument("--processes", action="store_true", help="run each node in its own process")
    parser.add_argument("--duration", type=float, default=60.0, help="length of the drive, s (default: 60)")
    parser.add_argument("--allow-mismatch", action="store_true", help="also drive a policy made for another task")
    for name, options in OPTIONS.items():
        parser.add_argument(name, **options)
    parser.add_argument("--figure", type=Path, help="write the drive's figure to this file (.png, .pdf, .svg)")
    parser.add_argument("--html", type=Path, help="write the drive as a page to watch in a browser (.html)")
    parser.add_argument("--json", type=Path, help="write the metrics to this file (.json)")
    parser.add_argument("--force", action="store_true", help="overwrite files that exist")
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the graph, print its metrics, and return the exit code: 130 if it was interrupted before the end of the drive."""
    options = vars(parser().parse_args(argv))
    duration, force = options.pop("duration"), options.pop("force")
    files: dict[str, Path | None] = {name: options.pop(name) for name in ENDINGS}
    chosen: dict[str, Any] = {name: value for name, value in options.items() if value is not None}
    try:
        POSITIVE_OR_INFINITE.check("--duration", duration)
        as_int("--seed", chosen.get("seed", 0), 0, MAX_SEED)
        require_outputs([(f"--{name}", path, ENDINGS[name]) for name, path in files.items()], force=force)
        if files["html"]:
            satellite("watch", "page_of")((), title="")  # else what is missing would be told after the drive
    except (ValueError, OSError, ImportError) as error:
        return refuse(error)
    be_interruptible()
    try:
        return _drive(chosen, duration, files)
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return INTERRUPTED


def _drive(chosen: dict[str, Any], duration: float, files: dict[str, Path | None]) -> int:
    code = 0
    try:
        with Graph(**chosen) as graph:
            try:
                while graph.time < duration:
                    graph.require_no_fault()
                    last = graph.time
                    graph.wait_until(lambda graph, last=last: graph.time != last, timeout=PATIENCE)
            except KeyboardInterrupt:
                be_interruptible()  # anew, for what follows
                print("interrupted", file=sys.stderr)
                code = INTERRUPTED
            trajectory = graph.trajectory()
            latest = dict(graph.latest)
        if not code and not _was_driven(trajectory):
            raise RuntimeError(NOTHING)
    except (ValueError, RuntimeError, OSError, ImportError) as error:
        return refuse(error)
    if _was_driven(trajectory):
        _tell(trajectory, latest, chosen, files)
    return code


def _was_driven(drive: Drive) -> bool:
    """Return whether a drive has at least two rows, and one in which all that is compared is known."""
    known = [np.isfinite(column).all(1) for column in (drive.true_state, drive.estimate, drive.odometry)]
    return len(drive.time) > 1 and bool(np.logical_and.reduce(known).any())


def _tell(trajectory: Drive, latest: dict[str, Any], chosen: dict[str, Any], files: dict[str, Path | None]) -> None:
    """Print the metrics of a drive, and write the requested files."""
    figures = metrics(trajectory)
    if np.isfinite(trajectory.clearance).any():
        figures |= room_metrics(trajectory)
    for name, value in figures.items():
        print(f"{name:<32}{value:.3f}" if isinstance(value, float) else f"{name:<32}{value}")
    if files["json"]:
        known = {name: value if math.isfinite(value) else None for name, value in figures.items()}
        write_text(files["json"], json.dumps({"options": chosen, "metrics": known}, indent=2) + "\n")
    policy, task = chosen.get("policy", "bearing"), ROOM if "obstacles" in latest else SQUARE
    radius = make_robot(chosen.get("robot", "burger")).radius
    around = RoomData(policy, latest.get("obstacles"), latest.get("map"), robot_radius=radius, goal_radius=task.radius)
    drive = replace(trajectory, around=around)
    if files["figure"]:
        with replacing(files["figure"]) as beside:
            legends_below(drives_figure({policy: drive}, title="in the ROS graph")[0]).savefig(beside, dpi=120)
        print(f"figure written to {files['figure']}")
    if files["html"]:
        watch(drive, html=files["html"])
        print(f"page written to {files['html']}")
