"""A recorded drive as arrays: filled by evaluation, replay or a running ROS graph, and read by plots and metrics."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray


class Trajectory(NamedTuple):
    """A drive of T samples; unknown values are NaN, such as the truth on a robot without motion capture.

    Except for time, the fields are named as in the environment's ``info``.
    """

    time: NDArray[np.float64]
    """Shape (T,), s."""
    true_state: NDArray[np.float64]
    """True x, y, theta, v and omega, shape (T, 5); m, m, rad, m/s, rad/s."""
    odometry: NDArray[np.float64]
    """Measured pose, shape (T, 3); m, m, rad."""
    estimate: NDArray[np.float64]
    """Estimated state, shape (T, 5); m, m, rad, m/s, rad/s."""
    covariance: NDArray[np.float64]
    """Covariance of the estimate, shape (T, 5, 5)."""
    reference: NDArray[np.float64]
    """Waypoint to reach, shape (T, 3); m, m, rad."""
    command: NDArray[np.float64]
    """Commanded speed and turning rate, shape (T, 2); m/s, rad/s."""

    @classmethod
    def from_infos(cls, infos: Iterable[Mapping[str, Any]], *, dt: float) -> Trajectory:
        """Stack the infos of an episode: that of ``reset``, then that of each ``step``.

        Args:
            infos: Infos from the scalar environment.
            dt: Its control interval, s.
        """
        infos = list(infos)
        rows = {name: np.array([info[name] for info in infos], dtype=np.float64) for name in cls._fields[1:]}
        return cls(time=np.arange(len(infos), dtype=np.float64) * dt, **rows)


def position_error(pose: ArrayLike, truth: ArrayLike) -> NDArray[np.float64]:
    """Return the distance between positions, m.

    Args:
        pose: Poses or states, shape (..., 3) or (..., 5).
        truth: True ones.
    """
    pose, truth = np.asarray(pose), np.asarray(truth)
    return np.hypot(pose[..., 0] - truth[..., 0], pose[..., 1] - truth[..., 1])


def heading_error(pose: ArrayLike, truth: ArrayLike) -> NDArray[np.float64]:
    """Return the size of the wrapped difference of headings, rad, in [0, pi].

    Args:
        pose: Poses or states, shape (..., 3) or (..., 5).
        truth: True ones.
    """
    turn = np.asarray(pose)[..., 2] - np.asarray(truth)[..., 2]
    return np.abs(np.arctan2(np.sin(turn), np.cos(turn)))  # keeps NaN, which the scalar `wrap` does not
