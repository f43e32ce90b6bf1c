"""The localizer: a belief that wheels move and scans condition, by kernels that simulations, nodes and recordings share.

The update is an iterated extended Kalman update of pose and range scale by all beams at once, Gauss-Newton with the belief as
prior. What a scan does not determine, such as the position along a corridor, stays as uncertain as it was.

* Errors of the map do not average out while the robot stands: a scan's pose has a further error, so that all scans from one
  place together are no more accurate than the map, however long the robot stands there.
* Noise of the wheels grows while scans surprise: a blocked robot whose wheels turn is found by the next scans.
* Where few beams fit after the descent from the prediction, or only a surprising pose explains them, starts all around it are
  tried; if none explains the scan, the belief's variance grows.

References:
    Bell, Cathey, "The iterated Kalman filter update as a Gauss-Newton method", *IEEE Transactions on Automatic Control* 38
    (1993).
"""

from __future__ import annotations

from typing import NamedTuple

from turtlebot_gym.estimation.update import Sixth, wrapped
from turtlebot_gym.kernel import kernel, sqrt
from turtlebot_gym.localization.descent import LEAST_BEAMS, best_descent, widened
from turtlebot_gym.localization.information import ScanPoints
from turtlebot_gym.localization.tuning import LocalizerTuning
from turtlebot_gym.models.angles import sincos, wrap
from turtlebot_gym.models.odometry import increment
from turtlebot_gym.values import Belief, Command, Covariance, Pose, State

FRESH, LEAST_TAKE = 0.5, 1e-9
"""Share of the map's remaining information on a place that one scan uses, and its least value: the variance stays finite."""
FORGOTTEN, FORGOTTEN_TURN = 0.5, 1.0  # way and turn after which errors of the map are independent, m and rad
USUAL, KEPT = 0.7, 0.8
"""Normalized innovation squared of a scan per degree of freedom where nothing is wrong: below 1, since beams rarely differ as
much as map and LiDAR may; share of `Located.slack` that stays after a scan without any surprise."""
LOOSEN = 0.03  # standard deviation added by a scan that no start explains, m; half of it in rad
FITTING = 0.9  # share of fitting beams from which a surprise is attributed to the wheels
LEAP = 0.3  # correction by one scan, m or rad, after which the whole map is searched too
UNUSUAL, HABIT, CALM = 2.0, 100.0, 40.0
"""Factor of the usual share of beams that do not fit, see `LocalizerTuning.suspicion`; scans over which the localizer learns
that share; and scans for which it does not look elsewhere again once it has seen that it is right."""
SURE = 0.95  # weight from which on the best hypothesis is believed
SHARED = 3.0
"""Factor of the drift since a beam was measured, where beams count the less the older they are: they share that drift."""
HIDDEN = 0.25
"""Share of the drift during a scan that remains: the mean of a random walk differs from its end by a third of the walk's
variance, that of beams that count the more the newer they are by less."""
TRACKING, UNSURE, LOST = 0, 1, 2
VAGUE, SILENT = 0.25, 2.0
"""Standard deviation of the position beyond which a robot is unsure, m, and time without a scan that agrees with the belief
after which it is lost, s."""


class Located(NamedTuple):
    """State of the localizer."""

    belief: Belief
    nis: float
    """Normalized innovation squared of the last scan, per degree of freedom times three, like a pose's."""
    scale: Sixth
    """The share by which ranges are too long."""
    fits: float
    """Share of the last scan's beams that end near a surface of the map; 1 before the first."""
    misfits: float
    """Scans that put the place in doubt, less those that do not; negative while it is not doubted again."""
    taken: float
    """Share of the map's information on this place that scans have used; it falls as the robot moves on."""
    slack: float
    """Factor of the wheels' variances."""
    scans: float
    """Number of scans."""
    moves: float
    """Number of moves."""
    weight: float
    """Weight of the best hypothesis: 1 while there is only one, 0 for a lost robot that has none."""
    way_drift: float
    """Variance of the way by time that the last move has added, m^2 ..."""
    turn_drift: float
    """... and of the turn, rad^2."""
    strays: float
    """Share of a scan's beams that usually disagree: the map lacks something, or people walk about."""
    agrees: float
    """Share of the last scan's beams that agree with the belief, see `descent.agreeing`; 1 before the first."""
    silent: float
    """Time since a scan agreed with the belief, s."""


@kernel
def locate(pose: Pose, R: tuple[float, float, float], q: LocalizerTuning) -> Located:
    """Return the localizer at a pose that is known with the variances R; m^2, m^2, rad^2."""
    covariance = Covariance(R[0], 0.0, 0.0, R[1], 0.0, R[2])
    belief = Belief(State(pose.x, pose.y, pose.theta, 0.0, 0.0), covariance)
    scale = Sixth(0.0, q.scale * q.scale, Pose(0.0, 0.0, 0.0))
    return Located(belief, 0.0, scale, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0)


@kernel
def _spread(
    P: Covariance, heading: float, way: float, turn: float, drift: tuple[float, float], q: LocalizerTuning
) -> Covariance:
    """Add the noise of a step to a covariance: that by time, ``drift``, and that by way and turn."""
    sine, cosine = sincos(heading)
    step, cross, swerve, sideways = q.along_step * way, q.aside_step * way, q.turn_step * turn, q.aside_turn * turn
    along = drift[0] + q.along_walk * q.along_walk * way + step * step
    aside = q.aside_walk * q.aside_walk * way + cross * cross + sideways * sideways
    heading_noise = drift[1] + q.turn_walk * q.turn_walk * way + swerve * swerve
    return P._replace(
        xx=P.xx + cosine * cosine * along + sine * sine * aside,
        xy=P.xy + cosine * sine * (along - aside),
        yy=P.yy + sine * sine * along + cosine * cosine * aside,
        tt=P.tt + heading_noise,
    )


@kernel
def move(
    located: Located, before: Pose, now: Pose, twist: Command, drift: tuple[float, float], dt: float, q: LocalizerTuning
) -> Located:
    """Move the belief as the odometry moved in an interval of ``dt`` s, from a pose to another.

    The twist is executed from now on; it is kept in the belief, whose pose does not depend on it. ``drift`` has the variances
    of way and turn that the interval adds by time, m^2 and rad^2; noise by way is in the tuning.
    """
    mean, P = located.belief
    pose = increment(Pose(mean.x, mean.y, mean.theta), before, now, sincos(mean.theta - before.theta))
    dx, dy, scale = pose.x - mean.x, pose.y - mean.y, located.scale
    # F = [1 0 -dy; 0 1 dx; 0 0 1] for the pose; the twist is replaced.
    xt, yt, c = P.xt - dy * P.tt, P.yt + dx * P.tt, scale.column
    moved = Covariance(P.xx - dy * (P.xt + xt), P.xy - dy * P.yt + dx * xt, xt, P.yy + dx * (P.yt + yt), yt, P.tt)
    way, turn = sqrt(dx * dx + dy * dy), abs(wrap(now.theta - before.theta))
    drift = (drift[0] * located.slack, drift[1] * located.slack)
    spread = _spread(moved, mean.theta, way, turn, drift, q)
    scale = scale._replace(column=Pose(c.x - dy * c.theta, c.y + dx * c.theta, c.theta))
    taken = located.taken * max(1.0 - way / FORGOTTEN - turn / FORGOTTEN_TURN, 0.0)
    located = located._replace(taken=taken, moves=located.moves + 1.0, silent=located.silent + dt)
    belief = Belief(State(pose.x, pose.y, pose.theta, twist.v, twist.omega), spread)
    return located._replace(belief=belief, scale=scale, way_drift=drift[0], turn_drift=drift[1])


@kernel
def scan(located: Located, sight: ScanPoints, q: LocalizerTuning, unseen: tuple[float, float] = (0.0, 0.0)) -> Located:
    """Condition the belief on a scan, as seen from the present pose.

    ``unseen`` is the number of moves since the scan and during it, whose drift it does not show, see `points.swept`.
    """
    take = max(FRESH * (1.0 - located.taken), LEAST_TAKE)
    bias = (q.bias * q.bias / take, q.turn_bias * q.turn_bias / take)
    since, during = unseen
    end = best_descent(sight, located.belief, located.scale, bias, q, SHARED * during * located.turn_drift)
    before = max(located.misfits, 0.0)
    if end.freedom == 0.0 and sight.number < LEAST_BEAMS:  # it says nothing
        return located
    if end.freedom == 0.0:  # its beams end where nothing is known: the belief has left the map
        misfits = max(before + 1.0, 1.0 * q.patience) if located.silent > SILENT else before + 1.0
        weight = 0.0 if misfits >= q.patience else located.weight
        return located._replace(fits=0.0, misfits=misfits, scans=located.scans + 1.0, weight=weight, agrees=0.0)
    bad, agrees = 0.7 * q.doubt, end.agrees  # below this share no start has explained the scan
    loose = LOOSEN * LOOSEN * max(1.0 - agrees / bad, 0.0) if bad > 0.0 else 0.0
    hidden = since + HIDDEN * during
    drift, turn_drift = 0.5 * hidden * located.way_drift, hidden * located.turn_drift
    belief = wrapped(widened(end.belief, loose + drift, 0.25 * loose + turn_drift))
    surprise = end.nis / end.freedom
    # Where beams do not fit, the map surprises and not the wheels.
    by_wheels = min(surprise / USUAL, q.gate * q.gate) if end.fits >= FITTING else min(surprise, 1.0)
    growth = KEPT + (1.0 - KEPT) * by_wheels  # 1 where scans surprise as much as they should
    slack = min(max(located.slack * growth, 1.0), q.widening)
    astray = 1.0 - agrees
    is_strange = astray > UNUSUAL * located.strays + q.suspicion
    misfits = before + 1.0 if is_strange else max(before - 1.0, 0.0)
    learns = before == 0.0 and agrees >= bad  # doubtful or unexplained scans are not the usual ones
    strays = located.strays + ((astray - located.strays) / HABIT if learns else 0.0)
    if located.misfits < 0.0 and agrees >= max(bad, q.trust):
        misfits, is_strange = located.misfits + 1.0, False
    silent = located.silent if is_strange or before >= q.patience else 0.0
    misfits = max(misfits, 1.0 * q.patience) if silent > SILENT else misfits
    weight = 0.0 if misfits >= q.patience and agrees < bad else 1.0
    was, now = located.belief.mean, belief.mean
    dx, dy, turn = now.x - was.x, now.y - was.y, wrap(now.theta - was.theta)
    if dx * dx + dy * dy > LEAP * LEAP or abs(turn) > LEAP:  # it may have been carried farther
        misfits = max(misfits, 1.0 * q.patience)
    taken, scans = min(located.taken + take, 1.0), located.scans + 1.0
    located = located._replace(belief=belief, nis=3.0 * surprise, scale=end.scale, taken=taken, slack=slack, scans=scans)
    return located._replace(fits=end.fits, agrees=agrees, strays=strays, misfits=misfits, weight=weight, silent=silent)


@kernel
def state_of(located: Located, q: LocalizerTuning) -> int:
    """Return `TRACKING`; `UNSURE` if scans put the place in doubt, or it is vague; `LOST` if nobody may drive by the belief.

    A robot is lost if too many scans put its place in doubt, the last one among them, and none is likely, if as many more have
    not confirmed a likely one, and if no scan has agreed with its belief for some time, be it that there are none.
    """
    P, looks = located.belief.covariance, located.misfits >= q.patience
    unsure = 2.0 * located.misfits >= q.patience or located.agrees < 0.7 * q.doubt or P.xx + P.yy > VAGUE * VAGUE
    is_lost = looks and (not located.weight > SURE or located.misfits >= 2.0 * q.patience)
    is_lost = located.silent > SILENT or (is_lost and 1.0 - located.agrees > UNUSUAL * located.strays + q.suspicion)
    return LOST if is_lost else (UNSURE if unsure else TRACKING)
