"""The guard's parameters, and the collision monitor for which they ask. Does not depend on ROS."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

from cmd_vel_guard.collision import Footprint, Limits
from cmd_vel_guard.monitor import Monitor, ScanTiming
from cmd_vel_guard.values import Mount, Pose
from turtlebot_gym.config import Names, Range, check_fields

SPEED = Range(0.0, 100.0)
PLACE = Range(-1.0, 1.0, unit="m")
"""Places on a robot."""


@dataclass(frozen=True, kw_only=True)
class Parameters:
    """Parameters of ``cmd_vel_guard``; none changes while it runs. Files in ``config`` state the numbers of three robots."""

    max_linear: Annotated[float, SPEED] = 0.0
    """Highest speed, m/s."""
    max_angular: Annotated[float, SPEED] = 0.0
    """Highest turning rate, rad/s."""
    max_wheel: Annotated[float, SPEED] = 0.0
    """Highest speed of a wheel at its rim, m/s; 0 for none."""
    wheel_separation: Annotated[float, Range(0.0, 10.0, unit="m")] = 0.0
    """Distance between the wheels' tracks, m."""
    reverse: bool = True
    """Whether the robot may drive backwards."""
    enable_stamped_cmd_vel: bool = True
    """Whether velocities, in and out, are TwistStamped, as on a Jazzy robot; Twist if false."""
    body_frame: str = "base_footprint"
    """The robot's frame in the commands."""
    frame_prefix: str = ""
    """Prefix of the robot's and the scans' frame, such as "robot1/"; scans of other frames are then refused."""
    start_enabled: bool = True
    """Whether commands pass from the start; if not, ``~/enable`` is needed after every (re)start."""
    require_emergency_stop: bool = False
    """Whether enabling needs a live button; then ``start_enabled`` does not count."""
    require_standby: bool = False
    """Whether the robot stands unless cmd_vel_standby is alive. That one stops it if the guard dies."""
    max_age: Annotated[float, Range(0.0, 0.5, open_low=True, unit="s")] = 0.4
    """Age since it was sent from which a command no longer counts, s; at most 0.5."""
    measured_age: Annotated[float, Range(0.0, 0.5, open_low=True, unit="s")] = 0.5
    """Age of its measurement from which a command no longer counts, s: by the header's stamp."""
    rate: Annotated[float, Range(50.0, 200.0, unit="Hz")] = 50.0
    """Rate at which ages are checked, and highest rate of commands, Hz; 50 to 200."""
    max_acceleration: Annotated[float, Range(0.0, 1000.0, open_low=True, unit="m/s^2")] = 2.5
    """Limit of each wheel's acceleration at the rim, m/s^2; it never delays a stop."""
    speed_scale: Annotated[float, Range(0.0, 1.0, open_low=True)] = 1.0
    """Factor on every command, at most 1."""
    geofence: Annotated[float, Range(0.0, 1e6, unit="m")] = 0.0
    """Radius around the pose's origin beyond which only a person may drive, m; 0 for no fence."""
    geofence_topic: Annotated[str, Names(("odom", "estimate"))] = "odom"
    """Topic of the pose for the geofence: ``odom`` or ``estimate``."""
    geofence_frame: str = "odom"
    """Frame of that pose, without a prefix; a pose in another one does not count."""
    motion_check: bool = True
    """Whether the robot stands when it does not move as commanded by odom, or has lost it. See `moved`."""
    heed_disagreement: bool = False
    """Whether a cause on the filter's ``disagreement`` stops the robot until it is enabled."""
    collision_monitor: bool = True
    """Whether obstacles on ``scan`` limit any command; without a scan it stands. Not with an empty ``scan_frame``."""
    collision_margin: Annotated[float, Range(0.0, 1.0, unit="m")] = 0.05
    """Width of the stop zone around the footprint, m."""
    collision_time: Annotated[float, Range(0.5, 10.0, unit="s")] = 1.0
    """Time to collision below which a command is slowed down, s."""
    escape_speed: Annotated[float, Range(0.0, 0.1, unit="m/s")] = 0.05
    """Speed at which it may creep out of its stop zone, m/s; with 0 it stands."""
    scan_age: Annotated[float, Range(0.0, 0.5, open_low=True, unit="s")] = 0.4
    """Age since it was sent from which a scan no longer counts, s."""
    scan_period: Annotated[float, Range(0.0, 0.5, unit="s")] = 0.2
    """Time of one revolution of the LiDAR, s."""
    scan_error: Annotated[float, Range(0.0, 0.5)] = 0.085
    """Relative error of a range, by which the stop zone grows. For an LDS-01, 5 % plus twice 1.75 %."""
    scan_returns: Annotated[float, Range(0.0, 1.0)] = 0.02
    """Least share of a scan's beams that return something, or the robot stands, after 0.5 s of less; with 0 a cover is not
    noticed, and the robot drives in halls larger than the LiDAR's range."""
    reaction: Annotated[float, Range(0.0, 0.5, unit="s")] = 0.2
    """Longest delay of wheels and LiDAR driver, s."""
    radius: Annotated[float, Range(0.0, 10.0, unit="m")] = 0.0
    """Radius of the footprint, m."""
    scan_mount: Annotated[str, Names(("tf_static", "given"))] = "tf_static"
    """What counts where ``/tf_static`` states another mount: ``tf_static``, or ``given`` for neither, so the robot stands."""
    footprint_x: Annotated[float, PLACE] = 0.0
    """Centre of the footprint ahead of the axle, m."""
    scan_x: Annotated[float, PLACE] = 0.0
    """Position of the LiDAR ahead of the axle, m."""
    scan_y: Annotated[float, PLACE] = 0.0
    """Position of the LiDAR to the left, m."""
    scan_yaw: Annotated[float, Range(-2.0 * math.pi, 2.0 * math.pi, unit="rad")] = 0.0
    """Direction of the scan's angle 0 in the robot's frame, rad."""
    scan_frame: str = "base_scan"
    """Frame of the scans, without a prefix; scans of other frames are refused."""

    def __post_init__(self) -> None:
        check_fields(self, "")
        for name in ("max_linear", "max_angular", "wheel_separation", *(["radius"] if self.monitors else [])):
            if getattr(self, name) == 0.0:
                without = ", unless collision_monitor is false" if name == "radius" else ""
                raise ValueError(f"{name} must be a positive number{without}, got 0.")

    @property
    def monitors(self) -> bool:
        """Whether the collision monitor works."""
        return self.collision_monitor and bool(self.scan_frame)


def monitor_of(p: Parameters, now: float, mount_of: Callable[[str], Pose | None]) -> Monitor | None:
    """Return the collision monitor, if it is switched on; see `Monitor`."""
    if not p.monitors:
        return None
    timing = ScanTiming(p.scan_age, p.scan_period, p.reaction, p.scan_returns)
    body = Footprint(p.radius, p.footprint_x, Mount(p.frame_prefix + p.scan_frame, p.scan_x, p.scan_y, p.scan_yaw))
    limits = Limits(p.collision_margin, p.scan_error, p.collision_time, p.escape_speed)
    most = {"speed": p.max_linear, "turning": p.max_angular}
    return Monitor(body, limits, timing, **most, now=now, given=p.scan_mount == "given", mount_of=mount_of)
