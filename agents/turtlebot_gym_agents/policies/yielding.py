"""Stop for people: a small network predicts from the last scans whether somebody is about to come near.

This module needs only numpy.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike, NDArray

from turtlebot_gym.files import read_arrays
from turtlebot_gym.observations import ROOM, columns_of
from turtlebot_gym.parameters import REFERENCE_PERIOD
from turtlebot_gym.presets import make_robot
from turtlebot_gym.robots import Robot
from turtlebot_gym.rooms.lidar import SECTORS, SIGHT
from turtlebot_gym.validation import FINITE, NON_NEGATIVE, POSITIVE, PROBABILITY, check_fields
from turtlebot_gym_agents.policies.policy import Policy, PolicyWithMemory, numbers_of, shown, with_room
from turtlebot_gym_agents.policies.sight import DIRECTIONS, arc

BEFORE = 2
"""Number of scans that are remembered besides the newest."""
SPACING = 0.15
"""Least time between remembered scans, s: somebody who walks moves by a sector's width in it."""
NEAR = 0.03
"""Share of `rooms.lidar.SIGHT` added to a range before its logarithm: a robot's radius."""
FEATURES = 2 + SECTORS + 1 + BEFORE * SECTORS
"""Number of features of the network, see `Scans`."""


class Network:
    """A network with two hidden layers, which returns a probability.

    Args:
        arrays: "mean" and "std" of the features, and "weight0", "bias0" to "weight2", "bias2" of the layers.
    """

    def __init__(self, arrays: dict[str, NDArray[np.float32]]) -> None:
        self.arrays = arrays

    @classmethod
    def load(cls, path: str | Path) -> Network:
        """Return the network of a file; nothing in it is run."""
        return cls({name: array.astype(np.float32) for name, array in read_arrays(path).items()})

    def __call__(self, features: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return probabilities (n,) for features (n, `FEATURES`)."""
        a = self.arrays
        z = np.clip((features - a["mean"]) / a["std"], -10.0, 10.0)
        for layer in range(2):
            z = np.maximum(z @ a[f"weight{layer}"] + a[f"bias{layer}"], 0.0)
        return np.asarray(1.0 / (1.0 + np.exp(-(z @ a["weight2"] + a["bias2"])[:, 0])), np.float32)


class Scans:
    """The newest scan of each of n robots and those before it, as seen from where the newest was taken.

    Args:
        robot: The robot.
        dt: Control interval, s.
        lidar_x: Place of the LiDAR ahead of the axle, m.
        lag: Mean age of the beams beyond the stated age of the scan, s.
    """

    def __init__(self, robot: Robot, dt: float, lidar_x: float, lag: float) -> None:
        self._robot, self._dt, self._lidar_x, self._lag = robot, dt, lidar_x, lag
        self._size = -1

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Forget the scans where the mask (n,) is true."""
        if len(mask) != self._size:
            self._size = len(mask)
            self._scans = np.full((1 + BEFORE, self._size, SECTORS), np.nan)
            self._at = np.zeros((1 + BEFORE, self._size), np.complex128)
            self._towards = np.ones((1 + BEFORE, self._size), np.complex128)
            self._taken = np.zeros((1 + BEFORE, self._size))
            self._place, self._heading = np.zeros(self._size, np.complex128), np.ones(self._size, np.complex128)
            self._time = np.zeros(self._size)
            self._before = np.ones((self._size, BEFORE, SECTORS))
        self._scans[:, mask] = np.nan

    def features(self, rows: NDArray[np.float64]) -> NDArray[np.float32]:
        """Return what the network sees, shape (n, `FEATURES`).

        These are both speeds, the logarithms of the newest scan's ranges, its age, and by how much the surroundings were
        farther in each scan before it, as differences of logarithms.

        Args:
            rows: Observations of the terms of a room, shape (n, 50), of successive steps.
        """
        if len(rows) != self._size:
            self.reset(np.ones(len(rows), np.bool_))
        shares, age = rows[:, -1 - SECTORS : -1], rows[:, -1]
        v, omega = rows[:, 5] * self._robot.max_linear, rows[:, 6] * self._robot.max_angular
        step, turned = arc(v, omega, self._dt)
        self._place, self._heading = self._place + step * self._heading, self._heading * turned
        self._time += self._dt
        new = np.flatnonzero((shares != self._scans[0]).any(axis=1))
        if len(new):
            back, unturned = arc(v[new], omega[new], -(age[new] + self._lag))
            self._take(new, shares[new], self._place[new] + back * self._heading[new], self._heading[new] * unturned)
        logs, before = np.log(shares + NEAR), np.log(self._before + NEAR)
        farther = (before - logs[:, None]).reshape(len(rows), -1)
        return np.concatenate([rows[:, 5:7], logs, age[:, None], farther], axis=1, dtype=np.float32)

    def _take(self, rows: NDArray[np.int64], scans: NDArray, at: NDArray, towards: NDArray) -> None:
        """Remember new scans of some robots, and look at the older ones from their places."""
        first = np.isnan(self._scans[0, rows, 0])
        older = self._taken[0, rows] - self._taken[1, rows] >= SPACING - 1e-9
        for memory, now in ((self._scans, scans), (self._at, at), (self._towards, towards), (self._taken, self._time[rows])):
            begin, shift = first.reshape(-1, *(1,) * (now.ndim - 1)), older.reshape(-1, *(1,) * (now.ndim - 1))
            for k in range(BEFORE, 0, -1):
                memory[k, rows] = np.where(begin, now, np.where(shift, memory[k - 1, rows], memory[k, rows]))
            memory[0, rows] = now
        for k in range(1, 1 + BEFORE):
            seen = self._scans[k, rows]
            points = (seen * SIGHT * DIRECTIONS + self._lidar_x) * self._towards[k, rows, None] + self._at[k, rows, None]
            points = (points - at[:, None]) * np.conj(towards)[:, None] - self._lidar_x
            nearest, at_sector = np.ones_like(seen), np.angle(points) * SECTORS / (2.0 * np.pi)
            lengths = np.where(seen < 1.0, np.minimum(np.abs(points) / SIGHT, 1.0), 1.0)
            # A point between two sectors counts in both: gaps of a turned scan would look like objects that moved away.
            for sector in (np.round(at_sector - 0.4), np.round(at_sector + 0.4)):
                np.minimum.at(nearest, (np.arange(len(rows))[:, None], sector.astype(np.int64) % SECTORS), lengths)
            self._before[rows, k - 1] = nearest


@dataclass(eq=False)
class Yielding:
    """Drive by a policy, and stand still while somebody is about to come near.

    The network was trained to imitate a stop that knows where everybody walks (`benchmarks/people.py`). It sees walking people
    only as differences between scans.

    Raises:
        ValueError: If a number is out of its range, or the policy was made for open ground.
    """

    policy: Policy
    """The policy that drives."""
    network: Callable[[NDArray[np.float32]], NDArray[np.float32]]
    """Returns probabilities (n,) for the features of `Scans`; a `Network`."""
    robot: str | Robot = "burger"
    """A name in `turtlebot_gym.ROBOTS`, or a robot."""
    dt: Annotated[float, POSITIVE] = REFERENCE_PERIOD
    """Control interval, s."""
    _: KW_ONLY
    threshold: Annotated[float, PROBABILITY] = 0.4
    """Probability from which the robot stands still."""
    lidar_x: Annotated[float, FINITE] = -0.032
    """Place of the LiDAR ahead of the axle, m."""
    lag: Annotated[float, NON_NEGATIVE] = 0.1
    """Mean age of the beams beyond the stated age of the scan, s."""

    def __post_init__(self) -> None:
        check_fields(self, "")
        self.card = getattr(self.policy, "card", None)
        """Card of the policy, if it has one."""
        self.terms = with_room(self.policy)
        """The terms of its observations."""
        self._shown, self._sight = shown(self.policy, "policy", self.terms), columns_of(ROOM, self.terms)
        self.scans = Scans(make_robot(self.robot), self.dt, self.lidar_x, self.lag)

    def reset(self, mask: NDArray[np.bool_]) -> None:
        if isinstance(self.policy, PolicyWithMemory):
            self.policy.reset(mask)
        self.scans.reset(np.ravel(mask))

    def __call__(self, observations: ArrayLike) -> NDArray[np.float32]:
        """Return actions (..., 2) for observations (..., 50)."""
        seen = numbers_of(observations, self.terms)
        rows = seen[..., self._sight].astype(np.float64)
        actions = np.array(self._shown(seen.astype(np.float32)), np.float32)
        stands = self.scans.features(rows.reshape(-1, rows.shape[-1]))
        actions[self.network(stands).reshape(rows.shape[:-1]) >= self.threshold] = 0.0
        return actions
