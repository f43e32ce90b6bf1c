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

from turtlebot_gym.compiled.cache import in_machine_code
from turtlebot_gym.compiled.packing import as_tuple
from turtlebot_gym.estimation.ekf import predict
from turtlebot_gym.kernel import kernel
from turtlebot_gym.parameters import FilterTuning, Noise
from turtlebot_gym.values import Belief, Command, Odometry, Pose
from turtlebot_gym_lab.calibration.spikes import (
    Hypotheses,
    Spikes,
    Three,
    begin,
    least_exponent,
    scaled,
    track,
    track_all,
    weigh,
)

CERTAIN = 1.0 - 1e-13
"""Probability of a hypothesis above which the others are dropped."""


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
def _shifted(poses: Any, row: int, bias: Three) -> Pose:
    return Pose(poses[row, 0] - bias[0], poses[row, 1] - bias[1], poses[row, 2] - bias[2])


@kernel
def _depart(z: Pose, twist: Command, tuning: Any, dt: float, integrator: float) -> tuple[Hypotheses, Three]:
    """Return a belief for each explanation of the first pose, and their probabilities."""
    (true, high, low), weights = begin(z, tuning)
    hypotheses = Hypotheses(
        predict(true, twist, tuning, dt, integrator),  # at rest: nothing moves yet
        predict(high, twist, tuning, dt, integrator),
        predict(low, twist, tuning, dt, integrator),
    )
    return hypotheses, weights


@kernel
def _surest(hypotheses: Hypotheses, weights: Three) -> Belief:
    return hypotheses.high if weights[1] > 0.5 else (hypotheses.low if weights[2] > 0.5 else hypotheses.true)


@in_machine_code("likelihood of drives")
def _of_innovations(time, twist, poses, due, joined, tuning, bias, integrator):
    rows, total, running, alone = len(time), 0.0, False, False
    hypotheses, weights = begin(Pose(0.0, 0.0, 0.0), tuning)
    belief = hypotheses.true
    for row in range(rows):
        is_last = row == rows - 1
        after = 0 if is_last else row + 1
        twist_then = Command(twist[after, 0], twist[after, 1])
        running = running and joined[row]
        z = _shifted(poses, row, bias)
        if running:
            dt = time[row] - time[row - 1]
            odometry = Odometry(z, twist_then, due[row])
            # One filter does once a hypothesis is certain.
            if alone:
                now = track(belief, odometry, tuning, dt, integrator)
                total += math.log(now.factor) - now.exponent if due[row] else 0.0
                belief = now.belief
            else:
                tracks = track_all(hypotheses, odometry, tuning, dt, integrator)
                least = least_exponent(tracks)
                likely = weigh(weights, tracks, least)
                amount = likely[0] + likely[1] + likely[2]
                total += math.log(amount) - least
                weights = scaled(likely, 1.0 / amount)
                hypotheses = Hypotheses(tracks.true.belief, tracks.high.belief, tracks.low.belief)
                alone = max(weights[0], max(weights[1], weights[2])) > CERTAIN
                belief = _surest(hypotheses, weights)
        if due[row] and not running and not is_last:
            hypotheses, weights = _depart(z, twist_then, tuning, time[after] - time[row], integrator)
            belief, running, alone = hypotheses.true, True, tuning.kind.spike_probability == 0.0
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

    Args:
        rows: The drive.
        noise: Noise of the execution and of the poses. For true poses, its R says how well they are known.
        integrator: The integrator, a value of `models.unicycle.Integrator`.
    """
    return _of_innovations(*rows, as_tuple(tuning_of(noise)), noise.odometry.bias, integrator)
