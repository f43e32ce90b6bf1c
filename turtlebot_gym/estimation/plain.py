"""A filter written as a plain Python class over NumPy arrays: the slow path, for trying an idea.

It is made with a `FilterTuning`, and has ``x`` (x, y, theta, v, omega, and further states), ``P``, ``predict(twist, dt)`` with
the (v, omega) that is executed from now on, and ``update(z, R)`` with a measured pose and its variances, infinite for an
unknown heading, or the 3 x 3 matrix of correlated errors. ``x`` and ``P`` are its whole memory: set before each call, and read
after it. It runs as plain Python, some thousand times slower than a filter of kernels, `interface.Filter`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache, lru_cache
from typing import Any, NamedTuple

import numpy as np

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

    @property
    def filter(self) -> Filter:
        """The functions around the class."""
        return _filter_of(self.make)


class _PlainEstimate(NamedTuple):
    belief: Belief
    nis: float
    """Normalized innovation squared of the last measured pose, with the covariance before the update."""
    x: tuple[float, ...]
    P: tuple[float, ...]
    """Row by row."""


@lru_cache(64)
def _worker(make: Callable[[Any], Any], tuning: Any) -> tuple[Any, _PlainEstimate]:
    """Return the object for a tuning, and its first estimate."""
    worker = make(tuning)
    return worker, _packed(worker, 0.0)


def _packed(worker: Any, nis: float) -> _PlainEstimate:
    x, P, kind = np.array(worker.x, np.float64).ravel(), np.array(worker.P, np.float64), type(worker)
    if len(x) < 5 or P.shape != (len(x), len(x)) or not (np.isfinite(x).all() and np.isfinite(P).all()):
        rule = "x must hold 5 finite numbers or more, and P be a finite matrix of as many rows"
        raise ValueError(f"{kind.__module__}:{kind.__qualname__}: {rule}, got {x.tolist()} and {P.tolist()}.")
    x[2], P = wrap(float(x[2])), 0.5 * (P + P.T)  # rounding must not leave it asymmetric
    return _PlainEstimate(Belief(State(*x[:5].tolist()), covariance_of(P)), nis, tuple(x.tolist()), tuple(P.ravel().tolist()))


@cache
def _filter_of(make: Callable[[Any], Any]) -> Filter:
    """Return a plain class as a filter, whose functions change their own worker alone."""

    def restored(x: Any, P: Any, tuning: Any) -> Any:
        worker, first = _worker(make, tuning)
        worker.x, worker.P = np.array(x), np.reshape(np.array(P), (len(first.x), len(first.x)))
        return worker

    def start(senses: Senses, tuning: FilterTuning) -> _PlainEstimate:
        first = _worker(make, tuning)[1]
        return _packed(restored([*senses.odometry.pose, *first.x[3:]], first.P, tuning), 0.0)

    def step(estimate: Any, before: Senses, senses: Senses, tuning: Any, dt: float, integrator: float) -> _PlainEstimate:
        (pose, twist, measured), worker, nis = senses.odometry, restored(estimate.x, estimate.P, tuning), estimate.nis
        worker.predict(np.array(twist), dt)
        if measured and tuning.kind.corrects:
            z, R = np.array(pose), np.array(tuning.R)
            nu = z - np.ravel(worker.x)[:3]
            nu[2] = wrap(float(nu[2]))
            nis = float(nu @ np.linalg.solve(np.asarray(worker.P)[:3, :3] + np.diag(R), nu))
            worker.update(z, R)
        return _packed(worker, nis)

    def fix(estimate: Any, z: Pose, R: tuple[float, ...], tuning: FilterTuning) -> _PlainEstimate:
        worker, (xx, yy, tt, xy, xt, yt) = restored(estimate.x, estimate.P, tuning), R
        correlated = np.array([[xx, xy, xt], [xy, yy, yt], [xt, yt, tt]])
        worker.update(np.array(z), correlated if xy or xt or yt else np.array(R[:3]))
        return _packed(worker, estimate.nis)

    return Filter(start, step, fix, kind=Plain(make=make), compiled=False)
