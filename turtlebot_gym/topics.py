"""Which topics of a ROS 2 bag hold what; apart from their reader, so that a command line can offer them at no cost."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Topics:
    """Which topics of a bag hold what; empty for none."""

    odom: str = "/odom"
    """Odometry: the measured pose, and the twist unless `twist` names another topic."""
    truth: str = ""
    """The true pose: Odometry, PoseStamped or PoseWithCovarianceStamped; by default /ground_truth or /true_state, if there."""
    fix: str = ""
    """Measured poses that take the place of odometry's, such as /pose_fix; odometry then gives the twist."""
    twist: str = ""
    """Twist or TwistStamped, such as /cmd_vel, which takes the place of odometry's twist."""
