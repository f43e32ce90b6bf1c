"""An extended Kalman filter for a unicycle whose pose is measured; with a gate for the heading, and without any correction.

State ``[x, y, theta]``, input the executed twist, measurement the state. Its measured components are independent: three scalar
updates in turn equal the joint one, need no matrix inverse, and keep the covariance symmetric by construction.

The gate refuses a measured pose that the belief cannot explain, but never for ever. A refused pose leaves the belief as it was
predicted. A spike, a leap or a flip does not last; after refusals for as long as `parameters.Kalman.lockout` the belief is
wrong, and the filter starts anew from the measured pose. A belief that rests on a single measurement has no better claim than
the next one, so there the first refusal is enough.

References:
    Bar-Shalom, Li, Kirubarajan, *Estimation with Applications to Tracking and Navigation* (2001), section 10.3 (EKF), and 5.4:
    the normalized innovation squared and its chi-square test.
    Bierman, *Factorization Methods for Discrete Sequential Estimation* (1977): processing scalar measurements in turn.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from turtlebot_gym.estimation.interface import Filter
from turtlebot_gym.estimation.update import NOTHING, Variances, correct_both
from turtlebot_gym.kernel import algebra, kernel
from turtlebot_gym.models.angles import sincos, wrap
from turtlebot_gym.models.odometry import increment
from turtlebot_gym.models.unicycle import expected, motion
from turtlebot_gym.parameters import REFERENCE_PERIOD, DeadReckoning, FilterTuning, Gated
from turtlebot_gym.values import Belief, Command, Covariance, Pose, Senses, State

ONE_MEASUREMENT = -1.0  # number of refusals that stands for a belief which rests on one measurement


class Estimate(NamedTuple):
    """State that the filter keeps between steps."""

    belief: Belief
    nis: float
    """Normalized innovation squared of the last measurement."""
    rejections: float
    """Number of measurements refused in a row, or `ONE_MEASUREMENT`; for dead reckoning, of those that were lost."""


@kernel
def start(senses: Senses, tuning: FilterTuning) -> Estimate:
    """Start from the first measurement, or at the origin if the tuning says so."""
    R, P0, odometry = tuning.R, tuning.P0, senses.odometry.pose
    x, y, theta = (0.0, 0.0, 0.0) if tuning.from_origin else (odometry.x, odometry.y, odometry.theta)
    xx, yy, tt = (P0[0], P0[1], P0[2]) if tuning.from_origin else (R[0], R[1], R[2])
    vv, ww = (P0[3], P0[4]) if tuning.from_origin else (0.0, 0.0)
    belief = Belief(State(x, y, theta, 0.0, 0.0), Covariance(xx, 0.0, 0.0, yy, 0.0, tt, vv, ww))
    return Estimate(belief, 0.0, 0.0 if tuning.from_origin else ONE_MEASUREMENT)


@algebra
def predict(belief: Belief, twist: Command, tuning: FilterTuning, dt: float, integrator: float) -> Belief:
    """Move the belief by one control interval, dt in s: the pose with the believed twist, then the twist to the executed one.

    ``twist`` is the best knowledge of what is executed from now on: as odometry reports it, or the command.

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
def correct(belief: Belief, z: Pose, R: Variances) -> tuple[Belief, float]:
    """Condition the belief on a measured pose, and return the normalized innovation squared ``nu' S^-1 nu``, ``S = P + R``."""
    belief, _, nis = correct_both(belief, NOTHING, z, (R[0], R[1], R[2], 0.0, 0.0, 0.0))
    return belief, nis


class Gating(NamedTuple):
    """What becomes of a measured pose: refused or not; if refused, whether the filter is lost and starts anew from it."""

    refused: bool
    lost: bool
    rejections: float
    """Number of measurements refused in a row, or `ONE_MEASUREMENT`."""


@kernel
def judge(rejections: float, measured: bool, is_outlier: bool, tuning: FilterTuning, dt: float) -> Gating:
    """Return the verdict on a measurement, if there is one, by a tuning with the numbers of `parameters.Kalman`; dt in s."""
    rules, count = tuning.kind, max(rejections, 0.0) + 1.0
    refused, enough = measured & is_outlier, max(1.0 * rules.max_rejections, rules.lockout / dt - 1e-9)
    lost = refused & ((rejections < 0.0) | (count >= enough))
    after = count if refused else (0.0 if measured else rejections)
    return Gating(refused, lost, ONE_MEASUREMENT if lost else after)


@kernel
def settle(verdict: Gating, measured: bool, prior: Belief, posterior: Belief, z: Pose, tuning: FilterTuning) -> Belief:
    """Return the belief after a step: predicted, corrected, or anew from the measured pose, with the twist as executed."""
    R, P = tuning.R, prior.covariance
    anew = Belief(prior.mean._replace(x=z.x, y=z.y, theta=z.theta), Covariance(R[0], 0.0, 0.0, R[1], 0.0, R[2], P.vv, P.ww))
    refused = anew if verdict.lost else prior
    return refused if verdict.refused else (posterior if measured else prior)


@kernel
def step(estimate: Estimate, before: Senses, senses: Senses, tuning: FilterTuning, dt: float, integrator: float) -> Estimate:
    """Predict, and correct by the measured pose if one arrived; see `interface.Filter`."""
    z, twist, measured = senses.odometry
    prior = predict(estimate.belief, twist, tuning, dt, integrator)
    posterior, nis = correct(prior, z, tuning.R)
    verdict = judge(estimate.rejections, measured, nis > tuning.kind.gate, tuning, dt)
    belief = settle(verdict, measured, prior, posterior, z, tuning)
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
    (z, twist, measured), R = senses.odometry, tuning.R
    prior = predict(estimate.belief, twist, tuning, dt, integrator)
    posterior, nis = correct(prior, z, R)
    placed, nis_position = correct(prior, z, (R[0], R[1], math.inf))
    misplaced = nis_position > tuning.kind.gate
    is_outlier = misplaced | (nis - nis_position > tuning.kind.heading_gate)
    verdict = judge(estimate.rejections, measured, is_outlier, tuning, dt)
    spared = placed if verdict.refused & (not misplaced) else prior
    belief = settle(verdict, measured, spared, posterior, z, tuning)
    return Estimate(belief, nis if measured else estimate.nis, verdict.rejections)


@kernel
def _carried_start(senses: Senses, tuning: FilterTuning) -> Estimate:
    return start(senses, tuning)._replace(rejections=0.0)


@kernel
def _carried_step(
    estimate: Estimate, before: Senses, senses: Senses, tuning: FilterTuning, dt: float, integrator: float
) -> Estimate:
    """Move the belief as the odometry moved, or by the twist if its systematic errors are known; the covariance grows.

    The twist also moves it where odometry moved farther than its twists at the start and the end of the time explain.
    """
    mean, process, rules = estimate.belief.mean, tuning.process, tuning.kind
    (z, twist, measured), last, missed = senses.odometry, before.odometry.pose, estimate.rejections
    is_exact = (process.scale == 1.0) & (process.turn_scale == 1.0) & (process.veer == 0.0)  # without the branch of an `and`
    prior = predict(estimate.belief, twist, tuning, dt, integrator)
    time, x, y = (missed + 1.0) * dt, z.x - last.x, z.y - last.y  # since the last measurement
    way = max(abs(mean.v), abs(twist.v)) * time + rules.leap
    turn = max(abs(mean.omega), abs(twist.omega)) * time + rules.leap_turn
    leaps = (x * x + y * y > way * way) | (abs(wrap(z.theta - last.theta)) > turn)
    pose = increment(Pose(mean.x, mean.y, mean.theta), last, z, sincos(mean.theta - last.theta))
    by_increment = prior.mean._replace(x=pose.x, y=pose.y, theta=pose.theta)
    moved = by_increment if is_exact & (not leaps) else prior.mean
    return Estimate(Belief(moved, prior.covariance), 0.0, 0.0 if measured else missed + 1.0)


EXTENDED_KALMAN = Filter(start, step, fix)
"""Predicts with the executed twist and corrects by the measured pose."""
DEAD_RECKONING = Filter(_carried_start, _carried_step, fix, kind=DeadReckoning())
"""Moves as the wheel odometry moves, the best that a robot with wheel odometry alone can do."""
GATED = Filter(start, _gated_step, fix, kind=Gated(heading_gate=6.635))
"""Refuses an implausible heading, which then does not cost the position, and a pose at an implausible position."""
