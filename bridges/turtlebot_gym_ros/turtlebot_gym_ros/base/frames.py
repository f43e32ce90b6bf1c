"""Frames of a robot and its sensors. Does not depend on ROS."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Common:
    """Parameters of every node; a block's parameters may override their defaults."""

    frame: str = "odom"
    """World frame; poses in other frames are refused."""
    body_frame: str = "base_footprint"
    """The robot's frame in estimates and commands."""
    frame_prefix: str = ""
    """Prefix of both frames, such as "robot1/" for robot1/odom, so that robots share one tree. It is like that of
    robot_state_publisher."""
    enable_stamped_cmd_vel: bool = True
    """Whether velocities are TwistStamped, as on a Jazzy robot, or Twist, as on a Humble one."""
    start_enabled: bool = False
    """Whether a node that moves a robot starts enabled, without a call of ``~/enable``."""
    lock_step: bool = False
    """Whether simulated time waits for each node's answer, in all alike; never on a robot. See `lockstep`."""

    def __post_init__(self) -> None:
        if self.lock_step and not self.enable_stamped_cmd_vel:
            raise ValueError("lock_step needs enable_stamped_cmd_vel: a Twist belongs to no step, and works in real time only.")

    def fixed(self, frame: str | None = None) -> str:
        """A frame with its prefix; None for the world frame."""
        return self.frame_prefix + (self.frame if frame is None else frame)
