"""Scans for the collision monitor, and the robot that hears them."""

import math

import numpy as np

from cmd_vel_guard.collision import Footprint, Limits, RawScan, read, view_of
from cmd_vel_guard.monitor import Monitor, ScanTiming
from cmd_vel_guard.values import Command, Mount
from turtlebot_gym import beams

MOUNT = Mount("base_scan", 0.0, 0.0, 0.0)
BODY = Footprint(0.1, 0.0, MOUNT)
LIMITS = Limits(margin=0.05, error=0.1, time=1.0, escape_speed=0.04)
TIMING = ScanTiming(age=0.4, period=0.2, reaction=0.2)
AHEAD, BACK = Command(0.2, 0.0), Command(-0.2, 0.0)
T = 100.0


def narrow_gap(body, limits, speed):
    return beams.narrow_gap(body.radius, limits.margin + speed * limits.time)


NOISE = np.random.default_rng(5)


def hall():
    """A scan of a round hall, never the same to the bit: a LiDAR that repeats itself is frozen."""
    return scan(2.0 + NOISE.normal(0.0, 1e-4, 36))


def scan(ranges, **changes):
    ranges = np.asarray(ranges, np.float32)
    step = 2.0 * math.pi / max(len(ranges), 1)
    return RawScan(ranges, 0.0, step, 0.12, 3.5, "base_scan")._replace(**changes)


def measured_anew(scan, k):
    """A scan whose ranges differ in their last places, as those of a LiDAR at work do."""
    return scan._replace(ranges=np.asarray(scan.ranges, np.float32) * np.float32(1.0 + 1e-6 * (k % 7)))


def wall(distance, direction=0.0, beams=360, **changes):
    """A scan of one straight wall."""
    angles = 2.0 * math.pi * np.arange(beams) / beams
    cosine = np.cos(angles - direction)
    with np.errstate(divide="ignore"):
        ranges = np.where(cosine > 0.0, distance / cosine, np.inf)
    return scan(np.where(ranges <= 3.5, ranges, np.inf), **changes)


def points(*rows):
    return np.array(rows, np.float64).reshape(-1, 3).T


def seen_by(scan, body=BODY, limits=LIMITS, reach=10.0):
    return view_of(read(scan, body, limits), body, limits, reach=reach, narrow=narrow_gap(body, limits, 0.3), room=0.0).seen


def standing(body=BODY, limits=LIMITS, timing=TIMING):
    return Monitor(body, limits, timing, speed=0.3, turning=3.0, now=T - 10.0)


def with_gap(width_deg, at_deg, around=2.0, beams=360):
    """A scan that says nothing in a sector around a direction."""
    off = np.abs((np.arange(beams) * 360.0 / beams - at_deg + 180.0) % 360.0 - 180.0)
    return scan(np.where(off < 0.5 * width_deg, np.nan, around), range_min=0.0)
