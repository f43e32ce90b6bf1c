"""A safety layer for any policy: of the arcs on which the robot can stop in time, it drives the one nearest to the policy's."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, replace
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from turtlebot_gym.config import FINITE, NON_NEGATIVE, POSITIVE, check_fields
from turtlebot_gym.models.unicycle import execution_variances
from turtlebot_gym.observations import ROOM
from turtlebot_gym.observations.columns import columns_of
from turtlebot_gym.parameters import REFERENCE_PERIOD, Noise
from turtlebot_gym.presets import make_noise, make_robot
from turtlebot_gym.robots import Robot
from turtlebot_gym.rooms.lidar import SECTORS, SIGHT
from turtlebot_gym.values import Command
from turtlebot_gym_agents.policies.planner import PlannerPolicy
from turtlebot_gym_agents.policies.policy import Policy, PolicyWithMemory, numbers_of, shown, with_room
from turtlebot_gym_agents.policies.sight import DIRECTIONS, EDGE, HALF_SECTOR, UNSEEN, SightMotion, look, time_to_contact
from turtlebot_gym_agents.policies.yielding import Yielding

SHARES = np.array([1.0, 0.7, 0.4, 0.2, 0.0])
"""Shares of the commanded speed to try."""
TURNS = np.linspace(-1.0, 1.0, 17)
"""Turning rates to try besides the commanded one, as shares of the limit."""
TURNING = 0.3
"""Weight of a change of the turning rate, as a share of its limit, beside one of the speed."""
SURE = 3.0
"""Standard deviations of the motion's noise that must not lead to a contact."""
NEARER = 0.01
"""Distance by which a robot inside a margin may approach an obstacle within the reserve, and by which noise may move it
anywhere, m: the error of a range."""
CREEP = 0.2
"""Share of the highest speed at which a robot leaves an obstacle near which it may not turn as fast as it wants."""
BLIND, NEAR = 0.18, 0.25
"""Distances from the LiDAR, m: up to the first, no LiDAR for such robots may see anything, and an LDS-02 sees nothing below
0.16 m; places up to the second are remembered."""
SAME = 0.01
"""Difference of two ranges up to which they are of one obstacle, m."""


@dataclass(eq=False)
class SafetyLayer:
    """Drive the arc nearest to the policy's on which no contact is near, at its speed or less; the others are inadmissible.

    A round robot can turn on the spot without contact, so such an arc always exists. If only that is left, or the robot makes
    no progress, the policy's wish leads nowhere: then a `PlannerPolicy`, which has received the same observations, steers for
    ``way_out``, within the same arcs. In a passage that is slightly too narrow the robot is inside the margins of both sides:
    there arcs are admissible, down to ``least_margin``, that approach an obstacle by less than `NEARER`.

    An obstacle is assumed anywhere in its sector, at the sector's range. One that comes too near for the LiDAR is remembered,
    for the policy too. What was never seen is unknown: an LDS-01 sees nothing up to 0.047 m from a Burger's back, which
    ``margin_behind`` covers.
    """

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
    least_margin: Annotated[float, NON_NEGATIVE] = 0.01
    """... and the clearance that it always keeps, if the others are larger, m."""
    noise: str | Noise = "clean"
    """Noise of the motion, as for `turtlebot_gym.presets.make_noise`: if it moves a turning robot, the robot turns more slowly
    near obstacles, keeps farther from them, or leaves them first."""
    lidar_x: Annotated[float, FINITE] = -0.032
    """Place of the LiDAR ahead of the axle, m."""
    lag: Annotated[float, NON_NEGATIVE] = 0.1
    """Half the time of a revolution, s; on average, beams are so much older than their scan's stamp, or younger, see
    `SightMotion`."""
    way_out: Annotated[float, NON_NEGATIVE] = 12.0
    """Time for which the planner steers after the policy's wish has stopped the robot, s."""

    def __post_init__(self) -> None:
        check_fields(self, "")
        self.card = getattr(self.policy, "card", None)
        """Card of the policy, if it has one."""
        self.terms = with_room(self.policy)
        """The terms of its observations."""
        self._shown, self._sight = shown(self.policy, "policy", self.terms), columns_of(ROOM, self.terms)
        self._robot = make_robot(self.robot)
        variance, _ = execution_variances(Command(0.0, self._robot.max_angular), make_noise(self.noise).process, self.dt)
        self._drift = variance * self.dt  # growth of the place's variance at the highest turning rate, m^2/s
        self._sway = np.float64(SURE * np.sqrt(self._drift * self.reserve))
        self._guide = self.policy if isinstance(self.policy, PlannerPolicy) else PlannerPolicy(self._robot, self.dt)
        self._motion = SightMotion(self.dt, self.lag)
        self._left, self._places = np.zeros(()), np.full(2 * SECTORS, UNSEEN, np.complex128)
        self._spread = np.zeros(2 * SECTORS)  # variance of the places, m^2
        # Obstacles farther away cannot be reached within the reserve.
        margin = max(self.margin, self.margin_behind, self._sway)
        self._reach = self._robot.radius + margin + self._robot.max_linear * self.reserve

    def reset(self, mask: NDArray[np.bool_]) -> None:
        for policy in {self.policy, self._guide}:
            if isinstance(policy, PolicyWithMemory):
                policy.reset(mask)
        self._motion.reset(np.asarray(mask))
        self._left = np.where(mask, 0.0, self._left)
        self._places = np.where(np.asarray(mask)[..., None], UNSEEN, self._places)

    def __call__(self, observations: ArrayLike) -> NDArray[np.float32]:
        """Return actions (..., 2) for observations (..., n) of `terms`."""
        seen = numbers_of(observations, self.terms).astype(np.float32)
        rows = seen[..., self._sight]
        v, omega = np.moveaxis(rows[..., 5:7].astype(np.float64), -1, 0)
        self._motion.note(v * self._robot.max_linear, omega * self._robot.max_angular)
        since = self._motion.since(rows[..., -1].astype(np.float64))
        rows = self._remembered(rows, *since)
        points = look(rows, self._robot, self.dt, self.lag, edges=True, lidar_x=self.lidar_x, since=since).points
        seen[..., self._sight] = rows
        wish = np.clip(np.asarray(self._shown(seen), np.float32), -1.0, 1.0)
        guided = wish if self._guide is self.policy else self._guide(rows)
        action = self._admissible(wish, points)
        stopped = ((action[..., 0] == 0.0) | self._guide.stuck) & (wish[..., 0] != 0.0)
        self._left = np.where(stopped, round(self.way_out / self.dt), np.maximum(self._left - 1.0, 0.0))
        out = self._left > 0.0
        action[out] = self._admissible(guided[out], points[out])
        return action

    def _remembered(
        self, rows: NDArray[np.float32], moved: NDArray[np.complex128], turned: NDArray[np.complex128]
    ) -> NDArray[np.float32]:
        """Return observations that include remembered obstacles, which have come too near for the LiDAR.

        Places are in the robot's frame; one is remembered per half sector. Those that noise makes uncertain count as nearer.
        ``moved`` and ``turned`` are the current place and heading in the frame of the pose when the beams were measured.
        """
        step, turn = (part[..., None] for part in self._motion.over(np.full(rows.shape[:-1], self.dt)))
        moved, turned = moved[..., None], turned[..., None]
        # Noise grows with the turning rate, as a share of the highest one.
        share = np.angle(turn) / (self._robot.max_angular * self.dt)
        places, spread = (self._places - step) * np.conj(turn), self._spread + self._drift * share**2 * self.dt
        from_lidar = places * turned + moved - self.lidar_x  # when it measured
        at, away = np.round(np.angle(from_lidar) / HALF_SECTOR).astype(np.int64), np.abs(from_lidar)
        sector = np.round(np.angle(from_lidar) / (2.0 * HALF_SECTOR)).astype(np.int64) % SECTORS
        ranges = rows[..., -1 - SECTORS : -1] * SIGHT
        gone = (away < BLIND) & (np.take_along_axis(ranges, sector, axis=-1) > away + SAME)
        edges = np.minimum(ranges, np.roll(ranges, -1, axis=-1))
        near = np.stack([ranges * DIRECTIONS, edges * DIRECTIONS * EDGE], axis=-1)
        seen = np.where(np.abs(near) < NEAR, near, UNSEEN)
        self._places = (seen.reshape(*ranges.shape[:-1], -1) + self.lidar_x - moved) * np.conj(turned)
        # Sorted from far to near, so that of two in the same half sector the nearer one is kept.
        gone = tuple(part[np.argsort(-away[gone])] for part in np.nonzero(gone))
        half, self._spread = (*gone[:-1], at[gone] % (2 * SECTORS)), np.zeros_like(spread)
        self._places[half], self._spread[half] = places[gone], spread[gone]
        filled, nearer = rows.copy(), np.maximum(away - SURE * np.sqrt(spread), 0.0)
        np.minimum.at(filled, (*gone[:-1], sector[gone] - 1 - SECTORS), nearer[gone] / SIGHT)
        return filled

    def _admissible(self, wish: NDArray[np.float32], points: NDArray[np.complex128]) -> NDArray[np.float32]:
        """Return the admissible actions nearest to the wished ones, shape (..., 2)."""
        action, points = wish.reshape(-1, 2).copy(), points.reshape(-1, points.shape[-1])
        away = np.abs(points)
        first = np.take_along_axis(points, away.argmin(axis=-1)[:, None], axis=-1)
        with np.errstate(divide="ignore"):  # without noise, any rate
            most = np.maximum(np.abs(first) - self._robot.radius, NEARER) / self._sway
        turns = (action[:, :1] == 0.0) & (np.abs(action[:, 1:]) > most)
        action[:, :1] = np.where(turns, -CREEP * np.sign(first.real), action[:, :1])
        action[:, 1:] = np.clip(action[:, 1:], -most, most)
        close = np.flatnonzero((away <= self._reach).any(axis=-1))
        nearest = np.argsort(away[close], axis=-1)[:, : (away <= self._reach).sum(axis=-1).max(initial=1)]
        near = np.take_along_axis(points[close], nearest, axis=-1)
        short = ~self._admits(action[close], near)
        close, near = close[short], near[short]
        wishes = action[close]
        v, omega = wishes[:, :1] * SHARES, np.concatenate([wishes[:, 1:], np.clip(TURNS, -most[close], most[close])], axis=-1)
        arcs = np.stack(np.broadcast_arrays(v[:, :, None], omega[:, None, :]), axis=-1).reshape(len(v), -1 if len(v) else 1, 2)
        change = np.abs(arcs - wishes[:, None]) @ (1.0, TURNING)
        change[~self._admits(arcs, near[:, None])] = np.inf
        action[close] = np.take_along_axis(arcs, change.argmin(axis=-1)[:, None, None], axis=1)[:, 0]
        return action.reshape(wish.shape)

    def _admits(self, actions: NDArray[np.float32], points: NDArray[np.complex128]) -> NDArray[np.bool_]:
        """Return whether no contact with points (..., n) is near on the arcs of actions (..., 2)."""
        v, omega = actions[..., :1] * self._robot.max_linear, actions[..., 1:] * self._robot.max_angular
        margin = np.maximum(np.where(v < 0.0, self.margin_behind, self.margin), self._sway * np.abs(actions[..., 1:]))
        kept = np.maximum(np.abs(points) - self._robot.radius - NEARER, self.least_margin)
        radius = self._robot.radius + np.minimum(margin, kept)
        return time_to_contact(points, v, omega, radius).min(axis=-1) >= self.reserve


def within_layer(policy: Policy, robot: str | Robot, dt: float, **numbers: Any) -> Policy:
    """Return a policy within a `SafetyLayer` of these numbers; one that yields to people does so last, outside the layer."""
    if isinstance(policy, Yielding):
        return replace(policy, policy=within_layer(policy.policy, robot, dt, **numbers))
    return SafetyLayer(policy, robot, dt, **numbers)
