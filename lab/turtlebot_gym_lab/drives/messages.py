"""A drive from ROS 2 messages: those of a bag, decoded by `rosbags`.

A row is a message on ``odom``. The truth is interpolated; of everything else, the last value holds for a while. What a message
does not state stays unknown.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.drive import Drive, RoomData, Seen
from turtlebot_gym.models.angles import sincos
from turtlebot_gym.models.odometry import increment
from turtlebot_gym.mounts import StaticFrames, differ, yaw_of_rotation
from turtlebot_gym.observations import NEAREST, TRACK_BOUNDS
from turtlebot_gym.rooms.grid import grid_of
from turtlebot_gym.rooms.lidar import LIDARS, Lidar
from turtlebot_gym.rooms.scan import Obstacles, Scan, read_scan, room_of, scan_of
from turtlebot_gym.tracking.tracker import tracks_of
from turtlebot_gym.values import ORIGIN, Pose
from turtlebot_gym_lab.drives.streams import Stream
from turtlebot_gym_lab.drives.transforms import Transforms

GUARD = "cmd_vel_guard"
"""Name of the guard's node."""
ROUNDED = 0.05
"""Difference from 1 that the length of a quaternion may have: drivers leave those unset that they do not know."""
HELD = 1.0
"""Age up to which a value holds, s; a waypoint holds indefinitely."""

ODOMETRY, TRANSFORMS = "nav_msgs/msg/Odometry", ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
MEASURED = "geometry_msgs/msg/PoseWithCovarianceStamped"
POSES = (
    ODOMETRY,
    "geometry_msgs/msg/PoseStamped",
    MEASURED,
    "geometry_msgs/msg/TransformStamped",
    "geometry_msgs/msg/PointStamped",
    *TRANSFORMS,
)
"""Types of messages that state a pose, or at least a position."""
TWISTS = ("geometry_msgs/msg/TwistStamped", "geometry_msgs/msg/Twist")
TYPES: dict[str, tuple[str, ...]] = {
    "odom": (ODOMETRY,),
    "true_state": POSES,
    "fix": POSES,
    "twist": TWISTS,
    "estimate": (ODOMETRY,),
    "reference": ("geometry_msgs/msg/PoseStamped",),
    "nis": ("geometry_msgs/msg/Vector3Stamped",),
    "clearance": ("sensor_msgs/msg/Range",),
    "scan": ("sensor_msgs/msg/LaserScan",),
    "tf": TRANSFORMS,
    "tf_static": TRANSFORMS,
    "obstacles": ("visualization_msgs/msg/MarkerArray",),
    "map": ("nav_msgs/msg/OccupancyGrid",),
    "hypotheses": ("geometry_msgs/msg/PoseArray",),
    "tracks": ("sensor_msgs/msg/PointCloud2",),
    "diagnostics": ("diagnostic_msgs/msg/DiagnosticArray",),
}
"""Types of messages by topic, named as in this project's graph."""


def _motion(message: Any) -> list[float]:
    """Return x, y, heading, speed and turning rate; NaN for those that a message does not state, or marks as not measured."""
    place = getattr(message, "pose", None) or getattr(message, "transform", None) or getattr(message, "point", None)
    covariance = getattr(place, "covariance", None)
    place = None if covariance is not None and covariance[0] < 0.0 else getattr(place, "pose", place)
    position = getattr(place, "position", None) or getattr(place, "translation", place)
    q = getattr(place, "orientation", None) or getattr(place, "rotation", None)
    x, y = (math.nan, math.nan) if position is None else (position.x, position.y)
    theta = math.nan
    if q is not None and abs(math.hypot(q.w, q.x, q.y, q.z) - 1.0) < ROUNDED:
        theta = yaw_of_rotation(q.w, q.x, q.y, q.z)
    twist = getattr(message, "twist", None)
    twist = getattr(twist, "twist", twist) if twist is not None else (message if hasattr(message, "angular") else None)
    return [x, y, theta, *((math.nan, math.nan) if twist is None else (twist.linear.x, twist.angular.z))]


def _covariance(message: Any) -> NDArray[np.float64]:
    """Return the covariance of x, y and heading in an Odometry message."""
    return np.asarray(message.pose.covariance, np.float64).reshape(6, 6)[np.ix_((0, 1, 5), (0, 1, 5))]


def _scan(message: Any) -> Scan:
    scan = scan_of(message)
    return read_scan(scan._replace(beam_period=max(float(scan.beam_period), 0.0)))


def _places(message: Any) -> NDArray[np.float64]:
    """Return the poses of a localizer's hypotheses, all of the same weight, shape (H, 4)."""
    places = [(*_motion(SimpleNamespace(pose=pose))[:3], 1.0 / len(message.poses)) for pose in message.poses]
    return np.array(places, np.float64).reshape(-1, 4)


_READ: dict[str, Callable[[Any], Any]] = {
    "nis": lambda message: float(message.vector.x),
    "clearance": lambda message: message.range,
    "scan": _scan,
    "obstacles": room_of,
    "map": grid_of,
    "hypotheses": _places,
    "tracks": tracks_of,
}


def stamp_of(message: Any) -> float | None:
    """Return the stamp of a message, s; None if it has none."""
    first = next(iter(getattr(message, "transforms", getattr(message, "markers", ()))), message)
    header = getattr(first, "header", None)
    return None if header is None else header.stamp.sec + header.stamp.nanosec * 1e-9


class DriveListener:
    """Takes the messages of a drive topic by topic, and returns rows.

    Args:
        lidar: The robot's LiDAR, for its mounting where no transform states it.
        mount: Pose of the LiDAR on the robot, m, m, rad; None for what the transforms state.
    """

    def __init__(self, *, lidar: Lidar = LIDARS["lds01"], mount: Pose | None = None) -> None:
        self._lidar, self._mount = lidar, mount
        self._streams: dict[str, Stream] = {}
        self._frames = StaticFrames()
        self._body, self._scanner = "", ""
        self.transforms = Transforms()
        """All transforms."""

    def __getitem__(self, topic: str) -> Stream:
        return self._streams.setdefault(topic, Stream())

    def hear(self, topic: str, message: Any, received: float) -> None:
        """Take a message.

        The topic is a key of `TYPES`; a message with an empty stamp counts from when it was received, s.
        """
        if topic in ("tf", "tf_static"):
            self.transforms.hear(message, received)
            if topic == "tf_static":
                self._frames.hear(message)
            return
        if topic == "odom":
            self._body = message.child_frame_id.lstrip("/")
        elif topic == "scan":
            self._scanner = message.header.frame_id.lstrip("/")
        time = stamp_of(message) or received
        if topic == "diagnostics":
            self._hear_reports(message, received)
            return
        value = _READ.get(topic, _motion)(message)
        if value is None or not self[topic].add(time, value):
            return
        if topic == "estimate":
            self["covariance"].add(time, _covariance(message))
        elif topic == "odom":
            self["received"].add(time, received)

    def _hear_reports(self, message: Any, received: float) -> None:
        for status in message.status:
            if status.name.rpartition("/")[2] == GUARD:
                level = status.level[0] if isinstance(status.level, bytes) else status.level
                self["diagnostics"].add(received, (float(level), str(status.message)))
                return

    def rows(self, time: NDArray[np.float64], *, start: float = 0.0) -> Drive:
        """Return rows.

        Stamps on ``odom`` are in s; ``start`` counts as 0.
        """
        odom, truth = self["odom"].held(time, 5, fresh=0.0), self["true_state"].held(time, 5)
        truth[:, :3] = self["true_state"].interpolated(time)
        truth[np.isnan(truth[:, 0])] = np.nan
        rooms, grids = self["obstacles"].values, self["map"].values
        around = RoomData(room=rooms[0] if rooms else None, grid=grids[-1] if grids else None)
        received = self["received"].held(time) if self["received"] else time
        reports = self["diagnostics"].latest(received, (math.nan, ""))
        drive = Drive(
            time=time,
            true_state=truth,
            odometry=self["fix"].nearest(time, 3) if self["fix"] else odom[:, :3],
            estimate=self["estimate"].held(time, 5, fresh=HELD),
            covariance=self["covariance"].held(time, (3, 3), fresh=HELD),
            reference=self["reference"].held(time, 5)[:, :3],
            twist=self["twist"].before(time, 5)[:, 3:] if self["twist"] else odom[:, 3:],
            nis=self["nis"].held(time, fresh=HELD),
            clearance=self["clearance"].held(time, fresh=HELD),
            tracks=self["tracks"].held(time, (NEAREST, len(TRACK_BOUNDS[0])), fresh=HELD),
            level=np.array([level for level, _ in reports]),
            report=tuple(text for _, text in reports),
            circles=self._walkers(time, around.room),
            hypotheses=tuple(self["hypotheses"].latest(time, np.empty((0, 4)))),
            around=around,
        )
        return replace(drive, time=time - start, command=drive.twist, scans=self._scans(drive, start))

    def _walkers(self, time: NDArray[np.float64], room: Obstacles | None) -> tuple[NDArray[np.float64], ...]:
        """Return the circles of each row where they are others than those of the room."""
        now = self["obstacles"].latest(time, room)
        return tuple(np.array(seen.circles if room and seen.circles != room.circles else ()).reshape(-1, 3) for seen in now)

    def take_truth(self, time: NDArray[np.float64], frames: str) -> None:
        """Take where transforms place a frame at some times for the truth; see `Transforms.poses`."""
        for at, pose in zip(time.tolist(), self.transforms.poses(frames, time).tolist(), strict=True):
            if not math.isnan(pose[0]):
                self["true_state"].add(at, [*pose, math.nan, math.nan])

    def mount(self) -> tuple[Pose, str]:
        """Return where the LiDAR is on the robot: as given, else by ``/tf_static``, else by its preset; and a remark."""
        preset, stated, why = Pose(self._lidar.x, self._lidar.y, self._lidar.yaw), None, "nothing says"
        if self._mount is not None:
            return self._mount, ""
        try:
            stated = self._frames.mount(self._body, self._scanner)
        except ValueError as error:
            why = str(error)
        if stated is None:
            return (
                preset,
                f"{why}: the LiDAR is assumed {_place(preset)}, as its preset has it; watch --mount X Y YAW states it",
            )
        return stated, f"the LiDAR is {_place(stated)}, by /tf_static and not by its preset" if differ(stated, preset) else ""

    def _scans(self, drive: Drive, start: float) -> tuple[Seen, ...]:
        """Return the scans with the robot's pose at their completion, see `Drive.poses`."""
        scans: list[Seen] = []
        mount, _ = self.mount()
        poses = drive.poses
        for stamp, scan in zip(self["scan"].times, self["scan"].values, strict=True):
            complete = stamp + scan.beam_period * len(scan.ranges)
            row = int(np.searchsorted(drive.time, complete - 1e-3))
            if row < len(drive) and np.isfinite(poses[row]).all():
                robot = Pose(*poses[row].tolist())
                place = increment(robot, ORIGIN, mount, sincos(robot.theta))
                scans.append(Seen(row, place, scan, stamp - start, mount))
        return tuple(scans)


def _place(pose: Pose) -> str:
    return f"at x {pose.x:.3f} m, y {pose.y:.3f} m, turned by {pose.theta:.3f} rad"
