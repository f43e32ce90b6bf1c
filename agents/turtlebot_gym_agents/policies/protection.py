"""A safety layer for any policy: of the arcs on which the robot can stop in time, it drives the one nearest to the policy's."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from turtlebot_gym.parameters import REFERENCE_PERIOD
from turtlebot_gym.presets import make_robot
from turtlebot_gym.robots import Robot
from turtlebot_gym.systems import ROOM_LAYOUT
from turtlebot_gym.validation import FINITE, NON_NEGATIVE, POSITIVE, typed
from turtlebot_gym_agents.policies.policy import Policy, PolicyWithMemory
from turtlebot_gym_agents.policies.reactive import VectorFieldHistogramPolicy
from turtlebot_gym_agents.policies.sight import look, time_to_contact

SHARES = np.array([1.0, 0.7, 0.4, 0.2, 0.0])
"""Shares of the commanded speed to try."""
TURNS = np.linspace(-1.0, 1.0, 17)
"""Turning rates to try besides the commanded one, as shares of the limit."""
TURNING = 0.3
"""Weight of a change of the turning rate, as a share of its limit, beside one of the speed."""
NEARER = 0.01
"""Way by which a robot inside a margin may come nearer to an obstacle in the reserve, m: the error of a range."""


@dataclass(eq=False)
class SafetyLayer:
    """Drive the arc nearest to the policy's on which no contact is near, at its speed or less; the others are inadmissible.

    A round robot can turn on the spot without contact, so there always is one. Where nothing else is left, the policy's wish
    leads nowhere: then `VectorFieldHistogramPolicy` steers for ``way_out``, within the same arcs.

    In a passage that is a little too narrow the robot is inside the margins of both sides. There it may go on: inside the
    margin of an obstacle, down to ``least_margin``, an arc is free that does not lead nearer to it by `NEARER`.

    An obstacle is assumed anywhere in its sector, at the sector's range. A Burger's LiDAR sees nothing nearer than 0.12 m, and
    so up to 0.047 m from the robot's back, which ``margin_behind`` covers.

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
    margin: Annotated[float, NON_NEGATIVE] = 0.02
    """Clearance to keep around the robot, m ..."""
    margin_behind: Annotated[float, NON_NEGATIVE] = 0.05
    """... and when it drives backwards, m ..."""
    least_margin: Annotated[float, NON_NEGATIVE] = 0.05
    """... and that it keeps in any case if the others are larger, m."""
    lidar_x: Annotated[float, FINITE] = -0.032
    """Place of the LiDAR ahead of the axle, m."""
    lag: Annotated[float, NON_NEGATIVE] = 0.1
    """Mean age of the beams beyond the stated age of the scan, s."""
    way_out: Annotated[float, NON_NEGATIVE] = 4.0
    """Time for which geometry steers after the policy's wish has stopped the robot, s."""

    def __post_init__(self) -> None:
        typed(self, "")
        self.card = getattr(self.policy, "card", None)
        """Card of the policy, if it has one."""
        self._robot = make_robot(self.robot)
        self._guide = VectorFieldHistogramPolicy(self._robot, self.dt)
        self._left = np.zeros(())

    def reset(self, mask: NDArray[np.bool_]) -> None:
        for policy in (self.policy, self._guide):
            if isinstance(policy, PolicyWithMemory):
                policy.reset(mask)
        self._left = np.where(mask, 0.0, np.broadcast_to(self._left, np.shape(mask)))

    def __call__(self, observations: ArrayLike) -> NDArray[np.float32]:
        """Return actions (..., 2) for observations (..., 50)."""
        rows = np.asarray(observations, np.float32)
        points = look(rows, self._robot, self.dt, self.lag, edges=True, lidar_x=self.lidar_x).points
        wish, guided = (np.clip(np.asarray(policy(rows), np.float32), -1.0, 1.0) for policy in (self.policy, self._guide))
        action = self._admissible(wish, points)
        stopped = (action[..., 0] == 0.0) & (wish[..., 0] != 0.0)
        self._left = np.where(stopped, round(self.way_out / self.dt), np.maximum(self._left - 1.0, 0.0))
        out = self._left > 0.0
        action[out] = self._admissible(guided[out], points[out])
        return action

    def _admissible(self, wish: NDArray[np.float32], points: NDArray[np.complex128]) -> NDArray[np.float32]:
        """Return the admissible actions nearest to others, shape (..., 2)."""
        action = wish.copy()
        short = ~self._admits(wish, points)
        wishes, there = wish[short], points[short]
        v, omega = wishes[:, :1] * SHARES, np.concatenate([wishes[:, 1:], np.tile(TURNS, (len(wishes), 1))], axis=-1)
        arcs = np.stack(np.broadcast_arrays(v[:, :, None], omega[:, None, :]), axis=-1).reshape(len(v), -1 if len(v) else 1, 2)
        # No robot comes farther within the reserve.
        reach = self._robot.radius + max(self.margin, self.margin_behind) + self._robot.max_linear * self.reserve
        away = np.abs(there)
        nearest = np.argsort(away, axis=-1)[:, : (away <= reach).sum(axis=-1).max(initial=1)]
        change = np.abs(arcs - wishes[:, None]) @ (1.0, TURNING)
        change[~self._admits(arcs, np.take_along_axis(there, nearest, axis=-1)[:, None])] = np.inf
        action[short] = np.take_along_axis(arcs, change.argmin(axis=-1)[:, None, None], axis=1)[:, 0]
        return action

    def _admits(self, actions: NDArray[np.float32], points: NDArray[np.complex128]) -> NDArray[np.bool_]:
        """Return whether no contact with points (..., n) is near on the arcs of actions (..., 2)."""
        v, omega = actions[..., :1] * self._robot.max_linear, actions[..., 1:] * self._robot.max_angular
        margin = np.where(v < 0.0, self.margin_behind, self.margin)
        kept = np.maximum(np.abs(points) - self._robot.radius - NEARER, self.least_margin)
        radius = self._robot.radius + np.minimum(margin, kept)
        return time_to_contact(points, v, omega, radius).min(axis=-1) >= self.reserve
