"""LiDAR scans and clearances as messages.

Ranges are bit-exact. By the definition of `sensor_msgs/LaserScan`, ranges outside its limits are discarded: such a beam
returned nothing, and becomes infinite, except for minus infinity, which by REP 117 means that something is nearer than
``range_min``. A scan without valid directions or ranges is refused.
"""

from __future__ import annotations

import math
from array import array

import numpy as np
from sensor_msgs.msg import LaserScan, Range
from std_msgs.msg import Header

from turtlebot_gym.rooms.scan import Clearance, Scan

TURN = 2.0 * math.pi
SLACK = 1.5
"""Tolerance on a scan's full revolution, in beams, since drivers count both ends or one."""


def read_scan(message: LaserScan) -> Scan:
    """Return a message's scan.

    Raises:
        ValueError: If the scan has no ranges or NaN ranges, does not cover a full revolution counter-clockwise, or has
            impossible limits.
    """
    ranges, increment = np.array(message.ranges, np.float32), message.angle_increment
    beams = len(ranges)
    if not beams:
        raise ValueError("the scan has no ranges")
    if not 0.0 < increment < math.inf:
        raise ValueError(f"the scan's angle_increment must be positive and finite, got {increment:g}")
    if not math.isfinite(message.angle_min):
        raise ValueError(f"the scan's angle_min must be finite, got {message.angle_min:g}")
    if abs(beams * increment - TURN) > SLACK * increment:
        raise ValueError(f"the scan must look around a whole turn, but {beams} beams {increment:g} rad apart do not")
    if not 0.0 <= message.range_min < message.range_max:
        raise ValueError(f"the scan's range_min must be below range_max, got {message.range_min:g} and {message.range_max:g}")
    if lost := int(np.isnan(ranges).sum()):
        raise ValueError(f"{lost} of the scan's {beams} ranges are not numbers (NaN)")
    least, most = np.float32(message.range_min), np.float32(message.range_max)
    ranges[ranges == -np.inf] = least
    ranges[(ranges < least) | (ranges > most)] = np.inf
    return Scan(
        ranges, message.angle_min, increment, message.range_min, message.range_max, message.time_increment, message.scan_time
    )


def write_scan(scan: Scan, header: Header) -> LaserScan:
    """Return a scan's message."""
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


def read_clearance(message: Range) -> Clearance:
    """Return a message's clearance.

    Raises:
        ValueError: If the clearance is not a number.
    """
    if math.isnan(message.range):
        raise ValueError("the clearance is not a number")
    return Clearance(message.range)


def write_clearance(clearance: Clearance, header: Header) -> Range:
    """Return a clearance's message: for all directions, in single precision."""
    distance = float(clearance.distance)
    return Range(header=header, field_of_view=TURN, min_range=-math.inf, max_range=math.inf, range=distance)
