"""Likelihood of a recorded drive under a noise model: the core's own filter, run over the rows in compiled loops.

By the equations of `spikes`, each measured pose is given all before it, which needs no truth.

References:
    Schweppe, "Evaluation of likelihood functions for Gaussian signals", *IEEE Transactions on Information Theory* 11 (1965).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.compiled.packing import as_tuple
from turtlebot_gym.compiled.program import in_machine_code
from turtlebot_gym.estimation.ekf import predict, start
from turtlebot_gym.estimation.update import wrapped
from turtlebot_gym.kernel import kernel
from turtlebot_gym.parameters import FilterTuning, Noise
from turtlebot_gym.values import Belief, Command, Odometry, Pose, Senses
from turtlebot_gym_lab.calibration.spikes import Spikes, track


class Rows(NamedTuple):
    """A drive of T rows, in the form that the loops take."""

    time: NDArray[np.float64]
    """Shape (T,), s."""
    twist: NDArray[np.float64]
    """Shape (T, 2); row k's covers the interval from row k-1 to row k."""
    poses: NDArray[np.float64]
    """Poses that the filter receives, shape (T, 3); m, m, rad."""
    due: NDArray[np.bool_]
    """Whether the filter receives a pose, shape (T,)."""
    joined: NDArray[np.bool_]
    """Whether a row continues the one before it, shape (T,)."""


@kernel
def _shifted(poses: Any, row: int, bias: Any) -> Pose:
    return Pose(poses[row, 0] - bias[0], poses[row, 1] - bias[1], poses[row, 2] - bias[2])


@kernel
def _begin(z: Pose, twist: Command, tuning: Any, dt: float, integrator: float) -> Belief:
    """Return the belief after the first pose, which is taken for one without a spike; nothing moves yet."""
    return predict(wrapped(start(Senses(Odometry(z, twist, True)), tuning).belief), twist, tuning, dt, integrator)


@in_machine_code("likelihood of drives")
def _of_innovations(time, twist, poses, due, joined, tuning, bias, integrator):
    rows, total, running = len(time), 0.0, False
    belief = _begin(Pose(0.0, 0.0, 0.0), Command(0.0, 0.0), tuning, 1.0, integrator)
    for row in range(rows):
        is_last = row == rows - 1
        after = 0 if is_last else row + 1
        twist_then = Command(twist[after, 0], twist[after, 1])
        running = running and joined[row]
        z = _shifted(poses, row, bias)
        if running:
            now = track(belief, Odometry(z, twist_then, due[row]), tuning, time[row] - time[row - 1], integrator)
            total += math.log(now.factor) - now.exponent if due[row] else 0.0
            belief = now.belief
        if due[row] and not running and not is_last:
            belief, running = _begin(z, twist_then, tuning, time[after] - time[row], integrator), True
    return total


def tuning_of(noise: Noise) -> FilterTuning:
    """Return the tuning that the likelihood assumes: the noise, without floors."""
    odometry = noise.odometry
    return FilterTuning(
        Q=(0.0,) * 5,
        R=odometry.R,
        process=noise.process,
        kind=Spikes(spike_probability=odometry.spike_probability, spike=odometry.spike),
    )


def innovations(rows: Rows, noise: Noise, *, integrator: float) -> float:
    """Return the log-likelihood of poses, each given those before it, up to a constant.

    Of true poses the noise's R says how well they are known.
    """
    return _of_innovations(*rows, as_tuple(tuning_of(noise)), noise.odometry.bias, integrator)
