"""An extended Kalman filter for a unicycle whose pose is measured.

State ``[x, y, theta, v, omega]``, input ``[v_cmd, omega_cmd]``, measurement ``[x, y, theta]``. The measured components are
independent, so the update takes them one after the other: three scalar updates, which equal the joint one, need no inverse,
and leave a covariance that is symmetric by construction.

References:
    Bar-Shalom, Li, Kirubarajan, *Estimation with Applications to Tracking and Navigation* (2001), section 10.3 (EKF).
    Bierman, *Factorization Methods for Discrete Sequential Estimation* (1977): processing scalar measurements in turn.
"""

from __future__ import annotations

from typing import NamedTuple

from turtlebot_gym.kernel import kernel
from turtlebot_gym.models.angles import sincos, wrap
from turtlebot_gym.models.odometry import increment
from turtlebot_gym.models.unicycle import execution_variances
from turtlebot_gym.parameters import REFERENCE_PERIOD, FilterTuning
from turtlebot_gym.values import Belief, Command, Covariance, Pose, State


class Estimate(NamedTuple):
    """All that the filter remembers from step to step."""

    belief: Belief
    nis: float
    """Normalized innovation squared of the last measurement."""
    rejections: float
    """Measurements refused in a row."""


@kernel
def initialize(odometry: Pose, tuning: FilterTuning) -> Estimate:
    """Start from the first measurement, or at the origin where the tuning says so."""
    R, P0 = tuning.R, tuning.P0
    x, y, theta = (0.0, 0.0, 0.0) if tuning.from_origin else (odometry.x, odometry.y, odometry.theta)
    xx, yy, tt = (P0[0], P0[1], P0[2]) if tuning.from_origin else (R[0], R[1], R[2])
    vv, ww = (P0[3], P0[4]) if tuning.from_origin else (0.0, 0.0)
    covariance = Covariance(xx, 0.0, 0.0, 0.0, 0.0, yy, 0.0, 0.0, 0.0, tt, 0.0, 0.0, vv, 0.0, ww)
    return Estimate(Belief(State(x, y, theta, 0.0, 0.0), covariance), 0.0, 0.0)


@kernel
def predict(belief: Belief, command: Command, tuning: FilterTuning, dt: float, middle: float) -> Belief:
    """Move the belief by one control interval: the pose with the believed twist, and then the twist to the command.

    Args:
        belief: Mean and covariance at the start of the interval.
        command: The twist that the robot is asked for from now on.
        tuning: Process noise.
        dt: Interval, s.
        middle: The integrator, a value of `INTEGRATORS`.

    Returns:
        ``f(mean, command)`` and ``F P F' + Q`` with F the true Jacobian of f: since the command *replaces* the twist, its rows
        for v and omega are zero (one, for a tuning with ``remember_velocity``).
    """
    mean, P = belief
    sine, cosine = sincos(mean.theta + middle * mean.omega * dt)
    pose = Pose(mean.x + mean.v * cosine * dt, mean.y + mean.v * sine * dt, wrap(mean.theta + mean.omega * dt))
    # The rows of F for the pose: [1 0 a c e], [0 1 b s g], [0 0 1 0 dt].
    a, c = -mean.v * sine * dt, cosine * dt
    b, s = mean.v * cosine * dt, sine * dt
    e, g = middle * dt * a, middle * dt * b
    keep = 1.0 if tuning.remember_velocity else 0.0
    var_v, var_omega = execution_variances(command, tuning.process, dt)
    share = dt / REFERENCE_PERIOD
    Q = tuning.Q

    # F P, row by row ...
    xx = P.xx + a * P.xt + c * P.xv + e * P.xw
    xy = P.xy + a * P.yt + c * P.yv + e * P.yw
    xt = P.xt + a * P.tt + c * P.tv + e * P.tw
    xv = P.xv + a * P.tv + c * P.vv + e * P.vw
    xw = P.xw + a * P.tw + c * P.vw + e * P.ww
    yy = P.yy + b * P.yt + s * P.yv + g * P.yw
    yt = P.yt + b * P.tt + s * P.tv + g * P.tw
    yv = P.yv + b * P.tv + s * P.vv + g * P.vw
    yw = P.yw + b * P.tw + s * P.vw + g * P.ww
    tt = P.tt + dt * P.tw
    tv = P.tv + dt * P.vw
    tw = P.tw + dt * P.ww
    # ... times F', plus Q. Rounding may leave less than 0 where a component is known exactly.
    covariance = Covariance(
        max(xx + a * xt + c * xv + e * xw, 0.0) + Q[0] * share,
        xy + b * xt + s * xv + g * xw,
        xt + dt * xw,
        keep * xv,
        keep * xw,
        max(yy + b * yt + s * yv + g * yw, 0.0) + Q[1] * share,
        yt + dt * yw,
        keep * yv,
        keep * yw,
        max(tt + dt * tw, 0.0) + Q[2] * share,
        keep * tv,
        keep * tw,
        keep * P.vv + max(var_v, Q[3] * share),
        keep * P.vw,
        keep * P.ww + max(var_omega, Q[4] * share),
    )
    return Belief(State(pose.x, pose.y, pose.theta, command.v, command.omega), covariance)


@kernel
def _condition(P: Covariance, column: tuple[float, float, float, float, float], inverse: float) -> Covariance:
    """Take out of P what a scalar measurement tells: ``P - column column' / S``, with ``inverse`` for 1 / S."""
    x, y, t, v, w = column
    i, j, k, m, n = x * inverse, y * inverse, t * inverse, v * inverse, w * inverse
    return Covariance(
        max(P.xx - i * x, 0.0), P.xy - i * y, P.xt - i * t, P.xv - i * v, P.xw - i * w,
        max(P.yy - j * y, 0.0), P.yt - j * t, P.yv - j * v, P.yw - j * w,
        max(P.tt - k * t, 0.0), P.tv - k * v, P.tw - k * w,
        max(P.vv - m * v, 0.0), P.vw - m * w,
        max(P.ww - n * w, 0.0),
    )  # fmt: skip


@kernel
def _inverse(S: float) -> float:
    """Return 1 / S, and 0 for the S = 0 of a component that is known already and measured without noise."""
    some = S > 1e-300  # the inverse of less may be infinite
    return 1.0 / (S if some else 1.0) if some else 0.0


@kernel
def innovation(mean: State, z: Pose, tuning: FilterTuning) -> Pose:
    """Return measured minus predicted pose, the heading wrapped unless the tuning says otherwise."""
    turn = z.theta - mean.theta
    return Pose(z.x - mean.x, z.y - mean.y, wrap(turn) if tuning.wrap_innovation else turn)


@kernel
def update(belief: Belief, z: Pose, tuning: FilterTuning) -> tuple[Belief, float]:
    """Condition the belief on a measured pose.

    Args:
        belief: Prior mean and covariance.
        z: Measured pose; m, m, rad.
        tuning: Measurement variances, and whether the heading's innovation is wrapped.

    Returns:
        The posterior, and the normalized innovation squared ``nu' S^-1 nu`` with ``S = H P H' + R``.
    """
    mean, P = belief
    R = tuning.R
    nu = innovation(mean, z, tuning)

    inverse_x = _inverse(P.xx + R[0])
    gain_x = nu.x * inverse_x
    x, y, t, v, w = gain_x * P.xx, gain_x * P.xy, gain_x * P.xt, gain_x * P.xv, gain_x * P.xw
    nis = gain_x * nu.x
    P = _condition(P, (P.xx, P.xy, P.xt, P.xv, P.xw), inverse_x)

    nu_y = nu.y - y  # what the corrections so far have not yet explained
    inverse_y = _inverse(P.yy + R[1])
    gain_y = nu_y * inverse_y
    x, y, t = x + gain_y * P.xy, y + gain_y * P.yy, t + gain_y * P.yt
    v, w = v + gain_y * P.yv, w + gain_y * P.yw
    nis += gain_y * nu_y
    P = _condition(P, (P.xy, P.yy, P.yt, P.yv, P.yw), inverse_y)

    nu_t = nu.theta - t
    inverse_t = _inverse(P.tt + R[2])
    gain_t = nu_t * inverse_t
    x, y, t = x + gain_t * P.xt, y + gain_t * P.yt, t + gain_t * P.tt
    v, w = v + gain_t * P.tv, w + gain_t * P.tw
    nis += gain_t * nu_t
    P = _condition(P, (P.xt, P.yt, P.tt, P.tv, P.tw), inverse_t)

    return Belief(State(mean.x + x, mean.y + y, wrap(mean.theta + t), mean.v + v, mean.omega + w), P), nis


@kernel
def step(
    estimate: Estimate,
    command: Command,
    before: Pose,
    odometry: Pose,
    measured: bool,
    tuning: FilterTuning,
    dt: float,
    middle: float,
) -> Estimate:
    """Predict with the command, and correct by the odometry where there is one.

    Args:
        estimate: What the filter remembers.
        command: The twist that the robot is asked for from now on.
        before: The last odometry before; where the odometry is the filter's input, the pose moves as it did since then.
        odometry: The odometry; the one before where none arrived.
        measured: Whether it arrived; where it did not, the filter only predicts.
        tuning: Noise, gate and mode.
        dt: Interval, s.
        middle: The integrator, a value of `INTEGRATORS`.
    """
    belief = estimate.belief
    prior = predict(belief, command, tuning, dt, middle)
    mean = prior.mean

    if tuning.odometry_input:
        pose = Pose(belief.mean.x, belief.mean.y, belief.mean.theta)
        moved = increment(pose, before, odometry, sincos(pose.theta - before.theta))
        driven = State(moved.x, moved.y, moved.theta, mean.v, mean.omega)
        return Estimate(Belief(driven, prior.covariance), 0.0, 0.0)

    posterior, nis = update(prior, odometry, tuning)
    refused = measured and nis > tuning.gate
    rejections = estimate.rejections + 1.0 if refused else (0.0 if measured else estimate.rejections)
    lost = rejections >= tuning.max_rejections
    refused_belief = _restart(prior, odometry, tuning) if lost else prior
    belief = refused_belief if refused else (posterior if measured else prior)
    return Estimate(belief, nis if measured else estimate.nis, 0.0 if lost else rejections)


@kernel
def _restart(prior: Belief, z: Pose, tuning: FilterTuning) -> Belief:
    """Forget the believed pose and take the measured one; the twist stays as commanded."""
    R, P = tuning.R, prior.covariance
    covariance = Covariance(R[0], 0.0, 0.0, 0.0, 0.0, R[1], 0.0, 0.0, 0.0, R[2], 0.0, 0.0, P.vv, P.vw, P.ww)
    return Belief(State(z.x, z.y, z.theta, prior.mean.v, prior.mean.omega), covariance)
