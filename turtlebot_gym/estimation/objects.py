"""A filter object of filterpy as a filter of the environments and nodes: `Plain` of a copy of the object.

Its state is (x, y, theta), or (x, y, theta, v, omega) and further ones; the measurement is the pose. ``Q`` holds for a step of
0.1 s, of an unscented filter for its own ``dt``; longer steps add more. An ``ExtendedKalmanFilter`` moves as the robot does, or
by a ``predict_x(u)`` of its own in a subclass; an ``UnscentedKalmanFilter`` moves by its ``fx(x, dt, u)``. ``u`` is (v, omega):
with three states the twist of the interval, otherwise the twist from its end on.
"""

from __future__ import annotations

from copy import deepcopy
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from turtlebot_gym.config import refusal
from turtlebot_gym.models.angles import wrap
from turtlebot_gym.models.unicycle import INTEGRATORS, motion
from turtlebot_gym.parameters import REFERENCE_PERIOD

EXTENDED, UNSCENTED = "ExtendedKalmanFilter", "UnscentedKalmanFilter"


def kinds_of(given: object) -> list[str]:
    """Return the names of filterpy's classes that something, an object or a class, is of."""
    kinds = (given if isinstance(given, type) else type(given)).__mro__
    return [kind.__name__ for kind in kinds if kind.__module__.partition(".")[0] == "filterpy"]


def variances_of(given: Any) -> tuple[float, ...]:
    """Return the variances of the measured pose, the diagonal of the object's R; a ``ValueError`` refuses what does not fit."""
    if isinstance(given, type) or not {EXTENDED, UNSCENTED} & {*kinds_of(given)}:
        raise refusal("filter", f"an object of filterpy's {EXTENDED} or {UNSCENTED}, with its Q and R set", kinds_of(given)[0])
    states, R = len(given.P), np.asarray(given.R, np.float64)
    fits = R.shape == (3, 3) and states in (3, *range(5, 100)) and np.shape(given.Q) == (states, states)
    if not fits or np.any(R - np.diag(np.diag(R))) or not np.all(np.diag(R) > 0.0):
        rule = "of 3 or 5 states or more (x, y, theta, v, omega), and its R a diagonal matrix of 3 positive variances"
        raise refusal(f"filter {type(given).__name__}", rule, R.tolist())
    return tuple(np.diag(R).tolist())


class Copied:
    """A copy of the object, with the state and covariance of at least five numbers that `Plain` sets and reads."""

    def __init__(self, given: Any) -> None:
        self._filter, self._Q, self._is_extended = deepcopy(given), np.array(given.Q, np.float64), EXTENDED in kinds_of(given)
        self._unload((0.0, 0.0))

    def predict(self, twist: NDArray[np.float64], dt: float) -> None:
        filter, (x, y, theta, v, omega, *more), n = self._filter, self.x.tolist(), len(self._Q)
        self._load()
        filter.Q = self._Q * (dt / (REFERENCE_PERIOD if self._is_extended else filter._dt))
        u = np.array([v, omega]) if n == 3 else twist
        if not self._is_extended:
            filter.predict(dt=dt, u=u)
        elif "filterpy" not in type(filter).predict_x.__module__:
            filter.predict(u)
        else:
            moved, F = motion(theta, v, omega, dt, INTEGRATORS["euler"]), np.eye(max(n, 5))
            F[3, 3] = F[4, 4] = 0.0  # commands replace the twist
            F[0, 2:5], F[1, 2:5], F[2, 4] = moved[3:6], moved[6:], dt
            filter.x = np.reshape([x + moved.x, y + moved.y, theta + moved.theta, *twist, *more][:n], np.shape(filter.x))
            filter.P = F[:n, :n] @ filter.P @ F[:n, :n].T + filter.Q
        self._unload(twist)

    def update(self, z: ArrayLike, R: ArrayLike) -> None:
        filter, H, off = self._filter, np.eye(3, len(self._Q)), np.asarray(z, np.float64) - self.x[:3]
        noise = np.array(R if np.ndim(R) == 2 else np.diag(R), np.float64)
        off[2] = wrap(float(off[2]))
        noise[2, 2] = min(noise[2, 2], 1e9)  # that of a heading may be infinite
        measured = np.reshape(self.x[:3] + off, (3, *np.shape(filter.x)[1:]))
        self._load()
        if self._is_extended:
            filter.update(measured, lambda state: H, lambda state: state[:3], R=noise)
        else:
            filter.sigmas_f = filter.points_fn.sigma_points(filter.x, filter.P)  # of this state, which a fix may have changed
            filter.update(measured, R=noise)
        self._unload(self.x[3:5])

    def _load(self) -> None:
        n = len(self._Q)
        self._filter.x, self._filter.P = np.reshape(self.x[:n], np.shape(self._filter.x)), self.P[:n, :n]

    def _unload(self, twist: ArrayLike) -> None:
        """Take state and covariance from the object; with three states the twist is as given, and exact."""
        n, size = len(self._Q), max(len(self._Q), 5)
        self.x, self.P = np.zeros(size), np.zeros((size, size))
        self.x[3:5] = twist
        self.x[:n], self.P[:n, :n] = np.ravel(self._filter.x), self._filter.P
