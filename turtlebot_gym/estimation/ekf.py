"""An extended Kalman filter for a unicycle whose pose is measured; with a gate for the heading, and without any correction.

State ``[x, y, theta]``, input the executed twist, measurement the state. Its measured components are independent: three scalar
updates in turn equal the joint one, need no matrix inverse, and keep the covariance symmetric by construction.

References:
    Bar-Shalom, Li, Kirubarajan, *Estimation with Applications to Tracking and Navigation* (2001), section 10.3 (EKF).
    Bierman, *Factorization Methods for Discrete Sequential Estimation* (1977): processing scalar measurements in turn.
"""

from __future__ import annotations

from typing import NamedTuple

from turtlebot_gym.estimation.gate import ONE_MEASUREMENT, choose, judge, restart
from turtlebot_gym.estimation.interface import Filter
from turtlebot_gym.estimation.sixth import NOTHING, correct_both
from turtlebot_gym.estimation.update import Variances, of_heading, of_x, of_y, update, wrapped
from turtlebot_gym.kernel import algebra, kernel
from turtlebot_gym.models.angles import sincos, wrap
from turtlebot_gym.models.odometry import increment
from turtlebot_gym.models.unicycle import expected, motion
from turtlebot_gym.parameters import REFERENCE_PERIOD, DeadReckoning, FilterTuning, Gated
from turtlebot_gym.values import Belief, Command, Covariance, Pose, Senses, State


class Estimate(NamedTuple):
    """State that the filter keeps between steps."""

    belief: Belief
    nis: float
    """Normalized innovation squared of the last measurement."""
    rejections: float
    """Number of measurements refused in a row, or `gate.ONE_MEASUREMENT`; for dead reckoning, of those that were lost."""


@kernel
def initialize(odometry: Pose, tuning: FilterTuning) -> Estimate:
    """Start from the first measurement, or at the origin if the tuning says so."""
    R, P0 = tuning.R, tuning.P0
    x, y, theta = (0.0, 0.0, 0.0) if tuning.from_origin else (odometry.x, odometry.y, odometry.theta)
    xx, yy, tt = (P0[0], P0[1], P0[2]) if tuning.from_origin else (R[0], R[1], R[2])
    vv, ww = (P0[3], P0[4]) if tuning.from_origin else (0.0, 0.0)
    covariance = Covariance(xx, 0.0, 0.0, yy, 0.0, tt, vv, ww)
    return Estimate(Belief(State(x, y, theta, 0.0, 0.0), covariance), 0.0, 0.0 if tuning.from_origin else ONE_MEASUREMENT)


@kernel
def start(senses: Senses, tuning: FilterTuning) -> Estimate:
    """Start from the first measurement; see `interface.Filter`."""
    return initialize(senses.odometry.pose, tuning)


@algebra
def predict(belief: Belief, twist: Command, tuning: FilterTuning, dt: float, integrator: float) -> Belief:
    """Move the belief by one control interval: the pose with the believed twist, then the twist to the executed one.

    Args:
        belief: Mean and covariance at the start of the interval.
        twist: Best knowledge of the twist executed from now on: the one that odometry reports, or the command.
        tuning: Process noise, with the systematic errors of the twist, if they are known.
        dt: Interval, s.
        integrator: The integrator, a value of `INTEGRATORS`.

    Returns:
        ``f(mean, twist)``, and for the pose ``F P F' + G U G' + Q`` with F and G the true Jacobians of f with respect to the
        pose and the twist, whose variances U were those of the last interval.
    """
    mean, P = belief
    moved = motion(mean.theta, mean.v, mean.omega, dt, integrator)
    # The rows of F: [1 0 a], [0 1 b], [0 0 1]; those of G: [c e], [s g], [0 dt].
    a, c, e = moved.x_theta, moved.x_v, moved.x_omega
    b, s, g = moved.y_theta, moved.y_v, moved.y_omega
    executed, var_v, var_omega = expected(twist, tuning.process, dt)
    share, Q = dt / REFERENCE_PERIOD, tuning.Q

    # F P, row by row, and G U ...
    xx, xy, xt = P.xx + a * P.xt, P.xy + a * P.yt, P.xt + a * P.tt
    yy, yt = P.yy + b * P.yt, P.yt + b * P.tt
    xv, xw, yv, yw, tw = c * P.vv, e * P.ww, s * P.vv, g * P.ww, dt * P.ww
    # ... times F' and G', plus Q. Rounding may leave less than 0 where a component is known exactly.
    covariance = Covariance(
        max(xx + a * xt + c * xv + e * xw, 0.0) + Q[0] * share,
        xy + b * xt + s * xv + g * xw,
        xt + dt * xw,
        max(yy + b * yt + s * yv + g * yw, 0.0) + Q[1] * share,
        yt + dt * yw,
        max(P.tt + dt * tw, 0.0) + Q[2] * share,
        max(var_v, Q[3] * share),
        max(var_omega, Q[4] * share),
    )
    pose = State(mean.x + moved.x, mean.y + moved.y, wrap(mean.theta + moved.theta), executed.v, executed.omega)
    return Belief(pose, covariance)


@kernel
def correct_position(belief: Belief, z: Pose, R: Variances) -> tuple[Belief, float, float]:
    """Condition the belief on the position part of a measured pose.

    Returns:
        The posterior, with its heading not wrapped yet; the normalized innovation squared; and the rest of the heading's
        innovation, reduced by the turn that x and y already explain, which avoids wrapping twice.
    """
    prior = belief.mean.theta
    turn = wrap(z.theta - prior)
    belief, nis_x = update(belief, of_x(belief.covariance), z.x - belief.mean.x, R[0])
    belief, nis_y = update(belief, of_y(belief.covariance), z.y - belief.mean.y, R[1])
    return belief, nis_x + nis_y, turn - (belief.mean.theta - prior)


@kernel
def correct(belief: Belief, z: Pose, R: Variances) -> tuple[Belief, float]:
    """Condition the belief on a measured pose.

    Args:
        belief: Prior mean and covariance.
        z: Measured pose; m, m, rad.
        R: Variances of the measured x, y and heading; m^2, m^2, rad^2. Infinite for a heading that was not measured.

    Returns:
        The posterior, and the normalized innovation squared ``nu' S^-1 nu`` with ``S = P + R``.
    """
    belief, nis, turn = correct_position(belief, z, R)
    belief, nis_theta = update(belief, of_heading(belief.covariance), turn, R[2])
    return wrapped(belief), nis + nis_theta


@kernel
def step(estimate: Estimate, before: Senses, senses: Senses, tuning: FilterTuning, dt: float, integrator: float) -> Estimate:
    """Predict, and correct by the measured pose if one arrived; see `interface.Filter`."""
    odometry = senses.odometry
    prior = predict(estimate.belief, odometry.twist, tuning, dt, integrator)
    z, measured = odometry.pose, odometry.measured
    posterior, nis = correct(prior, z, tuning.R)
    verdict = judge(estimate.rejections, measured, nis > tuning.kind.gate, tuning, dt)
    belief = choose(verdict, measured, prior, posterior, restart(prior, z, tuning))
    return Estimate(belief, nis if measured else estimate.nis, verdict.rejections)


@kernel
def fix(estimate: Estimate, z: Pose, R: Variances, tuning: FilterTuning) -> Estimate:
    """Condition the belief on an external pose measurement; see `interface.Filter`."""
    belief, _, _ = correct_both(estimate.belief, NOTHING, z, R)
    return estimate._replace(belief=belief)


@kernel
def _gated_step(
    estimate: Estimate, before: Senses, senses: Senses, tuning: FilterTuning, dt: float, integrator: float
) -> Estimate:
    """Predict, and correct by a plausible position and by a plausible heading."""
    odometry, rules = senses.odometry, tuning.kind
    prior = predict(estimate.belief, odometry.twist, tuning, dt, integrator)
    z, measured = odometry.pose, odometry.measured
    placed, nis, turn = correct_position(prior, z, tuning.R)
    turned, nis_theta = update(placed, of_heading(placed.covariance), turn, tuning.R[2])
    misplaced = nis > rules.gate
    is_outlier = misplaced | (nis_theta > rules.heading_gate)
    verdict = judge(estimate.rejections, measured, is_outlier, tuning, dt)
    spared = prior if misplaced else wrapped(placed)
    refused = restart(prior, z, tuning) if verdict.lost else spared
    belief = refused if verdict.refused else (wrapped(turned) if measured else prior)
    return Estimate(belief, nis + nis_theta if measured else estimate.nis, verdict.rejections)


@kernel
def _carried_start(senses: Senses, tuning: FilterTuning) -> Estimate:
    return Estimate(initialize(senses.odometry.pose, tuning).belief, 0.0, 0.0)


@kernel
def _carried_step(
    estimate: Estimate, before: Senses, senses: Senses, tuning: FilterTuning, dt: float, integrator: float
) -> Estimate:
    """Move the belief as the odometry moved, or by the twist if its systematic errors are known; the covariance grows."""
    x, y, theta, _, _ = estimate.belief.mean
    process, (z, twist, measured), last = tuning.process, senses.odometry, before.odometry.pose
    is_exact = (process.scale == 1.0) & (process.turn_scale == 1.0) & (process.veer == 0.0)  # without the branch of an `and`
    prior = predict(estimate.belief, twist, tuning, dt, integrator)
    pose = increment(Pose(x, y, theta), last, z, sincos(theta - last.theta))
    missed = estimate.rejections  # measurements in a row, after which an increment is as many times as long
    carries = is_exact & (not _leaps(last, z, estimate.belief.mean, twist, (missed + 1.0) * dt, tuning))
    by_increment = prior.mean._replace(x=pose.x, y=pose.y, theta=pose.theta)
    mean = by_increment if carries else prior.mean
    return Estimate(Belief(mean, prior.covariance), 0.0, 0.0 if measured else missed + 1.0)


@kernel
def _leaps(last: Pose, z: Pose, moving: State, twist: Command, time: float, tuning: FilterTuning) -> bool:
    """Return whether odometry moved farther in a time, s, than its twists at the start and the end of it explain."""
    rules, x, y = tuning.kind, z.x - last.x, z.y - last.y
    way = max(abs(moving.v), abs(twist.v)) * time + rules.leap
    turn = max(abs(moving.omega), abs(twist.omega)) * time + rules.leap_turn
    return (x * x + y * y > way * way) | (abs(wrap(z.theta - last.theta)) > turn)


EXTENDED_KALMAN = Filter(start, step, fix)
"""Predicts with the executed twist and corrects by the measured pose."""
DEAD_RECKONING = Filter(_carried_start, _carried_step, fix, kind=DeadReckoning())
"""Moves as the wheel odometry moves, the best that a robot with wheel odometry alone can do."""
GATED = Filter(start, _gated_step, fix, kind=Gated(heading_gate=6.635))
"""Refuses an implausible heading, which then does not cost the position, and a pose at an implausible position."""
