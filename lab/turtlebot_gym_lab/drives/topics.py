"""Topics of a ROS 2 bag by quantity; separate from their reader, so that a command line can offer them without its imports."""

from __future__ import annotations

from dataclasses import dataclass

ELSEWHERE = "add --topics.scan"
"""What a remark says of a bag whose scans are on a topic that is not read."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Topics:
    """Topics of a bag by quantity; empty for none."""

    odom: str = "/odom"
    """Odometry: the measured pose, and the twist unless `twist` names another topic."""
    truth: str = ""
    """The true pose: Odometry, PoseStamped, PoseWithCovarianceStamped, TransformStamped, PointStamped, or transforms as
    /tf:PARENT.CHILD, such as /tf:map.base_footprint; by default /ground_truth or /true_state, if there."""
    fix: str = ""
    """Measured poses that replace those of odometry, such as /pose_fix; odometry then gives the twist."""
    twist: str = ""
    """Twist or TwistStamped, such as /cmd_vel, which replaces the twist of odometry."""
    scan: str = ""
    """Scans, such as /front/scan; by default /scan."""
