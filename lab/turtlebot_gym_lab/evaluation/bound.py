"""The best accuracy that any filter could reach.

References:
    Tichavsky, Muravchik, Nehorai, "Posterior Cramer-Rao bounds for discrete-time nonlinear filtering" (1998).
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

from turtlebot_gym.config import choose
from turtlebot_gym.models.unicycle import INTEGRATORS, execution_variances, motion
from turtlebot_gym.parameters import REFERENCE_PERIOD, DeadReckoning, FilterTuning, Kalman, Noise, OdometryNoise, Tutorial
from turtlebot_gym.values import Command


def heading_information(noise: OdometryNoise) -> float:
    """Return the Fisher information of a measured heading, 1/rad^2; without spikes, the inverse of the variance.

    With spikes the noise is the mixture ``(1 - e) N(0, s^2) + e/2 N(a, s^2) + e/2 N(-a, s^2)``, and the information is the
    integral of ``p'^2 / p``. A filter that models the mixture can use all of it; one that assumes Gaussian noise gets at most
    ``1 / (s^2 + e a^2)``.

    Raises:
        ValueError: If the heading is measured without white noise, which makes its information infinite.
    """
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
    certain = np.diag(tuning.P0 if tuning.from_origin else (*tuning.R, 0.0, 0.0))
    P = np.broadcast_to(certain, (len(states), 5, 5)).copy()
    total = [P.mean(axis=0)]
    R, added = np.array(tuning.R), np.array(tuning.Q) * (dt / REFERENCE_PERIOD)
    for k in range(inputs.shape[1]):
        F = _jacobians(states[:, k], dt=dt, integrator=rule)
        F[:, 3, 3] = F[:, 4, 4] = float(isinstance(tuning.kind, Tutorial))
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


def _jacobians(states: ArrayLike, *, dt: float, integrator: float) -> NDArray[np.float64]:
    """Return the derivative of the motion at states (n, 5), (n, 5, 5); commands replace the twist, whose rows are zero."""
    twists = np.asarray(states, np.float64)[:, 2:].tolist()
    moved = np.array([motion(theta, v, omega, dt, integrator)[3:] for theta, v, omega in twists])
    F = np.zeros((len(twists), 5, 5))
    F[:, [0, 1, 2], [0, 1, 2]] = 1.0
    F[:, 0, 2:], F[:, 1, 2:], F[:, 2, 4] = moved[:, :3], moved[:, 3:], dt
    return F
