"""What a robot sees and what surrounds it, as messages.

Ranges are bit-exact. What each beam of a scan says is defined in `turtlebot_gym.beams`; a scan is refused only if it cannot be
read at all.

A room's walls and obstacles are visualization markers, which RViz draws and `GraphRecorder` reads back. The resolution of a map
is sent in single precision, and read as the shortest decimal nearest to it, such as 0.05 m.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Sequence

import numpy as np
from geometry_msgs.msg import Point, Vector3
from nav_msgs.msg import OccupancyGrid
from rclpy.duration import Duration
from sensor_msgs.msg import LaserScan, PointCloud2, PointField, Range
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from turtlebot_gym.beams import TURN
from turtlebot_gym.rooms.grid import GridMap, grid_of
from turtlebot_gym.rooms.scan import Clearance, Obstacles, Scan, read_scan, room_of, scan_of
from turtlebot_gym.tracking.tracker import POINT_FIELDS, tracks_of
from turtlebot_gym_ros.node.block import Tracks, Transform
from turtlebot_gym_ros.node.geometry import Conversion, read_pose, transform_to, unread, write_pose

HEIGHT = 0.3
"""Height at which obstacles are drawn, m."""
LINE = 0.05
"""Width of the line that represents the walls, m."""
LIFETIME = 3.0
"""Time after which a viewer removes a marker without an update, s, by the viewer's clock."""
GREY = ColorRGBA(r=0.35, g=0.35, b=0.35, a=1.0)


def _write_scan(scan: Scan, header: Header) -> LaserScan:
    return LaserScan(
        header=header,
        angle_min=float(scan.first),
        angle_max=float(scan.first + (len(scan.ranges) - 1) * scan.increment),
        angle_increment=float(scan.increment),
        time_increment=float(scan.beam_period),
        scan_time=float(scan.period),
        range_min=float(scan.range_min),
        range_max=float(scan.range_max),
        ranges=array("f", np.asarray(scan.ranges, np.float32).tobytes()),
    )


def _read_clearance(message: Range) -> Clearance:
    if math.isnan(message.range):
        raise ValueError("the clearance is not a number")
    return Clearance(message.range)


def _write_clearance(clearance: Clearance, header: Header) -> Range:
    distance = float(clearance.distance)
    return Range(header=header, field_of_view=TURN, min_range=-math.inf, max_range=math.inf, range=distance)


def _marker(header: Header, number: int, kind: int, at: tuple[float, float, float], scale: Sequence[float]) -> Marker:
    (x, y, heading), (length, width, height) = at, scale
    until = Duration(seconds=LIFETIME).to_msg()
    made = Marker(header=header, ns="obstacles", id=number, type=kind, action=Marker.ADD, color=GREY, lifetime=until)
    made.scale, made.pose.position = Vector3(x=length, y=width, z=height), Point(x=x, y=y, z=0.5 * HEIGHT)
    made.pose.orientation.z, made.pose.orientation.w = math.sin(0.5 * heading), math.cos(0.5 * heading)
    return made


def _write_obstacles(room: Obstacles, header: Header) -> MarkerArray:
    x, y, a, b = room.walls
    walls = _marker(header, 0, Marker.LINE_STRIP, (0.0, 0.0, 0.0), (LINE, 0.0, 0.0))
    corners = ((-a, -b), (a, -b), (a, b), (-a, b), (-a, -b))
    walls.points = [Point(x=x + u, y=y + v, z=0.0) for u, v in corners]
    markers = [walls]
    for cx, cy, radius in room.circles:
        size = (2.0 * radius, 2.0 * radius, HEIGHT)
        markers.append(_marker(header, len(markers), Marker.CYLINDER, (cx, cy, 0.0), size))
    for bx, by, length, width, heading in room.boxes:
        markers.append(_marker(header, len(markers), Marker.CUBE, (bx, by, heading), (length, width, HEIGHT)))
    return MarkerArray(markers=markers)


def _read_obstacles(message: MarkerArray) -> Obstacles:
    if (room := room_of(message)) is None:
        raise ValueError("the markers show no walls")
    return room


def _read_grid(message: OccupancyGrid) -> GridMap:
    read_pose(message.info.origin)  # refuses what is not a pose
    return grid_of(message)


def _write_grid(grid: GridMap, header: Header) -> OccupancyGrid:
    message = OccupancyGrid(header=header, data=array("b", grid.cells.tobytes()))
    info = message.info
    info.map_load_time, info.resolution = header.stamp, float(grid.resolution)
    info.height, info.width = grid.cells.shape
    write_pose(info.origin, grid.origin)
    return message


def _write_tracks(tracks: Tracks, header: Header) -> PointCloud2:
    rows = np.asarray(tracks, np.float32).reshape(-1, len(POINT_FIELDS) - 1)
    data = np.column_stack([rows, np.zeros(len(rows), np.float32)]).astype("<f4")
    message = PointCloud2(header=header, height=1, width=len(rows), point_step=4 * len(POINT_FIELDS), is_dense=True)
    message.fields = [
        PointField(name=name, offset=4 * at, datatype=PointField.FLOAT32, count=1) for at, name in enumerate(POINT_FIELDS)
    ]
    message.row_step, message.data = data.nbytes, array("B", data.tobytes())
    return message


ROOM_CONVERSIONS: dict[type, Conversion] = {
    Scan: Conversion(LaserScan, lambda message: read_scan(scan_of(message)), _write_scan, False),
    Obstacles: Conversion(MarkerArray, _read_obstacles, _write_obstacles, True),
    Clearance: Conversion(Range, _read_clearance, _write_clearance, False),
    GridMap: Conversion(OccupancyGrid, _read_grid, _write_grid, True),
    Tracks: Conversion(PointCloud2, lambda message: Tracks(tracks_of(message).ravel().tolist()), _write_tracks, False),
}
"""The conversions of this module, by the type of the value; that of a `Transform` only where its message is installed."""
try:  # it comes with a ROS installation, and is not on PyPI
    from tf2_msgs.msg import TFMessage  # type: ignore[import-not-found]
except ImportError:
    pass
else:

    def _write_transform(transform: Transform, header: Header) -> TFMessage:
        return TFMessage(transforms=[transform_to(transform.child, transform.pose, header)])

    ROOM_CONVERSIONS[Transform] = Conversion(TFMessage, unread, _write_transform, True)
