"""Consistency of a filter's stated uncertainty, and the best accuracy that any filter could reach.

References:
    Bar-Shalom, Li, Kirubarajan, *Estimation with Applications to Tracking and Navigation* (2001), section 5.4: NEES, NIS.
    Tichavsky, Muravchik, Nehorai, "Posterior Cramer-Rao bounds for discrete-time nonlinear filtering" (1998).
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from turtlebot_gym.config import Range, as_int, choose
from turtlebot_gym.estimation import ekf
from turtlebot_gym.estimation.filters import jacobians, matrix
from turtlebot_gym.models.angles import wrap_all
from turtlebot_gym.models.unicycle import INTEGRATORS, execution_variances
from turtlebot_gym.parameters import REFERENCE_PERIOD, DeadReckoning, FilterTuning, Kalman, Noise, OdometryNoise
from turtlebot_gym.values import Command, Pose


def difference(one: ArrayLike, other: ArrayLike) -> NDArray[np.float64]:
    """Return the difference of poses or states, with that of the headings wrapped.

    Args:
        one: Shape (..., 3) or (..., 5); m, m, rad, m/s, rad/s.
        other: The same shape.
    """
    apart = np.asarray(one, np.float64) - np.asarray(other, np.float64)
    apart[..., 2] = wrap_all(apart[..., 2])
    return apart


def nees(estimate: ArrayLike, truth: ArrayLike, covariance: ArrayLike, *, components: int = 5) -> NDArray[np.float64]:
    """Return the normalized estimation error squared, ``e' P^-1 e``, with the heading's error wrapped.

    For a consistent filter it is chi-square distributed, with one degree of freedom per component.

    Args:
        estimate: Estimated states, shape (..., 5); m, m, rad, m/s, rad/s.
        truth: True states, shape (..., 5).
        covariance: Shape (..., 5, 5).
        components: Number of components of the state to judge: 5; 3 for the pose (at rest a filter may be certain of the twist,
            so that P is singular); 2 for the position.

    Returns:
        Shape (...).
    """
    error = difference(estimate, truth)
    return normalized(error[..., :components], np.asarray(covariance)[..., :components, :components])


def normalized(error: ArrayLike, covariance: ArrayLike) -> NDArray[np.float64]:
    """Return ``e' P^-1 e``; for an innovation and its covariance this is the NIS, with 3 degrees of freedom.

    Args:
        error: Shape (..., n).
        covariance: Shape (..., n, n), positive definite.

    Returns:
        Shape (...).
    """
    error = np.asarray(error, np.float64)[..., None]
    return (np.swapaxes(error, -1, -2) @ np.linalg.solve(np.asarray(covariance, np.float64), error))[..., 0, 0]


def mean_bounds(degrees: int, runs: int, *, false_alarm: float) -> tuple[float, float]:
    """Return the interval that contains the mean of independent NEES or NIS values, except for a stated rate of false alarms.

    Args:
        degrees: Degrees of freedom of each: 5 for the NEES, 3 for the NIS.
        runs: Number of independent values in the mean. Values along one run are correlated: count runs, not steps.
        false_alarm: Probability that a consistent filter falls outside.

    Raises:
        ValueError: If an argument is out of its range.
    """
    from scipy import stats  # slow to import

    df = as_int("degrees", degrees, 1) * as_int("runs", runs, 1)
    low, high = stats.chi2.interval(1.0 - Range(0.0, 1.0, open_low=True, open_high=True).check("false_alarm", false_alarm), df)
    return float(low / runs), float(high / runs)


def heading_information(noise: OdometryNoise) -> float:
    """Return the Fisher information of a measured heading, 1/rad^2; without spikes, the inverse of the variance.

    With spikes the noise is the mixture ``(1 - e) N(0, s^2) + e/2 N(a, s^2) + e/2 N(-a, s^2)``, and the information is the
    integral of ``p'^2 / p``. A filter that models the mixture can use all of it; one that assumes Gaussian noise gets at most
    ``1 / (s^2 + e a^2)``.

    Raises:
        ValueError: If the heading is measured without white noise, which makes its information infinite.
    """
    from scipy import stats  # slow to import

    variance, share, spike = noise.R[2], noise.spike_probability, noise.spike
    if not variance > 0.0:
        raise ValueError(f"OdometryNoise.R must have a positive heading variance for this, got {variance!r}.")
    s = math.sqrt(variance)
    reach = spike + 12.0 * s
    # The sum of a smooth function that vanishes at both ends converges faster than any power of the spacing.
    x, spacing = np.linspace(-reach, reach, 2 * math.ceil(reach / s * 10.0) + 1, retstep=True)
    means = np.array([0.0, spike, -spike])[:, None]
    weights = np.array([1.0 - share, 0.5 * share, 0.5 * share])[:, None]
    parts = weights * stats.norm.pdf(x, means, s)
    density, slope = parts.sum(axis=0), (parts * (means - x) / variance).sum(axis=0)
    integrand = np.divide(slope**2, density, out=np.zeros_like(x), where=density > 0.0)
    return float(integrand.sum() * spacing)


def true_tuning(noise: Noise) -> FilterTuning:
    """Return the true noise as a tuning for `cramer_rao_bound`: without floors, with spikes counted by the information that
    they leave. Bias and slip are omitted, because the bound assumes that they are known.

    Raises:
        ValueError: If there are spikes on a heading without white noise.
    """
    odometry = noise.odometry
    steps = [step * step / 12.0 for step in odometry.quantization]
    spiky = odometry.spike_probability > 0.0 and odometry.spike > 0.0 and not odometry.wheel
    heading = 1.0 / heading_information(odometry) if spiky else odometry.R[2]
    R = (odometry.R[0] + steps[0], odometry.R[1] + steps[0], heading + steps[1])
    process = replace(noise.process, scale=1.0, turn_scale=1.0, veer=0.0, slip=0.0)
    return FilterTuning(Q=(0.0,) * 5, R=R, process=process, kind=DeadReckoning() if odometry.wheel else Kalman())


def cramer_rao_bound(
    true_states: ArrayLike,
    commands: ArrayLike,
    tuning: FilterTuning,
    *,
    measured: ArrayLike | None = None,
    dt: float = 0.1,
    integrator: str = "euler",
) -> NDArray[np.float64]:
    """Return the posterior Cramer-Rao bound, a lower bound on the mean squared error of any filter.

    The process noise enters v and omega only, so Q is singular. The bound is therefore computed in covariance form: the
    filter's Riccati equation along the true trajectories, averaged over them.

    Args:
        true_states: Shape (T + 1, 5), or (N, T + 1, 5) for N runs; m, m, rad, m/s, rad/s.
        commands: Limited commands executed from each state on, without the noise of their execution (reduced by slip if that is
            assumed known), shape (T, 2) or (N, T, 2); m/s, rad/s.
        tuning: The *true* noise, as from `true_tuning`: Q and ``process`` of the execution; R of the measurement, with ``1 /
            heading_information(noise)`` for the heading if there are spikes. By `DeadReckoning` nothing is measured after
            the start.
        measured: Whether a measurement arrived, shape (T,) or (N, T); None if one always did.
        dt: Control interval, s.
        integrator: "euler" or "midpoint".

    Returns:
        Bound on the error covariance at each time, shape (T + 1, 5, 5).
    """
    rule = choose("integrator", integrator, INTEGRATORS)
    states = np.asarray(true_states, np.float64).reshape(-1, *np.shape(true_states)[-2:])
    inputs = np.asarray(commands, np.float64).reshape(len(states), -1, 2)
    arrived = np.ones(inputs.shape[:2], np.bool_) if measured is None else np.asarray(measured, np.bool_)
    arrived = arrived.reshape(inputs.shape[:2]) & (not isinstance(tuning.kind, DeadReckoning))
    certain = matrix(ekf.initialize(Pose(0.0, 0.0, 0.0), tuning).belief.covariance)
    P = np.broadcast_to(certain, (len(states), 5, 5)).copy()
    total = [P.mean(axis=0)]
    R, added = np.array(tuning.R), np.array(tuning.Q) * (dt / REFERENCE_PERIOD)
    for k in range(inputs.shape[1]):
        F = jacobians(states[:, k], dt=dt, integrator=rule)
        F[:, 3, 3] = F[:, 4, 4] = float(isinstance(tuning.kind, Kalman) and tuning.kind.remember_velocity)
        P = F @ P @ np.swapaxes(F, 1, 2)
        P[:, [0, 1, 2], [0, 1, 2]] += added[:3]
        twists = (Command(*twist) for twist in inputs[:, k].tolist())
        executed = np.array([execution_variances(twist, tuning.process, dt) for twist in twists])
        P[:, [3, 4], [3, 4]] += np.maximum(executed, added[3:])
        for component in range(3):  # one after the other, as in `ekf`
            column = P[:, :, component]
            S = column[:, component] + R[component]
            share = np.divide(1.0, S, out=np.zeros_like(S), where=arrived[:, k] & (S > 1e-300))
            P = P - column[:, :, None] * column[:, None, :] * share[:, None, None]
        P[:, range(5), range(5)] = np.maximum(P[:, range(5), range(5)], 0.0)  # after an exact measurement, rounding
        total.append(P.mean(axis=0))
    return np.array(total)
