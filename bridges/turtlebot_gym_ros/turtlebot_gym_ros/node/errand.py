"""A goal on its way: how far the robot has come, and how it ends. Does not depend on ROS."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum

from turtlebot_gym.values import Pose

CLOSER = 0.1
"""Distance by which the robot must come nearer for progress, m."""
GONE = 2.5
"""Time without an estimate after which a client is told that the robot is lost, s: a localizer that looks for itself in its map
mostly takes less."""
LOST = 1.0
"""Gap in the estimates after which the time for progress counts anew, s."""


class Failure(IntEnum):
    """Why a goal was not reached: the codes by which Nav2's servers tell it.

    References:
        Nav2, ``nav2_msgs/action``: ``FollowPath`` (100 to 199), ``NavigateToPose`` (9000 to 9099), ROS 2 Jazzy and Kilted.
    """

    NONE = 0
    NO_PROGRESS = 105
    OTHER = 9000
    BEHAVIOR_TREE = 9001
    NOT_LOCALIZED = 9002


@dataclass(kw_only=True)
class Errand:
    """A goal, how far the robot is, and the outcome."""

    goal: Pose
    """In the world frame."""
    awaited: bool = False
    """Whether somebody waits for the outcome, as an action's client does: then it is given up if it takes too long."""
    state: str = "active"
    """"active", "reached", "failed" or "cancelled"."""
    code: Failure = Failure.NONE
    """Kind of the failure."""
    reason: str = ""
    """Why it failed, one line."""
    time: float = 0.0
    """Time since it was given, s."""
    pose: Pose | None = None
    """The robot's pose when it was last known."""
    left: float = math.inf
    """Distance from there to the goal, m."""
    nearest: float = math.inf
    """Least distance to the goal so far, m ..."""
    since: float = 0.0
    """... and the time since which the robot has not come nearer by `CLOSER`, s."""
    known: float = 0.0
    """Time at which the robot's pose was last known, s."""

    @property
    def is_active(self) -> bool:
        """Whether it has not ended."""
        return self.state == "active"

    def end(self, state: str, code: Failure = Failure.NONE, reason: str = "") -> None:
        """End it, unless it has ended."""
        if self.is_active:
            self.state, self.code, self.reason = state, code, reason

    def at(self, pose: Pose) -> None:
        """Take the robot's pose."""
        left = math.dist(pose[:2], self.goal[:2])
        if self.time - self.known > LOST:
            self.since = self.time
        self.pose, self.left, self.known = pose, left, self.time
        if left < self.nearest - CLOSER:
            self.nearest, self.since = left, self.time

    def overdue(self, patience: float) -> tuple[Failure, str] | None:
        """Return why it takes too long, if so: no estimate, or no progress for ``patience``, s."""
        if self.time - self.known > (longest := min(GONE, patience)):
            return Failure.NOT_LOCALIZED, f"lost: no estimate for {longest:g} s"
        if self.time - self.since > patience:
            return Failure.NO_PROGRESS, f"no progress for {patience:g} s: is velocity_controller enabled, and the way free?"
        return None
