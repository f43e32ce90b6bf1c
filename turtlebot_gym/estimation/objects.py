"""A filter object of filterpy as a filter of the environments and nodes: `Plain` of a copy of the object.

The object keeps its own ``P``, ``Q`` and ``R``. Its state is (x, y, theta), or (x, y, theta, v, omega) and further ones; the
measurement is the pose. ``Q`` holds for a step of 0.1 s, of an unscented filter for its own ``dt``; longer steps add more.

* ``ExtendedKalmanFilter``: moves as the robot does, with the Jacobian of that motion; a subclass with a ``predict`` or
  ``predict_x`` of its own moves by that, which gets ``u``.
* ``UnscentedKalmanFilter``: moves by its ``fx(x, dt)``, or ``fx(x, dt, u)``, and measures by its ``hx``.
* ``KalmanFilter``: moves by its ``F``, and its ``B`` with ``u``, which hold for a step of 0.1 s.

``u`` is (v, omega): with three states the twist of the interval, otherwise the twist from its end on, as the pose moved by the
twist in the state.

References:
    Labbe, *filterpy*, https://filterpy.readthedocs.io, and *Kalman and Bayesian Filters in Python* (2015), chapters 10 and 11.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable
from copy import deepcopy
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from turtlebot_gym.config import refusal
from turtlebot_gym.estimation.filters import jacobian
from turtlebot_gym.models.angles import wrap
from turtlebot_gym.models.unicycle import Integrator, advance
from turtlebot_gym.parameters import REFERENCE_PERIOD
from turtlebot_gym.values import Pose, State

UNKNOWN = 1e9
"""Variance of a heading that was not measured, rad^2."""
Matrix = NDArray[np.float64]


def is_filterpy(given: object) -> bool:
    """Return whether something is an object or a class of filterpy, or of a subclass."""
    kinds = (given if isinstance(given, type) else type(given)).__mro__
    return any(kind.__module__.partition(".")[0] == "filterpy" for kind in kinds)


def variances_of(given: Any) -> tuple[float, ...]:
    """Return the variances of the measured pose, the diagonal of the object's R, after checks of the object.

    Raises:
        ValueError: If it is a class, of another kind, or its sizes or R do not fit; the message names it.
    """
    from filterpy.kalman import ExtendedKalmanFilter, KalmanFilter, UnscentedKalmanFilter

    name = (given if isinstance(given, type) else type(given)).__name__
    known = (ExtendedKalmanFilter, UnscentedKalmanFilter, KalmanFilter)
    if isinstance(given, type) or not isinstance(given, known):
        rule = "an object of filterpy's ExtendedKalmanFilter, UnscentedKalmanFilter or KalmanFilter, with its Q and R set"
        raise ValueError(f"filter must be {rule}, got the {'class' if isinstance(given, type) else 'object'} {name}.")
    sizes = (getattr(given, f"dim_{of}", None) or getattr(given, f"_dim_{of}") for of in "xz")
    states, seen = (int(size) for size in sizes)
    if seen != 3 or states in (1, 2, 4):
        rule = "dim_x 3 (x, y, theta) or 5 (and v, omega) or more, and dim_z 3, the pose"
        raise ValueError(f"filter {name} must have {rule}, got dim_x {states} and dim_z {seen}.")
    if states > 5 and isinstance(given, ExtendedKalmanFilter) and not _moves_itself(given):
        raise ValueError(f"filter {name} has {states} states, whose motion is its own: override predict_x in a subclass.")
    if isinstance(given, KalmanFilter) and np.any(given.H) and not np.array_equal(given.H, np.eye(3, states)):
        raise ValueError(f"filter {name}.H must be np.eye(3, {states}): the measurement is the pose (x, y, theta).")
    for field, size in (("P", states), ("Q", states), ("R", 3)):
        if np.shape(getattr(given, field)) != (size, size):
            raise refusal(f"filter {name}.{field}", f"a {size} x {size} matrix", getattr(given, field))
    R = np.asarray(given.R, np.float64)
    if np.any(R - np.diag(np.diag(R))) or not np.all(np.diag(R) > 0.0):
        raise refusal(f"filter {name}.R", "a diagonal matrix of positive variances of x, y and theta", R.tolist())
    return tuple(np.diag(R).tolist())


def _moves_itself(given: Any) -> bool:
    """Return whether an extended Kalman filter has a motion of its own."""
    from filterpy.kalman import ExtendedKalmanFilter

    names = ("predict", "predict_x")
    return any(name in vars(given) or getattr(type(given), name) is not getattr(ExtendedKalmanFilter, name) for name in names)


def _takes_u(function: Callable[..., Any]) -> bool:
    """Return whether a function takes the argument ``u``."""
    return "u" in inspect.signature(function).parameters


class Maker:
    """Makes the filter, as a class does for `Plain`.

    Args:
        given: The object, which is copied and stays as it is.
    """

    def __init__(self, given: Any) -> None:
        self._given = given
        self.__module__, self.__qualname__ = type(given).__module__, type(given).__name__  # for messages

    def __call__(self, tuning: Any) -> _Worker:
        """Return a worker around a copy."""
        return _Worker(deepcopy(self._given))


class _Worker:
    """The object with the state and covariance of at least five numbers that `Plain` sets and reads."""

    def __init__(self, filter: Any) -> None:
        from filterpy.kalman import ExtendedKalmanFilter, UnscentedKalmanFilter

        self._filter, self._Q = filter, np.array(filter.Q, np.float64)
        self._states, self._is_column = len(self._Q), np.ndim(filter.x) == 2
        self._is_extended = isinstance(filter, ExtendedKalmanFilter)
        self._is_unscented = isinstance(filter, UnscentedKalmanFilter)
        self._moves_as_robot = self._is_extended and not _moves_itself(filter)
        self._period = filter._dt if self._is_unscented else REFERENCE_PERIOD
        self.x = np.zeros(max(self._states, 5))
        self.P = np.zeros((len(self.x), len(self.x)))
        self.P[: self._states, : self._states] = filter.P

    def predict(self, twist: Matrix, dt: float) -> None:
        """Move by an interval, s; the twist holds from its end on."""
        filter, before = self._filter, self.x.copy()
        self._load()
        filter.Q = self._Q * (dt / self._period)
        u = before[3:5] if self._states == 3 else twist
        if self._moves_as_robot:
            self._move_as_robot(before, twist, dt)
        elif self._is_unscented:
            filter.predict(dt=dt, **({"u": u} if _takes_u(filter.fx) else {}))
        elif self._is_extended:
            filter.predict(*((u,) if _takes_u(filter.predict) else ()))
        else:
            self._predict_linear(u, dt)
        self._unload(twist)

    def _move_as_robot(self, before: Matrix, twist: Matrix, dt: float) -> None:
        """Move by the robot's motion and its Jacobian, as the notebook on the closed loop does with filterpy."""
        n, state = self._states, State(*before[:5].tolist())
        pose = advance(Pose(*state[:3]), state.v, state.omega, dt, Integrator.EULER)
        F = jacobian(state, dt=dt)[:n, :n]
        self._filter.x = self._shaped(np.array([*pose, *twist])[:n])
        self._filter.P = F @ self._filter.P @ F.T + self._filter.Q

    def _predict_linear(self, u: Matrix, dt: float) -> None:
        filter = self._filter
        stands = filter.B is None and np.array_equal(filter.F, np.eye(self._states))
        if not stands and abs(dt - REFERENCE_PERIOD) > 1e-6:
            raise ValueError(
                f"F and B of a KalmanFilter hold for steps of {REFERENCE_PERIOD} s, got one of {dt:g} s: use an "
                "ExtendedKalmanFilter, whose motion is the robot's."
            )
        filter.predict(None if filter.B is None else self._shaped(u))

    def update(self, z: ArrayLike, R: ArrayLike) -> None:
        """Correct by a measured pose and its variances, or their 3 x 3 matrix."""
        filter, (x, y, heading) = self._filter, np.asarray(z, np.float64)
        self._load()
        noise = np.diag(R) if np.ndim(R) == 1 else np.array(R, np.float64)
        if not math.isfinite(noise[2, 2]):
            heading, noise[2] = self.x[2], (0.0, 0.0, UNKNOWN)
            noise[:, 2] = noise[2]
        measured = self._shaped(np.array([x, y, self.x[2] + wrap(float(heading - self.x[2]))]))
        H = np.eye(3, self._states)
        if self._is_extended:
            filter.update(measured, lambda state: H, lambda state: state[:3], R=noise)
        elif self._is_unscented:
            filter.sigmas_f = filter.points_fn.sigma_points(filter.x, filter.P)  # of this state, which a fix may have changed
            filter.update(measured, R=noise)
        else:
            filter.update(measured, R=noise, H=H)
        self._unload(self.x[3:5])

    def _shaped(self, numbers: Matrix) -> Matrix:
        return numbers.reshape(-1, 1) if self._is_column else numbers

    def _load(self) -> None:
        """Put state and covariance into the object."""
        n = self._states
        self._filter.x, self._filter.P = self._shaped(np.array(self.x[:n])), np.array(self.P[:n, :n])

    def _unload(self, twist: ArrayLike) -> None:
        """Take state and covariance from the object; with three states the twist is as given, and exact."""
        n = self._states
        self.x, self.P = np.zeros(max(n, 5)), np.zeros((max(n, 5), max(n, 5)))
        self.x[3:5] = twist
        self.x[:n], self.P[:n, :n] = np.ravel(self._filter.x), self._filter.P
