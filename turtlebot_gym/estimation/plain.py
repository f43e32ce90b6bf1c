"""A filter written as a plain Python class over NumPy arrays: the slow path, for trying an idea.

    class MyFilter:
        def __init__(self, tuning):         # Q, R and process as matched to the noise, see `FilterTuning`
            self.x = np.zeros(5)            # x, y, theta, v, omega, and further states if it has any
            self.P = np.eye(5)

        def predict(self, twist, dt): ...   # (v, omega) that is executed from now on, and the interval, s
        def update(self, z, R): ...         # a measured (x, y, theta), and its variances; infinite for an unknown heading

With a fix whose errors are correlated, R is their 3 x 3 matrix instead.

``x`` and ``P`` are its whole memory: set before each call, and read after it. An environment with such a filter runs as
plain Python, some thousand times slower than a compiled one. A filter made of kernels is fast, see `interface.Filter`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache, lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.estimation.filters import covariance_of
from turtlebot_gym.estimation.interface import Filter
from turtlebot_gym.models.angles import wrap
from turtlebot_gym.parameters import FilterTuning
from turtlebot_gym.values import Belief, Pose, Senses, State


@dataclass(frozen=True, slots=True, kw_only=True)
class Plain:
    """A plain class as a filter, `FilterTuning.kind`."""

    make: Callable[[Any], Any] = field(metadata={"number": False})
    """The class, or another callable that makes a filter for a tuning."""
    corrects: bool = True
    """Whether the measured poses correct the belief; not with wheel odometry."""
    reads_Q: bool = field(default=True, metadata={"number": False})
    """Whether it may read the tuning's Q; an object of filterpy has its own."""

    @property
    def filter(self) -> Filter:
        """The functions around the class."""
        return _filter_of(self.make)


class _PlainEstimate(NamedTuple):
    belief: Belief
    nis: float
    """Normalized innovation squared of the last measured pose, with the covariance before the update."""
    x: tuple[float, ...]
    """The whole state ..."""
    P: tuple[float, ...]
    """... and its covariance, row by row."""


@lru_cache(64)
def _worker(make: Callable[[Any], Any], tuning: Any) -> tuple[Any, NDArray[np.float64], NDArray[np.float64]]:
    """Return the object for a tuning, its first state and covariance."""
    worker = make(tuning)
    x, P = (np.array(getattr(worker, name, ()), np.float64) for name in ("x", "P"))
    if x.ndim != 1 or len(x) < 5 or P.shape != (len(x), len(x)):
        shapes = f"got {x.shape} and {P.shape}"
        raise ValueError(f"{_name(make)}: x must hold 5 numbers or more, and P be a matrix of as many rows, {shapes}.")
    return worker, x, P


def _name(make: Any) -> str:
    return f"{getattr(make, '__module__', '')}:{getattr(make, '__qualname__', make)}"


def _packed(make: Any, x: Any, P: Any, nis: float) -> _PlainEstimate:
    x, P = np.array(x, np.float64).ravel(), np.array(P, np.float64)
    if P.shape != (len(x), len(x)) or not (np.isfinite(x).all() and np.isfinite(P).all()):
        raise ValueError(f"{_name(make)}: x and P must be finite arrays of fixed size, got {x.tolist()} and {P.tolist()}.")
    x[2] = wrap(float(x[2]))
    # Rounding must not leave it asymmetric.
    P = 0.5 * (P + P.T)
    return _PlainEstimate(Belief(State(*x[:5].tolist()), covariance_of(P)), nis, tuple(x.tolist()), tuple(P.ravel().tolist()))


@cache
def _filter_of(make: Callable[[Any], Any]) -> Filter:
    """Return a plain class as a filter, whose functions change their own worker alone."""

    def start(senses: Senses, tuning: FilterTuning) -> _PlainEstimate:
        _, x, P = _worker(make, tuning)
        return _packed(make, np.array([*senses.odometry.pose, *x[3:]]), P, 0.0)

    def run(estimate: _PlainEstimate, tuning: Any, work: Callable[[Any], float]) -> _PlainEstimate:
        worker, first, _ = _worker(make, tuning)
        worker.x, worker.P = np.array(estimate.x), np.reshape(np.array(estimate.P), (len(first), len(first)))
        nis = work(worker)
        return _packed(make, worker.x, worker.P, nis)

    def step(
        estimate: Any, before: Senses, senses: Senses, tuning: FilterTuning, dt: float, integrator: float
    ) -> _PlainEstimate:
        _, twist, measured = senses.odometry

        def work(worker: Any) -> float:
            worker.predict(np.array(twist), dt)
            if not (measured and tuning.kind.corrects):
                return estimate.nis
            z, R = np.array(senses.odometry.pose), np.array(tuning.R)
            nu = z - np.ravel(worker.x)[:3]
            nu[2] = wrap(float(nu[2]))
            nis = float(nu @ np.linalg.solve(np.asarray(worker.P)[:3, :3] + np.diag(R), nu))
            worker.update(z, R)
            return nis

        return run(estimate, tuning, work)

    def fix(estimate: Any, z: Pose, R: tuple[float, ...], tuning: FilterTuning) -> _PlainEstimate:
        def work(worker: Any) -> float:
            xx, yy, tt, xy, xt, yt = R
            correlated = np.array([[xx, xy, xt], [xy, yy, yt], [xt, yt, tt]])
            worker.update(np.array(z), correlated if xy or xt or yt else np.array(R[:3]))
            return estimate.nis

        return run(estimate, tuning, work)

    return Filter(start, step, fix, kind=Plain(make=make), compiled=False)
