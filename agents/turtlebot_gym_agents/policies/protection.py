"""A safety layer: whatever a policy commands in a room, its speed is limited by the time to contact on the commanded arc."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from turtlebot_gym.parameters import REFERENCE_PERIOD
from turtlebot_gym.presets import make_robot
from turtlebot_gym.robots import Robot
from turtlebot_gym.systems import ROOM_LAYOUT
from turtlebot_gym_agents.policies.geometric import require_non_negative, require_positive
from turtlebot_gym_agents.policies.policy import Policy, PolicyWithMemory
from turtlebot_gym_agents.policies.sight import look, time_to_contact

SHARES = np.array([1.0, 0.7, 0.4, 0.2, 0.0])
"""Shares of the commanded speed that are tried, the greatest first; the last one is always safe."""


class SafetyLayer:
    """Take the greatest share of the commanded speed at which no contact is near; the turning rate stays.

    A round robot turns on the spot and meets nothing, so it never is caught. An obstacle is taken to be anywhere in its sector,
    at the sector's range. The margin covers what a Burger's LiDAR cannot see: nearer than 0.12 m, and so up to 0.047 m from the
    back of the robot.

    Args:
        policy: What commands.
        robot: A name in `turtlebot_gym.ROBOTS`, or a robot.
        dt: Control interval, s.
        reserve: Least time to contact, s.
        margin: What is to be kept clear around the robot, m.
        lag: How much older the beams are, on average, than the scan says, s.

    Raises:
        ValueError: If a number is out of its range, or the policy was made for open ground and sees no obstacles.
    """

    layout: ClassVar[int] = ROOM_LAYOUT

    def __init__(
        self,
        policy: Policy,
        robot: str | Robot = "burger",
        dt: float = REFERENCE_PERIOD,
        *,
        reserve: float = 0.5,
        margin: float = 0.05,
        lag: float = 0.1,
    ) -> None:
        require_positive(dt=dt, reserve=reserve)
        require_non_negative(margin=margin, lag=lag)
        self.card = getattr(policy, "card", None)
        """What the policy was trained for, if it says so."""
        self._policy, self._robot, self._dt = policy, make_robot(robot), dt
        self._reserve, self._radius, self._lag = reserve, self._robot.radius + margin, lag

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Let a policy with memory forget."""
        if isinstance(self._policy, PolicyWithMemory):
            self._policy.reset(mask)

    def __call__(self, observations: ArrayLike) -> NDArray[np.float32]:
        """Return actions (..., 2) for observations (..., 50)."""
        rows = np.asarray(observations, np.float32)
        actions = np.clip(np.asarray(self._policy(rows), np.float32), -1.0, 1.0)
        points = look(rows, self._robot, self._dt, self._lag, edges=True).points
        reach = self._radius + self._robot.max_linear * self._reserve
        near = np.abs(points).min(axis=-1) <= reach  # all others may drive as they like
        limited = actions.copy()
        limited[near, 0] *= self._share(actions[near], points[near])
        return limited

    def _share(self, actions: NDArray[np.float32], points: NDArray[np.complex128]) -> NDArray[np.float64]:
        """Return the share of the commanded speed that is allowed, shape (n,), for actions (n, 2) and points (n, ...)."""
        v = actions[:, :1] * self._robot.max_linear * SHARES
        omega = actions[:, 1:] * self._robot.max_angular
        time = time_to_contact(points[:, None, :], v[..., None], omega[..., None], self._radius).min(axis=-1)
        return SHARES[np.argmax(time >= self._reserve, axis=-1)]
