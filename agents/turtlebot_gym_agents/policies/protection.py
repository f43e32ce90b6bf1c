"""A safety layer for any policy: the time to contact on its arc limits the speed."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from turtlebot_gym.parameters import REFERENCE_PERIOD
from turtlebot_gym.presets import make_robot
from turtlebot_gym.robots import Robot
from turtlebot_gym.systems import ROOM_LAYOUT
from turtlebot_gym.validation import NON_NEGATIVE, POSITIVE, typed
from turtlebot_gym_agents.policies.policy import Policy, PolicyWithMemory
from turtlebot_gym_agents.policies.sight import look, time_to_contact

SHARES = np.array([1.0, 0.7, 0.4, 0.2, 0.0])
"""Shares of the commanded speed to try, largest first; the last one is always safe."""


@dataclass(eq=False)
class SafetyLayer:
    """Use the largest share of the commanded speed at which no contact is near; the turning rate is unchanged.

    A round robot can turn on the spot without contact, so it never gets stuck. An obstacle is assumed anywhere in its sector,
    at the sector's range. The margin covers the blind zone of a Burger's LiDAR: nearer than 0.12 m, and so up to 0.047 m from
    the back of the robot.

    Raises:
        ValueError: If a number is out of its range, or the policy was made for open ground and sees no obstacles.
    """

    layout: ClassVar[int] = ROOM_LAYOUT

    policy: Policy
    """The policy to protect."""
    robot: str | Robot = "burger"
    """A name in `turtlebot_gym.ROBOTS`, or a robot."""
    dt: Annotated[float, POSITIVE] = REFERENCE_PERIOD
    """Control interval, s."""
    _: KW_ONLY
    reserve: Annotated[float, POSITIVE] = 0.5
    """Least time to contact, s."""
    margin: Annotated[float, NON_NEGATIVE] = 0.05
    """Clearance to keep around the robot, m."""
    lag: Annotated[float, NON_NEGATIVE] = 0.1
    """Mean age of the beams beyond the stated age of the scan, s."""

    def __post_init__(self) -> None:
        typed(self, "")
        self.card = getattr(self.policy, "card", None)
        """Card of the policy, if it has one."""
        self._robot = make_robot(self.robot)
        self._radius = self._robot.radius + self.margin

    def reset(self, mask: NDArray[np.bool_]) -> None:
        if isinstance(self.policy, PolicyWithMemory):
            self.policy.reset(mask)

    def __call__(self, observations: ArrayLike) -> NDArray[np.float32]:
        """Return actions (..., 2) for observations (..., 50)."""
        rows = np.asarray(observations, np.float32)
        actions = np.clip(np.asarray(self.policy(rows), np.float32), -1.0, 1.0)
        points = look(rows, self._robot, self.dt, self.lag, edges=True).points
        # No robot comes farther within the reserve.
        reach = self._radius + self._robot.max_linear * self.reserve
        near = np.abs(points).min(axis=-1) <= reach  # all others are not limited
        limited = actions.copy()
        limited[near, 0] *= self._share(actions[near], points[near])
        return limited

    def _share(self, actions: NDArray[np.float32], points: NDArray[np.complex128]) -> NDArray[np.float64]:
        """Return the allowed share of the commanded speed, shape (n,)."""
        v = actions[:, :1] * self._robot.max_linear * SHARES
        omega = actions[:, 1:] * self._robot.max_angular
        time = time_to_contact(points[:, None, :], v[..., None], omega[..., None], self._radius).min(axis=-1)
        return SHARES[np.argmax(time >= self.reserve, axis=-1)]
