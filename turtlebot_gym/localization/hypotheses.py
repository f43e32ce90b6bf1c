"""Several hypotheses of the pose of a robot that is lost, in doubt, or does not know where it starts.

The poses in the whole map that fit a scan best are tracked for some scans: odometry moves them, each scan refines them, and the
better it agrees with one, the more weight that one gains. Then the best is believed, if it has enough weight and fits. Weights
fade, so in a symmetric room, where only noise distinguishes the poses, several hypotheses remain.

People hide the true place, so that some other fits a scan by chance, but not many scans on the way. A place that agrees less
than perfectly is therefore believed only after more scans, and with a lead over all others, see `_outlasts`.

A belief that is in doubt is a hypothesis too, the first one: only a pose that fits well refutes it, since in a wrong map the
true pose fits badly, too. Otherwise it is confirmed, and not doubted again for some time.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from turtlebot_gym.estimation.update import Sixth
from turtlebot_gym.kernel import kernel, sqrt
from turtlebot_gym.localization import bank as banks
from turtlebot_gym.localization import descent
from turtlebot_gym.localization.bank import AGE, AGREES, FITS, LAST, LOG_WEIGHT, MOST, NONE, OFF, RIGHT, TRIAL, UNLIKELY
from turtlebot_gym.localization.descent import APART, LEAST_BEAMS, TURNED, WIDTH, agreement, descend, gain_of, keep
from turtlebot_gym.localization.information import Guess, ScanPoints
from turtlebot_gym.localization.localizer import CALM, HABIT, SILENT, SURE, Located, locate, scan
from turtlebot_gym.localization.points import Timing, pose_of, swept, to_points
from turtlebot_gym.localization.tuning import LocalizerTuning
from turtlebot_gym.models.angles import wrap
from turtlebot_gym.rooms.scene import LocalizerMemory
from turtlebot_gym.values import Belief, Covariance, Pose, State

CYCLE = 4  # scans from one search of the whole map, or decision, to the next
PATIENCE = 4 * CYCLE
"""Scans after which a belief that is in doubt is confirmed if it is the best hypothesis, or the whole map is searched anew."""
FADING, BONUS, LATE = 0.95, 1.0, 3.0
"""Share of the logarithm of a weight that stays after a scan; added to that of a belief that is in doubt; and lost by a place
that a later search finds, beside those that are followed."""
FINE = 0.1  # residual at which a beam's agreement has fallen to a half, m, for hypotheses that have descended
POSITION, TURN = 0.15, 0.1  # standard deviations of a hypothesis, m and rad: the next scan descends from there
CLEAR, UNEXPLAINED, LITTLE = 0.95, 1.0 / 3.0, 0.15
"""Share of fitting beams that another place needs to replace the belief, and how much of what the belief leaves unexplained of
all scans since the search, or of these scans, it may leave unexplained: people on half of the beams hide the true place, and
some other fits all beams of a scan by chance."""
OBVIOUS = 0.25  # share of what the belief leaves unexplained below which another place takes over after one cycle
PER_METRE, ENOUGH, WELL, LEAD = 30.0, 100.0, 0.75, 6.0
"""Scans that a metre of way counts, since scans from one place are alike; and evidence after which a place is believed that
people hide in part, if this share of its beams agrees, and its logarithm of the weight leads all others by so much."""
LIKE = 0.05
"""Difference in agreement within which places are alike: if a search finds only such ones, as in a long corridor, the true
place may be none of them."""
ITSELF = 0.65  # share of agreeing beams that a belief in doubt needs to be confirmed
FAR = 1e4  # variance of an unknown pose, m^2 and rad^2
PROBATION, WORSE = 1000.0, 0.12
"""Evidence for which a place that is believed anew is on trial, and by how much fewer beams may fit then than usual: where a
place only looks alike, they end short of its walls sooner or later."""
OUTSIDE, UNUSUAL_FIT, AWAY = 150.0, 300.0, 1000.0
"""Evidence that another place needs if the belief has left the map, and if by so much fewer beams fit there; and evidence since
the belief left the map after which it does not hold another place back: the wheels have drifted."""


@kernel
def _search(located: Located, is_hypothesis: bool, bank: Any, sight: ScanPoints, wheels: Pose, since: int, gain: float) -> None:
    """Add to a bank the places of the whole map that fit a scan best, and first the belief if it still fits somehow."""
    poses, values = np.empty((MOST, 3)), np.zeros(MOST)
    mean, count = located.belief.mean, banks.seek(sight, poses, values)
    if since == 0:
        bank[:, LOG_WEIGHT] = NONE
    for k in range(count):
        weight = max(gain * (float(values[k]) - float(values[0])), UNLIKELY) - (LATE if since > 0 else 0.0)
        banks.insert(bank, pose_of(poses[k]), wheels, weight)
    bank[LAST, 2] = 1.0 if count == MOST and values[MOST - 1] > values[0] - LIKE else 0.0
    if is_hypothesis:
        bank[MOST, 0], bank[MOST, 1], bank[MOST, 2] = CLEAR, 0.0, 0.0
    if is_hypothesis and since == 0:
        bank[MOST, AGREES], bank[MOST, AGE] = 0.0, 0.0
        worth = agreement(sight, Guess(mean.x, mean.y, mean.theta, 0.0), WIDTH, float(bank[LAST, RIGHT]))
        bank[MOST, LOG_WEIGHT] = BONUS + gain * (worth - float(values[0]))


@kernel
def _evidence(bank: Any, wheels: Pose) -> float:
    """Return how much a scan says beside the one before, in scans: more if the robot has moved on."""
    dx, dy = wheels.x - float(bank[LAST, 0]), wheels.y - float(bank[LAST, 1])
    bank[LAST, 0], bank[LAST, 1] = wheels.x, wheels.y
    return 1.0 + PER_METRE * min(sqrt(dx * dx + dy * dy), 0.5)


@kernel
def _refine(
    located: Located, bank: Any, sight: ScanPoints, wheels: Pose, more: float, guesses: Any, values: Any, q: Any
) -> int:
    """Let the places of a bank descend at a scan, best first: pose, fits, what is explained, mean agreement, age, mean fits."""
    mean, count, gain = located.belief.mean, 0, gain_of(sight.number, q)
    for k in range(MOST):
        if bank[k, LOG_WEIGHT] > NONE:
            there, age = banks.place(bank, k, wheels), float(bank[k, AGE])
            near = locate(there, (POSITION * POSITION, POSITION * POSITION, TURN * TURN), q)
            end = descend(sight, near.belief, near.scale, Guess(there.x, there.y, there.theta, 0.0), (0.0, 0.0), q)
            at, explained = end.at, agreement(sight, end.at, FINE)
            dx, dy, theta = at.x - mean.x, at.y - mean.y, wrap(at.theta)
            is_own = dx * dx + dy * dy < APART * APART and abs(wrap(theta - mean.theta)) < TURNED
            if not (is_own and bank[MOST, LOG_WEIGHT] > NONE):
                agrees = banks.averaged(float(bank[k, AGREES]), age, descent.agreeing(sight, at, q))
                fits = banks.averaged(float(bank[k, FITS]), age, end.fits * sight.number / max(end.used, 1.0))
                guess = (at.x, at.y, theta, end.fits, explained, agrees, age + more, fits)
                value = FADING * float(bank[k, LOG_WEIGHT]) + gain * explained
                count = keep(guesses, values, count, guess, value, APART, TURNED)
    return count


@kernel
def _follow(located: Located, bank: Any, sight: ScanPoints, wheels: Pose, misfits: float, q: Any) -> Located:
    """Follow the hypotheses of a bank at a scan, on which the localizer is conditioned if its belief is one of them.

    ``misfits`` are those before this scan, see `Located.misfits`.
    """
    guesses, values, more = np.empty((MOST, 8)), np.empty(MOST), _evidence(bank, wheels)
    mean, own = located.belief.mean, float(bank[MOST, LOG_WEIGHT])
    count, has_own = _refine(located, bank, sight, wheels, more, guesses, values, q), own > NONE
    best, fits, agrees, age, usual = Pose(0.0, 0.0, 0.0), 0.0, 0.0, 0.0, 0.0
    other, unexplained = NONE, 1.0
    if count > 0:
        best, other, unexplained = pose_of(guesses[0]), float(values[0]), 1.0 - float(guesses[0, 4])
        fits, agrees, age, usual = float(guesses[0, 3]), float(guesses[0, 5]), float(guesses[0, 6]), float(guesses[0, 7])
    bank[LAST, OFF] += more if bank[LAST, OFF] > 0.0 else 0.0
    if has_own:
        at, own_age = Guess(mean.x, mean.y, mean.theta, located.scale.mean), float(bank[MOST, AGE])
        explained = agreement(sight, at, FINE, float(bank[LAST, RIGHT]))
        own = FADING * own + gain_of(sight.number, q) * explained
        bank[MOST, AGREES] = banks.averaged(float(bank[MOST, AGREES]), own_age, descent.agreeing(sight, at, q))
        bank[MOST, AGE] = own_age + more
        bank[MOST, 1] += 1.0 - explained
        bank[MOST, 2] += unexplained
        own = min(own, other - 2.0 * LEAD) if count > 0 and bank[LAST, OFF] > AWAY else own

    top, total, xx, yy, tt = max(other, own), 0.0, 0.0, 0.0, 0.0
    bank[:MOST, LOG_WEIGHT] = NONE
    for k in range(count):
        log_weight, pose = float(values[k]) - top, pose_of(guesses[k])
        if log_weight > UNLIKELY:
            weight, dx, dy, turn = banks.exp(log_weight), pose.x - best.x, pose.y - best.y, wrap(pose.theta - best.theta)
            total, xx, yy, tt = total + weight, xx + weight * dx * dx, yy + weight * dy * dy, tt + weight * turn * turn
            banks.put(bank, k, pose, wheels, log_weight, float(guesses[k, 5]), float(guesses[k, 6]))
            bank[k, FITS] = guesses[k, 7]
    own_weight = banks.exp(max(own - top, UNLIKELY)) if has_own else 0.0
    total = total + own_weight
    bank[MOST, LOG_WEIGHT] = max(own - top, UNLIKELY) if has_own else NONE
    weight = banks.exp(max(other - top, UNLIKELY)) / total if count > 0 else 0.0

    since, silent = int(misfits - q.patience), located.silent
    in_cycle, is_complete = since % PATIENCE, bank[LAST, 2] == 0.0  # the search found more than places that look alike
    lead = other - max(own, float(values[1]) if count > 1 else top + UNLIKELY)
    needs = OUTSIDE if bank[LAST, OFF] > 0.0 else q.evidence
    needs = UNUSUAL_FIT if count > 0 and usual < bank[TRIAL, 1] - WORSE else needs
    is_proven = count > 0 and agrees >= q.trust and age >= needs
    outlasts = is_proven and agrees > max(WELL, q.trust) and lead > LEAD and age >= (ENOUGH if is_complete else 1.5 * ENOUGH)
    decides = since >= CYCLE - 1
    if has_own:
        decides = since >= 3 * CYCLE - 1 and in_cycle >= 2 * CYCLE - 1
        decides = decides or (in_cycle >= CYCLE - 1 and bank[MOST, 2] < OBVIOUS * bank[MOST, 1])
    decides_other = decides and is_proven and is_complete and lead > q.lead
    fits_best = fits >= bank[MOST, 0]
    is_clear = fits_best and bank[MOST, 2] < max(UNEXPLAINED * bank[MOST, 1], LITTLE * (in_cycle + 1.0))
    takes_over = outlasts or (decides_other and own_weight < (1.0 - SURE) * total and is_clear)
    if has_own and not takes_over:
        decides = decides or (q.trust > 0.0 and since >= CYCLE - 1)
        is_sure = (decides and own_weight > SURE * total) or (in_cycle == PATIENCE - 1 and own >= other)
        is_sure = is_sure and bank[MOST, AGREES] > max(ITSELF, q.trust)
        misfits, weight, silent = (-CALM, 1.0, 0.0) if is_sure else (misfits + 1.0, own_weight / total, silent)
        return located._replace(misfits=misfits, weight=weight, silent=silent)

    bank[MOST, LOG_WEIGHT] = NONE
    is_sure = outlasts or (decides_other and weight > SURE and fits_best)
    if is_sure and q.trust > 0.0:
        bank[TRIAL, 0], bank[TRIAL, 1], bank[TRIAL, 2], bank[LAST, OFF] = PROBATION, usual, usual, 0.0
    share = 1.0 / total if total > 0.0 and not is_sure else 0.0
    around, turned = POSITION * POSITION, TURN * TURN + tt * share
    covariance = Covariance(around + xx * share, 0.0, 0.0, around + yy * share, 0.0, turned)
    belief = located.belief
    if count > 0:
        belief = Belief(State(best.x, best.y, best.theta, mean.v, mean.omega), covariance)
    fresh = Sixth(0.0, q.scale * q.scale, Pose(0.0, 0.0, 0.0))
    # A place that is only the likeliest is nothing to drive by: the robot is lost until it is sure.
    misfits, weight, silent = (-CALM, 1.0, 0.0) if is_sure else (misfits + 1.0, weight, max(silent, 2.0 * SILENT))
    agrees = descent.agreeing(sight, Guess(best.x, best.y, best.theta, 0.0), q) if count > 0 else 0.0
    located = located._replace(belief=belief, nis=0.0, scale=fresh, fits=fits, taken=0.0, slack=1.0, scans=located.scans + 1.0)
    return located._replace(misfits=misfits, weight=weight, agrees=agrees, silent=silent)


@kernel
def _kept(located: Located, after: Located, bank: Any, sight: ScanPoints, wheels: Pose, q: Any) -> Located:
    """Return a localizer after a scan, with its place from before if that was `RIGHT`, and no start explains the scan.

    It is lost if its place is on trial, and beams fit worse than they usually do.
    """
    mean, was_right = after.belief.mean, bank[LAST, RIGHT] > 0.0 and located.nis != 0.0  # 0 for a new belief
    is_right, fit, against, unknown, usual = after.agrees >= q.trust, after.fits, 0.0, 0.0, float(bank[TRIAL, 1])
    if not is_right or bank[TRIAL, 0] > 0.0:
        fit, against, unknown = descent.verdict(sight, Guess(mean.x, mean.y, mean.theta, after.scale.mean), q)
    bank[LAST, OFF] = 0.0 if is_right else bank[LAST, OFF]
    if was_right and not is_right and against <= max(descent.AGAINST, fit):
        is_right, bank[LAST, OFF] = True, max(bank[LAST, OFF], 1.0 if unknown > descent.SILENT_BEAMS else 0.0)
    if is_right and after.agrees < 0.7 * q.doubt:
        after = after._replace(belief=located.belief, scale=located.scale)
    bank[LAST, RIGHT] = 1.0 if is_right else 0.0
    if bank[TRIAL, 0] > 0.0 and located.misfits < q.patience:
        bank[TRIAL, 0] -= _evidence(bank, wheels)
        bank[TRIAL, 2] = banks.averaged(float(bank[TRIAL, 2]), banks.MEMORY, fit / max(1.0 - unknown, 1e-9))
        if bank[TRIAL, 2] < usual - WORSE:
            bank[TRIAL, 0], bank[LAST, RIGHT] = 0.0, 0.0
            after = after._replace(misfits=1.0 * q.patience, weight=0.0, agrees=0.0, silent=2.0 * SILENT)
    elif after.misfits <= 0.0 and after.agrees >= q.trust:
        bank[TRIAL, 1] = usual + (fit - usual) / min(after.scans, HABIT)
    return after


@kernel
def look(
    located: Located, bank: Any, sight: ScanPoints, wheels: Pose, q: Any, unseen: tuple[float, float] = (0.0, 0.0)
) -> Located:
    """Condition the belief on a scan; if the place is in doubt, also search the whole map, and follow the places found.

    The bank of hypotheses is written and read while the place is in doubt; ``wheels`` is the odometry at the present pose. For
    ``unseen`` see `localizer.scan`.
    """
    in_doubt, since = located.misfits >= q.patience, int(located.misfits - q.patience)
    if located.scans == 0.0:  # the bank may be that of another drive
        bank[LAST, RIGHT], bank[LAST, OFF], bank[TRIAL, 0], bank[TRIAL, 1] = 0.0, 0.0, 0.0, 0.0
    is_hypothesis = bank[MOST, LOG_WEIGHT] > NONE
    if since == 0:
        is_hypothesis = located.belief.covariance.xx < FAR and (located.agrees > 0.0 or bank[LAST, RIGHT] > 0.0)
    after = located
    if is_hypothesis or not in_doubt:
        after = scan(located, sight, q, unseen)
        after = _kept(located, after, bank, sight, wheels, q) if q.trust > 0.0 else after
    if not in_doubt or sight.number < LEAST_BEAMS:
        return after
    if since == 0:
        bank[MOST, 0] = 1.0 * q.doubt
    fits_badly = since % CYCLE == 0 and located.agrees < 0.7 * q.doubt
    if since % PATIENCE == 0 or (fits_badly and not is_hypothesis):
        _search(located, is_hypothesis, bank, sight, wheels, since, gain_of(sight.number, q))
    return _follow(after, bank, sight, wheels, located.misfits, q)


@kernel
def correct_by_scan(
    located: Located, ranges: Any, beams: Any, timing: Timing, memory: LocalizerMemory, q: LocalizerTuning
) -> Located:
    """Condition the belief on a scan as it was measured: on at most `beams` of its beams, with those of the next between them.

    Ranges, m, directions of beams in the robot's frame and timing are those of `points.to_points`; map, odometry and hypotheses
    are in the memory.
    """
    trail, points = memory.trail, np.empty((5, int(q.beams)))
    number = to_points(ranges, beams, int(located.scans), timing, trail, points)
    sight = ScanPoints(memory.field, memory.field_frame, points, number)
    return look(located, memory.bank, sight, pose_of(trail[0, 1:]), q, swept(timing, len(ranges), trail))


@kernel
def nowhere(q: Any) -> Located:
    """Return a localizer that does not know where it starts: the whole map is searched at the first scan."""
    lost = locate(Pose(0.0, 0.0, 0.0), (FAR, FAR, FAR), q)
    return lost._replace(fits=0.0, misfits=1.0 * q.patience, weight=0.0, agrees=0.0)
