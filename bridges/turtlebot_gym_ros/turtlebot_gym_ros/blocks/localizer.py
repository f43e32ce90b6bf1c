"""The localizer: the environment's own, on a robot, in the place of AMCL."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.config import Names, Range, check_fields
from turtlebot_gym.estimation.agreement import Agreement
from turtlebot_gym.estimation.ekf import Estimate
from turtlebot_gym.localization.bank import COLUMNS, ROWS
from turtlebot_gym.localization.hypotheses import look, nowhere
from turtlebot_gym.localization.information import ScanPoints
from turtlebot_gym.localization.localizer import LOST, SILENT, TRACKING, UNSURE, Located, locate, move, state_of
from turtlebot_gym.localization.points import Timing, directions, remember, rest, swept, to_points
from turtlebot_gym.localization.tuning import make_localizer
from turtlebot_gym.models.angles import TWO_PI, sincos, wrap
from turtlebot_gym.models.odometry import increment
from turtlebot_gym.parameters import REFERENCE_PERIOD
from turtlebot_gym.presets import make_filter, make_noise, make_robot
from turtlebot_gym.rooms.grid import GridMap
from turtlebot_gym.rooms.lidar import aim
from turtlebot_gym.rooms.maps import read_map
from turtlebot_gym.rooms.sectors import EDGE
from turtlebot_gym.rooms.worlds import find_lidar
from turtlebot_gym.systems.scans import drift_of
from turtlebot_gym.values import ORIGIN, Command, Odometry, Pose
from turtlebot_gym_ros.blocks.credible import DISAGREEMENT, Credibility
from turtlebot_gym_ros.blocks.ticks import Ticks
from turtlebot_gym_ros.node.block import (
    COMMANDED,
    INITIAL_POSE,
    RESUME,
    SCAN,
    TF,
    InitialPose,
    Input,
    Nis,
    On,
    Output,
    Stamped,
    Transform,
)

TRAIL = 64
"""Number of odometry poses that reach back to the first beam of a scan: 1 s at 50 Hz."""
FAR = 20.0
"""Greatest range that is used, m: the end of a longer beam moves by its heading's error more than a map's cells are wide."""
AHEAD = 0.1
"""Time by which the transform to ``odom`` is stamped ahead, s, so that it holds until the next one."""
STATES = {TRACKING: "tracking", UNSURE: "unsure", LOST: "lost"}
"""States of the localizer in the diagnostics."""
MAP_INPUT = Input(topic="map", type=GridMap, max_age=None, latched=True)
MAP_OUTPUT = Output(topic="map", type=GridMap, latched=True)


class Localizer:
    """Estimate the pose in a known map from wheel odometry and LiDAR scans.

    It moves its belief with each odometry, and corrects it by each scan as soon as the odometry reaches the scan's last beam.
    A scan counts as the LiDAR's preset if it agrees with it to single precision; otherwise as the message says. Its mount
    is that of ``/tf_static``, or the preset's.

    Where it starts, ``start`` says. A robot that is lost looks for itself in the whole map; meanwhile no estimate is published,
    so that all that rests on it stops by the age of its inputs, unless ``when_lost`` is "drive". A pose on ``initialpose``, as
    RViz sends it, puts it elsewhere; the service ``reinitialize_global_localization`` makes it look anew. Odometry that
    contradicts itself or the command in force (`agreement`) is refused, as by `KalmanFilter`.

    Inputs: ``odometry`` (`Odometry`, on ``odom``, in the frame ``odom_frame``), ``scan`` (`Scan`, on ``scan``), ``command``,
    ``initial_pose`` and ``resume`` as for `KalmanFilter`, and without a map's file ``map`` (`GridMap`, on ``map``). Outputs:
    ``pose`` (`Located`, on ``amcl_pose``), ``nis`` (`Nis`, on ``nis``), ``estimate`` (`Estimate`, on ``estimate``), at
    odometry's stamp, in the frame ``frame``; ``disagreement`` as for `KalmanFilter`; with ``publish_tf`` the transform from
    ``frame`` to ``odom_frame`` on ``/tf``; and a map's file as ``map`` (`GridMap`, on ``map``), once.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Params:
        """Parameters of the localizer."""

        frame: str = "map"
        """Frame of the map, and of the estimate."""
        odom_frame: str = "odom"
        """Frame of the odometry."""
        map: str = ""
        """Map, as map_server takes it (FILE.yaml); if empty, that on the topic ``map``."""
        hits: bool = True
        """Whether occupied cells are where a LiDAR's hits fell, as by SLAM, or what is solid."""
        localizer: str = "robot"
        """Assumptions: a name in `turtlebot_gym.localization.tuning.LOCALIZERS`, or a file of them."""
        lidar: str = "lds01"
        """The LiDAR, a name in `turtlebot_gym.rooms.lidar.LIDARS`, or a file. It says its timing, and its mount if
        ``/tf_static`` states none."""
        robot: str = "burger"
        """A name in `turtlebot_gym.robots.ROBOTS`, or a file: its limits are those of its odometry."""
        noise: str = "wheel"
        """Noise of the wheels: a name in `turtlebot_gym.presets.NOISES`, or a FILE.yaml."""
        start: Annotated[str, Names(("unknown", "odometry"))] = "unknown"
        """"unknown", somewhere in the map, or "odometry", where the odometry says. The latter is for a robot that is switched
        on at the map's origin."""
        when_lost: Annotated[str, Names(("stop", "drive"))] = "stop"
        """While the robot is lost: "stop", without an estimate, or "drive", by its belief. In lock-step "drive", since each
        step needs an answer."""
        max_gap: Annotated[float, Range(0.0, 3600.0, open_low=True, unit="s")] = 10.0
        """Gap in the odometry after which it starts anew, s."""
        publish_tf: bool = False
        """Whether to publish the transform from ``frame`` to ``odom_frame``; needs ``tf2_msgs``."""

        def __post_init__(self) -> None:
            check_fields(self, "")

    inputs = {
        "odometry": Input(topic="odom", type=Odometry, reliable=False, sole=True),
        "scan": replace(SCAN, wakes=False),
        "command": COMMANDED,
        "initial_pose": INITIAL_POSE,
        "resume": RESUME,
    }
    outputs = {
        "pose": Output(topic="amcl_pose", type=Located, latched=True),
        "nis": Output(topic="nis", type=Nis),
        "estimate": Output(topic="estimate", type=Estimate),
        "disagreement": DISAGREEMENT,
    }
    trigger = On("odometry")

    nav2_name = "amcl"
    """Name of the node of Nav2 for which it stands."""

    def __init__(self, params: Params) -> None:
        self._params, self._lidar = params, find_lidar(params.lidar)
        self.trigger = replace(self.trigger, max_gap=params.max_gap)
        self.inputs = {**self.inputs, "odometry": replace(self.inputs["odometry"], frame=params.odom_frame)}
        self._grid: GridMap | None = None
        self._unsaid: GridMap | None = None
        if params.map:
            self._take_map(read_map(params.map).map)
            self._unsaid, self.outputs = self._grid, {**self.outputs, "map": MAP_OUTPUT}
        else:
            self.inputs = {**self.inputs, "map": MAP_INPUT}
        if params.publish_tf:
            self.outputs = {**self.outputs, "tf": TF}
        self._q: Any = make_localizer(params.localizer, self._lidar)
        noise = make_noise(params.noise)
        self._tuning = make_filter("matched", noise)
        self._agreement, self._verdict = Agreement(make_robot(params.robot), noise), Credibility()
        self._beams = np.zeros((3, self._lidar.beams))
        aim(self._beams, self._lidar)
        self._points = np.empty((5, self._q.beams))
        self.services = {"reinitialize_global_localization": self.seek}
        """Functions that the node offers as services without arguments, by name."""
        self.notice: str | None = None
        """Why the localizer is not sure, if so."""
        self.figures: dict[str, Any] = {}
        """Its state, and the evidence for it."""
        self.reset()

    def _take_map(self, grid: GridMap | None) -> None:
        assert grid is not None
        self._grid, self._field = grid, grid.field(hits=self._params.hits)

    def reset(self) -> None:
        """Start anew with the next odometry."""
        self._located: Located | None = None
        self._trail, self._bank = np.empty((TRAIL, 4)), np.zeros((ROWS, COLUMNS))
        self._ticks = Ticks()
        self._agreement.begin()
        self.notice = None

    @property
    def fault(self) -> str | None:
        """Why odometry is not believed any more, until a person lets the localizer go on."""
        return self._verdict.fault

    def seek(self) -> None:
        """Look for the robot in the whole map, whatever is believed."""
        if self._located is not None:
            self._located = nowhere(self._q)._replace(scans=self._located.scans, moves=self._located.moves)

    def step(
        self,
        dt: float,
        odometry: Odometry,
        scan: Stamped,
        map: GridMap | None = None,
        initial_pose: InitialPose | None = None,
        command: Command | None = None,
        resume: object = None,
    ) -> dict[str, Any]:
        """Return the belief after odometry that is ``dt`` later, s; none if it is lost, or odometry is not believed."""
        if map is not None and map is not self._grid:
            self._take_map(map)
        if self._agreement.cause and resume is not None:  # the robot has stood since, whatever became of its odometry
            self._odometry, dt = odometry, 0.0
        if initial_pose is not None or resume is not None:
            self._agreement.begin()
        if dt <= 0.0 and self._located is not None:
            self._agreement.pause()
        if why := self._agreement.judge(max(dt, 0.0), odometry, command):
            self.notice = f"odometry refused: {why}"
            return self._verdict.news(self._agreement.cause)
        if self._located is None:
            after = self._begin(odometry, scan)
        else:
            if dt > 0.0:
                self._ticks.advance(dt)
            else:  # steps were skipped: how long ago the beams of a scan were measured is not known until the next one
                dt = self._ticks.dt or REFERENCE_PERIOD
                rest(self._trail, self._ticks.time, odometry.pose)
                self._measured = self._ticks.time - scan.age
            before, drift = self._odometry, drift_of(self._odometry.twist, self._tuning, dt)
            after = move(self._located, before.pose, odometry.pose, odometry.twist, drift, dt, self._q)
            if odometry.measured:
                remember(self._trail, self._ticks.time, odometry.pose)
        if initial_pose is not None:
            after = self._take_seat(after, initial_pose)
        self._located, self._odometry = self._correct(after, scan), odometry
        drawn, self._unsaid = self._unsaid, None
        return self._answer(self._located, odometry) | ({"map": drawn} if drawn else {}) | self._verdict.news("")

    def _begin(self, odometry: Odometry, scan: Stamped) -> Located:
        """Return the belief at the first odometry; scans from before it are not used."""
        rest(self._trail, 0.0, odometry.pose)
        self._measured = -scan.age
        if self._params.start == "odometry":
            x, y, heading = self._tuning.R
            return locate(odometry.pose, (x, y, heading), self._q)
        return nowhere(self._q)

    def _take_seat(self, located: Located, initial_pose: InitialPose) -> Located:
        """Return the belief where a person says that the robot is."""
        pose, (x, y, heading), *_, (xy, xt, yt) = initial_pose
        if heading == math.inf:
            return located
        place = locate(pose, (x, y, heading), self._q)
        belief = place.belief._replace(covariance=place.belief.covariance._replace(xy=xy, xt=xt, yt=yt))
        return place._replace(belief=belief, scans=located.scans, moves=located.moves)

    def _correct(self, located: Located, scan: Stamped) -> Located:
        """Condition the belief on a scan, if it is new and the odometry has reached its last beam."""
        stamp = self._ticks.time - scan.age
        if stamp <= self._measured + 1e-6:
            return located
        beams, timing = self._seen(scan, stamp)
        if timing.last > self._ticks.time + 1e-6:
            return located  # the next odometry says from where it was seen
        assert self._grid is not None
        self._measured, ranges, q = stamp, scan.value.ranges, self._q
        number = to_points(ranges, beams, int(located.scans), timing, self._trail, self._points)
        unseen, points = swept(timing, len(ranges), self._trail), self._points
        sight = ScanPoints(self._field, self._grid.frame, points, number)
        return look(located, self._bank, sight, self._wheels(), q, unseen)

    def _wheels(self) -> Pose:
        return Pose(*self._trail[0, 1:4].tolist())

    def _seen(self, scan: Stamped, stamp: float) -> tuple[NDArray[np.float64], Timing]:
        """Return the directions of a scan's beams in the robot's frame, and when and from where they were measured."""
        lidar, sent, mount = self._lidar, scan.value, scan.mount
        number, turn = len(sent.ranges), sent.increment * len(sent.ranges)
        at = mount or Pose(lidar.x, lidar.y, lidar.yaw)
        beams, interval = self._beams, 1.0 / (lidar.rate * number) if lidar.turning else 0.0
        is_preset = number == lidar.beams and abs(sent.first) < EDGE and abs(turn - TWO_PI) < EDGE
        if not is_preset or abs(wrap(at.theta - lidar.yaw)) > EDGE:
            beams = directions(at.theta + sent.first + sent.increment * np.arange(number))
            interval = sent.beam_period or interval
        last = stamp if lidar.stamped_at_end else stamp + interval * number
        return beams, Timing(round(last, 9), interval, at.x, at.y, min(float(sent.range_max), FAR))

    def _answer(self, located: Located, odometry: Odometry) -> dict[str, Any]:
        """Return what is published of a belief, and report its state."""
        state, fits = state_of(located, self._q), f"{100.0 * located.fits:.0f} % of the beams fit the map"
        why = f"no scan has agreed with the map for {SILENT:g} s, {fits}" if located.silent > SILENT else fits
        self.notice = None if state == TRACKING else f"{STATES[state]}: {why}"
        self.figures = {
            "localization": STATES[state],
            "fitting beams": f"{located.fits:.2f}",
            "weight of the best hypothesis": f"{located.weight:.2f}",
        }
        if state == LOST and self._params.when_lost == "stop":
            return {}
        evidence = Nis(located.nis, located.fits, located.weight)
        values: dict[str, Any] = {"pose": located, "nis": evidence, "estimate": Estimate(located.belief, located.nis, 0.0)}
        if self._params.publish_tf:
            mean, wheels = located.belief.mean, odometry.pose
            frame = increment(Pose(*mean[:3]), wheels, ORIGIN, sincos(wrap(mean.theta - wheels.theta)))
            values["tf"] = Stamped(Transform(frame, self._params.odom_frame), -AHEAD)
        return values
