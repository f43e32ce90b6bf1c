"""The tracker of what moves: the environment's own, on a robot, from wheel odometry and LiDAR scans."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.beams import Beams
from turtlebot_gym.config import Range, check_fields
from turtlebot_gym.models.angles import TWO_PI
from turtlebot_gym.rooms.sectors import EDGE
from turtlebot_gym.rooms.worlds import find_lidar
from turtlebot_gym.silence import Silence, place_of
from turtlebot_gym.systems.scans import UNIFORM, sweep_of
from turtlebot_gym.tracking.bodies import POST
from turtlebot_gym.tracking.sweep import Sweep, pose_at
from turtlebot_gym.tracking.tracker import begin, look, make_memory, memory_at, on_odometry, on_scan
from turtlebot_gym.values import Odometry
from turtlebot_gym_ros.blocks.ticks import Ticks
from turtlebot_gym_ros.node.block import SCAN, Input, On, Output, Stamped, Tracks

TRAIL = 64
"""Number of odometry poses that reach back to the first beam of a scan and of the one before: 1 s at 50 Hz."""
LEAP, FASTEST = 0.2, 3.0
"""Way from which on odometry has begun elsewhere, m, and what is added to it for each second, m/s."""
MOST_BEAMS = 4096
"""Most beams of a scan; one that has more is left out."""


class PeopleTracker:
    """Track what moves, such as people, in the frame of the odometry.

    With each odometry it publishes the nearest tracks, which a policy reads as the term "tracks". It reads scans as `Localizer`
    does. Beams that return nothing say "free" unless they contradict what was seen before, see `turtlebot_gym.silence`. Where
    odometry begins elsewhere, the tracker begins anew.

    Inputs: ``odometry`` (`Odometry`, on ``odom``, every message, in the frame ``odom_frame``), ``scan`` (`Scan`, on ``scan``).
    Outputs: ``nearest`` (`Tracks`, on ``tracks``, in the robot's frame, at odometry's stamp).
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Params:
        """Parameters of the tracker."""

        odom_frame: str = ""
        """Frame of the odometry; if empty, that of the estimate."""
        lidar: str = "lds01"
        """The LiDAR, a name in `turtlebot_gym.rooms.lidar.LIDARS`, or a file. It says its noise and timing, and its mount if
        ``/tf_static`` states none."""
        max_gap: Annotated[float, Range(0.0, 3600.0, open_low=True, unit="s")] = 10.0
        """Gap in the odometry after which it starts anew, s."""
        tick: Annotated[float, Range(0.0, 1.0, unit="s")] = 0.0
        """Interval in which what is seen moves at once, as in a simulation, whose LiDAR nothing covers, s; 0 on a robot."""

        def __post_init__(self) -> None:
            check_fields(self, "")

    inputs = {"odometry": Input(topic="odom", type=Odometry, reliable=False, sole=True), "scan": replace(SCAN, wakes=False)}
    outputs = {"nearest": Output(topic="tracks", type=Tracks)}
    trigger = On("odometry")

    def __init__(self, params: Params) -> None:
        self._lidar, self._tick = find_lidar(params.lidar), params.tick
        self.trigger = replace(self.trigger, max_gap=params.max_gap)
        self.inputs = {**self.inputs, "odometry": replace(self.inputs["odometry"], frame=params.odom_frame or None)}
        self.reset()

    def reset(self) -> None:
        """Start anew with the next odometry."""
        self._memory = memory_at(make_memory(1, beams=MOST_BEAMS, poses=TRAIL), 0)
        self._ticks, self._measured, self._begun = Ticks(), -math.inf, False
        self._silence = Silence(POST)
        self.notice: str | None = None
        """Why scans are left out, if so."""

    def step(self, dt: float, odometry: Odometry, scan: Stamped) -> dict[str, Any]:
        """Return the tracks after odometry that is ``dt`` later than the one before, s."""
        (x, y, _), (_, last_x, last_y, _) = odometry.pose, self._memory.trail[0]
        leaps = self._begun and math.hypot(x - last_x, y - last_y) > LEAP + FASTEST * dt
        if leaps:
            self.reset()
        self.notice = "odometry began elsewhere: what was seen before is forgotten" if leaps else None
        if not self._begun:
            begin(self._memory, 0.0, odometry.pose)
            self._measured, self._begun = -scan.age, True
        else:
            self._ticks.advance(dt)
        if odometry.measured and self._ticks.time > self._memory.trail[0, 0]:
            on_odometry(self._memory, self._ticks.time, odometry.pose)
        self._look_at(scan)
        tracks, seen = self._memory.tracks, self._memory.seen
        look(tracks, seen, self._ticks.time, odometry.pose, odometry.twist, UNIFORM * self._lidar.accuracy)
        return {"nearest": Tracks(seen.tolist())}

    def _look_at(self, scan: Stamped) -> None:
        """Update the tracks by a scan, if it is new and the odometry has reached its last beam."""
        stamp = self._ticks.time - scan.age
        if stamp <= self._measured + 1e-6:
            return
        if len(scan.value.ranges) > MOST_BEAMS:
            self.notice = f"scans of {len(scan.value.ranges)} beams are left out: {MOST_BEAMS} are the most"
            return
        sweep = self._sweep_of(scan, stamp)
        if sweep.last <= self._ticks.time + 1e-6:
            self._measured = stamp
            on_scan(self._memory, scan.value.ranges if self._tick else self._believed(scan.value.ranges, sweep), sweep)

    def _believed(self, ranges: NDArray[np.float32], sweep: Sweep) -> NDArray[np.float32]:
        """Return the ranges of a scan without the beams that say nothing, m."""
        beams = Beams(sweep.first + sweep.step * np.arange(sweep.number, dtype=np.float64), ranges, abs(sweep.step))
        times = sweep.last, sweep.last - sweep.interval * sweep.number
        latest, earliest = (place_of(pose_at(self._memory.trail, time), (sweep.x, sweep.y, 0.0)) for time in times)
        return self._silence.hear(beams, sweep.range_max, (latest, earliest)).ranges

    def _sweep_of(self, scan: Stamped, stamp: float) -> Sweep:
        """Return how a scan was measured."""
        lidar, sent, mount = self._lidar, scan.value, scan.mount
        number, turn = len(sent.ranges), sent.increment * len(sent.ranges)
        sweep = sweep_of(lidar, 0.0, self._tick)
        if number != lidar.beams or abs(sent.first) > EDGE or abs(turn - TWO_PI) > EDGE:
            interval = sent.beam_period or (1.0 / (lidar.rate * number) if lidar.turning else 0.0)
            first = lidar.yaw + sent.first
            sweep = sweep._replace(number=number, first=first, step=sent.increment, interval=interval, range_max=sent.range_max)
        if mount is not None and max(map(abs, (mount.theta - lidar.yaw, mount.x - lidar.x, mount.y - lidar.y))) > EDGE:
            sweep = sweep._replace(first=sweep.first + mount.theta - lidar.yaw, x=mount.x, y=mount.y)
        last = stamp if lidar.stamped_at_end else stamp + sweep.interval * number
        return sweep._replace(last=round(last, 9))
