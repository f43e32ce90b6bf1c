"""Stop for people: stand while a tracked person may come into contact before the robot could stop.

Only contact with a moving robot counts. A command acts one interval late and holds until the next one, so the way must be free
until the next command could have stopped the robot. A disc holds each person's place with probability 95 %: if all tracked
people stay within theirs, a robot whose speed follows commands at once touches none of them while it moves. Only the nearest
tracks are known.
"""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from turtlebot_gym.config import POSITIVE, Range, check_fields
from turtlebot_gym.models.unicycle import limit
from turtlebot_gym.observations import NEAREST, ROOM, TRACKS, TWIST
from turtlebot_gym.observations.columns import columns_of
from turtlebot_gym.parameters import REFERENCE_PERIOD
from turtlebot_gym.presets import make_robot
from turtlebot_gym.robots import Robot
from turtlebot_gym.values import Command
from turtlebot_gym_agents.policies.policy import Policy, PolicyWithMemory, numbers_of, shown, terms_of
from turtlebot_gym_agents.policies.sight import arc


def passing(
    to: NDArray[np.float64], walks: NDArray[np.float64], end: float, grows: Any = 0.0
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return when the edge of a disc that goes straight on is nearest, s, and how near, m, both of shape (...).

    ``to`` is the place of its middle and ``walks`` its velocity relative to the robot, shape (..., 2), m and m/s. It is looked
    at until ``end``, s, while its radius, 0 at first, ``grows``, m/s.
    """
    speed = np.maximum(np.linalg.norm(walks, axis=-1), 1e-9)
    along = (to * walks).sum(axis=-1) / speed
    aside = np.sqrt(np.maximum((to**2).sum(axis=-1) - along**2, 0.0))
    with np.errstate(divide="ignore", invalid="ignore"):  # an edge that is faster than its disc comes nearer until the end
        beyond = np.where(grows < speed, aside * grows / np.sqrt(speed**2 - np.minimum(grows, speed) ** 2), np.inf)
    at = np.clip((beyond - along) / speed, 0.0, end)
    return at, np.linalg.norm(to + walks * at[..., None], axis=-1) - grows * at


@dataclass(eq=False)
class Yielding:
    """Drive by a policy, and stand still while the robot might meet somebody before it stands.

    The term `turtlebot_gym.observations.TRACKS` gives each person's place and velocity with standard deviations. A stopped
    robot does not turn either, since wheels sway and may move its edge into a person. Obstacles that stand are left to a
    `SafetyLayer` within this policy.
    """

    policy: Policy
    """The policy that drives."""
    robot: str | Robot = "burger"
    """A name in `turtlebot_gym.ROBOTS`, or a robot."""
    dt: Annotated[float, POSITIVE] = REFERENCE_PERIOD
    """Control interval, s."""
    _: KW_ONLY
    confidence: Annotated[float, Range(0.0, 1.0, open_high=True)] = 0.95
    """Probability that a person is within the disc that the robot avoids, if the tracks' deviations are right."""

    def __post_init__(self) -> None:
        check_fields(self, "")
        self.card = getattr(self.policy, "card", None)
        """Card of the policy, if it has one."""
        own = terms_of(self.policy) or ROOM
        self.terms = (*own, *(term for term in (TWIST, TRACKS) if term not in own))
        """The terms of its observations."""
        self._shown = shown(self.policy, "policy", self.terms)
        self._robot = make_robot(self.robot)
        self._twist, self._tracks = (columns_of((term,), self.terms) for term in (TWIST, TRACKS))
        self._stopping = self.dt + self._robot.max_linear / self._robot.max_linear_acceleration  # after an action begins to act
        # The radius that holds a share of a normal distribution in the plane, in roots of the trace of its covariance.
        self._sure = np.sqrt(-np.log1p(-self.confidence))
        if isinstance(self.policy, PolicyWithMemory):
            self.reset = self.policy.reset

    def __call__(self, observations: ArrayLike) -> NDArray[np.float32]:
        """Return actions (..., 2) for observations (..., n) of `terms`."""
        seen = numbers_of(observations, self.terms).astype(np.float32)
        actions = np.array(self._shown(seen), np.float32)
        actions[self._meets(seen, actions)] = 0.0
        return actions

    def _meets(self, observations: NDArray[np.float32], actions: NDArray[np.float32]) -> NDArray[np.bool_]:
        """Return where a robot could meet somebody before it stands, for actions (..., 2) after observations (..., n)."""
        limits = self._robot.max_linear, self._robot.max_angular
        v_now, omega_now = np.moveaxis(observations[..., self._twist].astype(np.float64) * limits, -1, 0)
        wanted = (actions.astype(np.float64) * limits).reshape(-1, 2)
        kept = [tuple(limit(Command(*command), self._robot)) for command in wanted.tolist()]
        v, omega = np.moveaxis(np.array(kept).reshape(actions.shape), -1, 0)
        place, heading = arc(v_now, omega_now, self.dt)
        drives = v * heading
        tracks = observations[..., self._tracks].reshape(*v.shape, NEAREST, -1).astype(np.float64)
        walks, grows = tracks[..., 2:4], self._sure * tracks[..., 5]
        to = tracks[..., :2] + self.dt * walks - np.stack([place.real, place.imag], axis=-1)[..., None, :]
        _, least = passing(to, walks - np.stack([drives.real, drives.imag], axis=-1)[..., None, :], self._stopping, grows)
        bend = 0.5 * np.abs(v * omega)[..., None] * self._stopping**2  # distance of the arc from the straight way
        near = self._robot.radius + tracks[..., 6] + self._sure * tracks[..., 4] + self.dt * grows + bend
        return np.asarray(((least < near) & (tracks[..., 7] > 0.0)).any(axis=-1))
