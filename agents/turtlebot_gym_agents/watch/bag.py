"""A bag as a track, without ROS: the topics of the graph, decoded by `rosbags`.

A row is a message on ``odom``. Values with the same stamp belong to it; otherwise the last earlier value holds, and the truth
is interpolated. Topics may be in a namespace.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.calibration.bags import TRUTHS, opened_bag, pose_and_twist
from turtlebot_gym.calibration.log import interpolated
from turtlebot_gym.models.angles import yaw_of_quaternion
from turtlebot_gym.rooms.grid import GridMap
from turtlebot_gym.rooms.lidar import Lidar
from turtlebot_gym.rooms.scan import Obstacles, Scan, mounted
from turtlebot_gym.rooms.worlds import find_lidar
from turtlebot_gym.trajectory import Trajectory
from turtlebot_gym.values import Pose, State
from turtlebot_gym_agents.watch.track import Seen, Surroundings, Track, of_trajectory

GUARD = "cmd_vel_guard"
"""Name of the guard's node."""
FRESH = 1.0
"""Age up to which a value holds, s; a waypoint holds indefinitely."""
_CUBE, _CYLINDER, _LINE_STRIP = 1, 3, 4
"""Types of ``visualization_msgs/msg/Marker`` in a room."""


class Heard(NamedTuple):
    """A message with the times of its stamp and of its recording, s."""

    stamp: float
    received: float
    message: Any


def read_bag_track(path: Path, around: Surroundings, *, lidar: str = "lds01") -> Track:
    """Read a bag.

    Args:
        path: The bag's folder, or its file.
        around: Label of the drive; room and map come from the bag.
        lidar: Name in `turtlebot_gym.rooms.lidar.LIDARS`, for the mounting of the LiDAR.

    Raises:
        ValueError: If the path is not a bag, the bag has no odometry, or a message does not fit its topic.
        ImportError: If rosbags is missing.
    """
    try:
        return _track_of(path, around, lidar)
    except (AttributeError, IndexError, KeyError, TypeError, OverflowError) as error:
        what = " ".join(str(error).split())
        raise ValueError(f"{path}: a message is not what its topic holds: {type(error).__name__}: {what}.") from error


def _track_of(path: Path, around: Surroundings, lidar: str) -> Track:
    heard = _read(path)
    odom = _increasing(heard.get("odom", []))
    if len(odom) < 2:
        raise ValueError(f"{path}: a drive needs two messages on odom, got {len(odom)}; there are {', '.join(sorted(heard))}.")
    time = np.array([each.stamp for each in odom])
    truth = next((found for name in TRUTHS if (found := heard.get(name.strip("/")))), [])
    drive = _trajectory(time, odom, _increasing(truth), heard)
    rooms = _increasing(heard.get("obstacles", []))
    grids = heard.get("map", [])
    shown = [_obstacles(each.message) for each in rooms]
    known = [(each.stamp, room) for each, room in zip(rooms, shown, strict=True) if room]
    walking = any(room.circles != known[0][1].circles for _, room in known)
    at = _before(np.array([stamp for stamp, _ in known]), time)
    circles = [np.array(known[max(k, 0)][1].circles).reshape(-1, 3) for k in at.tolist()] if walking else None
    return of_trajectory(
        drive._replace(time=time - time[0]),
        around._replace(room=known[0][1] if known else None, grid=_grid(grids[-1].message) if grids else None),
        nis=_held(heard.get("nis", []), time, _nis),
        clearance=_held(heard.get("clearance", []), time, lambda message: message.range),
        reports=_reports(heard.get("diagnostics", []), np.array([each.received for each in odom])),
        circles=circles,
        scans=_scans(heard.get("scan", []), time, drive, find_lidar(lidar)),
    )


def _read(path: Path) -> dict[str, list[Heard]]:
    """Return the messages of each topic of interest, by the last part of its name."""
    wanted = {"odom", "estimate", "reference", "nis", "clearance", "scan", "obstacles", "map", "diagnostics"}
    wanted |= {name.strip("/") for name in TRUTHS}
    heard: dict[str, list[Heard]] = {}
    with opened_bag(path) as reader:
        connections = [each for each in reader.connections if each.topic.rpartition("/")[2] in wanted]
        for connection, received, message in _messages(path, reader, connections):
            if not getattr(message, "markers", True):
                continue
            stamp = _header(message).stamp
            seconds = stamp.sec + stamp.nanosec * 1e-9
            heard.setdefault(connection.topic.rpartition("/")[2], []).append(
                Heard(seconds or received * 1e-9, received * 1e-9, message)
            )
    return heard


def _messages(path: Path, reader: Any, connections: Sequence[Any]) -> Iterator[tuple[Any, int, Any]]:
    """Yield the messages of a bag, decoded, with their connections and when they were recorded, ns."""
    try:
        for connection, received, data in reader.messages(connections):
            yield connection, received, reader.deserialize(data, connection.msgtype)
    except Exception as error:  # decoding raises whatever the storage and the codec do
        told = " ".join(str(error).split()) or type(error).__name__
        raise ValueError(f"{path}: its messages cannot be read: {told}") from error


def _header(message: Any) -> Any:
    """Return a message's header; in a marker array, each marker has one."""
    return message.header if hasattr(message, "header") else message.markers[0].header


def _increasing(messages: Sequence[Heard]) -> list[Heard]:
    """Return messages without those whose stamp does not increase, such as a step that was published again."""
    kept: list[Heard] = []
    for each in messages:
        if not kept or each.stamp > kept[-1].stamp:
            kept.append(each)
    return kept


def _before(times: NDArray[np.float64], wanted: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return the index of the last time at or before each wanted one; -1 if there is none."""
    return np.searchsorted(times, wanted + 1e-6, side="right") - 1


def _held(messages: Sequence[Heard], time: NDArray[np.float64], read: Any, *, fresh: float = FRESH) -> NDArray[np.float64]:
    """Return a number, or a tuple of numbers, from the last message at each time; NaN if it is too old."""
    kept = _increasing(messages)
    if not kept:
        return np.full(len(time), np.nan)
    values, stamps = np.array([read(each.message) for each in kept], np.float64), np.array([each.stamp for each in kept])
    at = _before(stamps, time)
    found = values[np.maximum(at, 0)].copy()
    found[(at < 0) | (time - stamps[np.maximum(at, 0)] > fresh)] = np.nan
    return found


def _trajectory(
    time: NDArray[np.float64], odom: Sequence[Heard], truth: Sequence[Heard], heard: dict[str, list[Heard]]
) -> Trajectory:
    rows = np.array([pose_and_twist(each.message, each.received)[1:] for each in odom])
    unknown = np.full((len(time), 5), np.nan)
    true_state, estimate, covariance, reference = unknown, unknown, np.full((len(time), 5, 5), np.nan), unknown[:, :3]
    if len(truth) > 1:
        told = np.array([pose_and_twist(each.message, each.received)[1:] for each in truth])
        stamps = np.array([each.stamp for each in truth])
        twist = told[np.maximum(_before(stamps, time), 0), 3:]
        true_state = np.hstack([interpolated(stamps, told[:, :3], time), twist])
    if heard.get("estimate"):
        estimate = _held(heard["estimate"], time, lambda message: pose_and_twist(message, 0.0)[1:])
        covariance = _held(heard["estimate"], time, _covariance)
    if heard.get("reference"):
        reference = _held(heard["reference"], time, lambda message: pose_and_twist(message, 0.0)[1:4], fresh=math.inf)
    return Trajectory(time, true_state, rows[:, :3], estimate, covariance, reference, rows[:, 3:])


def _covariance(message: Any) -> NDArray[np.float64]:
    """Return the covariance of x, y, heading, v and omega in an Odometry message; it lacks that between pose and twist."""
    P = np.zeros((5, 5))
    pose, twist = (np.asarray(part.covariance, np.float64).reshape(6, 6) for part in (message.pose, message.twist))
    P[:3, :3], P[3:, 3:] = pose[np.ix_((0, 1, 5), (0, 1, 5))], twist[np.ix_((0, 5), (0, 5))]
    return P


def _nis(message: Any) -> float:
    return next((float(pair.value) for status in message.status for pair in status.values if pair.key == "nis"), math.nan)


def _reports(messages: Sequence[Heard], received: NDArray[np.float64]) -> list[tuple[float, str]] | None:
    """Return the guard's last report at each row, by the recorder's clock; None if there was no guard."""
    told = [
        (each.received, (float(status.level), str(status.message)))
        for each in messages
        for status in each.message.status
        if status.name.rpartition("/")[2] == GUARD
    ]
    if not told:
        return None
    at = _before(np.array([when for when, _ in told]), received)
    return [told[k][1] if k >= 0 else (math.nan, "") for k in at.tolist()]


def _scans(messages: Sequence[Heard], time: NDArray[np.float64], drive: Trajectory, lidar: Lidar) -> list[Seen]:
    """Return the scans with the robot's pose at their completion: by the truth, else the estimate, else odometry."""
    scans: list[Seen] = []
    states = np.where(np.isfinite(drive.true_state[:, :3]), drive.true_state[:, :3], drive.estimate[:, :3])
    states = np.where(np.isfinite(states), states, drive.odometry)
    for each in _increasing(messages):
        message = each.message
        ranges = np.array(message.ranges, np.float32)
        ranges[~((ranges >= message.range_min) & (ranges <= message.range_max))] = np.inf
        complete = each.stamp + max(float(message.time_increment), 0.0) * len(ranges)
        row = int(np.searchsorted(time, complete - 1e-3))
        if row < len(time) and np.isfinite(states[row]).all():
            scan = Scan(ranges, message.angle_min, message.angle_increment, message.range_min, message.range_max)
            x, y, theta = states[row].tolist()
            scans.append(Seen(row, mounted(State(x, y, theta, 0.0, 0.0), lidar), scan))
    return scans


def _obstacles(message: Any) -> Obstacles | None:
    """Return a room from its markers: a line around it, cylinders and cubes; None for other markers."""
    walls, circles, boxes = None, [], []
    for marker in message.markers:
        at, q, size = marker.pose.position, marker.pose.orientation, marker.scale
        if marker.type == _CYLINDER:
            circles.append((at.x, at.y, 0.5 * size.x))
        elif marker.type == _CUBE:
            boxes.append((at.x, at.y, size.x, size.y, yaw_of_quaternion(q.w, q.x, q.y, q.z)))
        elif marker.type == _LINE_STRIP and len(marker.points) == 5:
            a, b = marker.points[0], marker.points[2]
            walls = 0.5 * (a.x + b.x), 0.5 * (a.y + b.y), 0.5 * (b.x - a.x), 0.5 * (b.y - a.y)
    return None if walls is None else Obstacles(walls, tuple(circles), tuple(boxes))


def _grid(message: Any) -> GridMap:
    info = message.info
    origin, q = info.origin.position, info.origin.orientation
    return GridMap(
        cells=np.array(message.data, np.int8).reshape(info.height, info.width),
        resolution=float(str(np.float32(info.resolution))),
        origin=Pose(origin.x, origin.y, yaw_of_quaternion(q.w, q.x, q.y, q.z)),
    )
