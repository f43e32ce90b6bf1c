"""Many robots at once, and how far each is from where it believes it is."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.compiled.batch import Batch
from turtlebot_gym.envs.common import SYMMETRIC
from turtlebot_gym.estimation.consistency import difference, nees


class Errors(NamedTuple):
    """Errors of the estimated poses of n robots at a step, or of all steps together."""

    position: NDArray[np.float64]
    """Shape (n,) or (steps, n), m."""
    heading: NDArray[np.float64]
    """rad"""
    nees: NDArray[np.float64]
    """Of the pose: 3 if the covariance is exact."""


def begun(number: int, seed: int, *given: Any, **options: Any) -> tuple[Batch, NDArray[np.float32]]:
    """Return a `Batch` at the start of its episodes, and its observations."""
    batch = Batch(number, *given, **options)
    batch.seeds[:] = seed + np.arange(number)
    observations, outcomes = batch.empty()
    batch.reset(np.ones(number, np.bool_), observations, outcomes)
    return batch, observations


def errors_of(batch: Batch) -> Errors:
    """Return the errors of a batch as it is."""
    mean, truth = batch.numbers("estimate.belief.mean"), batch.numbers("body.true_state")
    error = difference(mean[:, :3], truth[:, :3])
    covariance = batch.numbers("estimate.belief.covariance")[..., SYMMETRIC]
    position = np.hypot(error[:, 0], error[:, 1])
    return Errors(position, np.abs(error[:, 2]), nees(mean, truth, covariance, components=3))
