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

from turtlebot_gym.estimation.sixth import Sixth
from turtlebot_gym.kernel import kernel, sqrt
from turtlebot_gym.localization.bank import (
    AGE,
    AGREES,
    FITS,
    LAST,
    LOG_WEIGHT,
    MEMORY,
    MOST,
    NONE,
    OFF,
    RIGHT,
    ROWS,
    TRIAL,
    UNLIKELY,
    averaged,
    exp,
    insert,
    place,
    put,
)
from turtlebot_gym.localization.descent import APART, LEAST_BEAMS, TURNED, WIDTH, agreement, descend, gain_of, keep
from turtlebot_gym.localization.information import Guess, ScanPoints, fetch_ends
from turtlebot_gym.localization.localizer import CALM, HABIT, SILENT, SURE, Located, locate, scan
from turtlebot_gym.localization.passing import AGAINST, SILENT_BEAMS, agreeing, verdict
from turtlebot_gym.localization.points import Timing, swept, to_points
from turtlebot_gym.localization.seek import seek
from turtlebot_gym.models.angles import wrap
from turtlebot_gym.values import Belief, Covariance, Pose, State

CYCLE = 4
"""Scans from one search of the whole map, or decision, to the next."""
FADING = 0.95
"""Share of the logarithm of a weight that stays after a scan."""
FINE = 0.1
"""Residual at which a beam's agreement has fallen to a half, m, for hypotheses that have descended."""
POSITION, TURN = 0.15, 0.1
"""Standard deviations of a hypothesis, m and rad: the next scan descends from there."""
BONUS = 1.0
"""Added to the logarithm of the weight of a belief that is in doubt."""
CLEAR = 0.95
"""Share of fitting beams that another place needs to replace the belief ..."""
UNEXPLAINED = 1.0 / 3.0
"""... and how much of what it leaves unexplained of all scans since the search that place may leave unexplained: people on half
of the beams hide the true place, and some other fits all beams of a scan by chance ..."""
LITTLE = 0.15
"""... or that share of the scans: more than that remains unexplained where a place fits by chance."""
OBVIOUS = 0.25
"""Share of what the belief leaves unexplained below which another place takes over after one cycle."""
PATIENCE = 4 * CYCLE
"""Scans after which a belief that is in doubt is confirmed if it is the best hypothesis, or the whole map is searched anew."""
PER_METRE, ENOUGH = 30.0, 100.0
"""Scans that a metre of way counts, since scans from one place are alike, and evidence after which a place is believed that
people hide in part ..."""
WELL, LEAD = 0.75, 6.0
"""... if this share of its beams agrees, and its logarithm of the weight leads all others by so much."""
LIKE = 0.05
"""Difference in agreement within which places are alike: if a search finds only such ones, as in a long corridor, the true
place may be none of them."""
ITSELF = 0.65
"""Share of agreeing beams that a belief in doubt needs to be confirmed."""
FAR = 1e4
"""Variance of an unknown pose, m^2 and rad^2."""
PROBATION, WORSE = 1000.0, 0.12
"""Evidence for which a place that is believed anew is on trial, and by how much fewer beams may fit then than usual: where a
place only looks alike, they end short of its walls sooner or later."""
OUTSIDE, UNUSUAL_FIT = 150.0, 300.0
"""Evidence that another place needs if the belief has left the map, and if by so much fewer beams fit there."""
AWAY = 1000.0
"""Evidence since the belief left the map after which it does not hold another place back: the wheels have drifted."""
LATE = 3.0
"""Logarithm of the weight that a place loses that a later search finds, beside those that are followed."""


@kernel
def _search(located: Located, is_hypothesis: bool, bank: Any, sight: ScanPoints, wheels: Pose, since: int, q: Any) -> None:
    """Add to a bank the places of the whole map that fit a scan best, and first the belief if it still fits somehow."""
    poses, values = np.empty((MOST, 3)), np.zeros(MOST)
    mean, gain = located.belief.mean, gain_of(sight.number, q)
    count = seek(sight, poses, values)
    if since == 0:
        for k in range(ROWS):
            bank[k, LOG_WEIGHT] = NONE
    for k in range(count):
        weight = max(gain * (float(values[k]) - float(values[0])), UNLIKELY) - (LATE if since > 0 else 0.0)
        insert(bank, Pose(float(poses[k, 0]), float(poses[k, 1]), float(poses[k, 2])), wheels, weight)
    bank[LAST, 2] = 1.0 if count == MOST and values[MOST - 1] > values[0] - LIKE else 0.0
    if is_hypothesis:
        bank[MOST, 0], bank[MOST, 1], bank[MOST, 2] = CLEAR, 0.0, 0.0
    if is_hypothesis and since == 0:
        bank[MOST, AGREES], bank[MOST, AGE] = 0.0, 0.0
        worth = agreement(sight, Guess(mean.x, mean.y, mean.theta, 0.0), WIDTH, 0.0, float(bank[LAST, RIGHT]))
        bank[MOST, LOG_WEIGHT] = BONUS + gain * (worth - float(values[0]))


@kernel
def _outlasts(agrees: float, age: float, lead: float, is_complete: bool, q: Any) -> bool:
    """Return whether a place has explained so many scans so well that it is believed, though people hide a part of it.

    Args:
        agrees: Mean share of its agreeing beams.
        age: The evidence for it, in scans.
        lead: Difference of the logarithms of its weight and of that of the best other place.
        is_complete: Whether the last search found more than places that look alike; otherwise it takes half as much more.
    """
    return (agrees > max(WELL, q.trust)) & (lead > LEAD) & (age >= (ENOUGH if is_complete else 1.5 * ENOUGH))


@kernel
def _evidence(bank: Any, wheels: Pose) -> float:
    """Return how much a scan says beside the one before, in scans: more if the robot has moved on."""
    dx, dy = wheels.x - float(bank[LAST, 0]), wheels.y - float(bank[LAST, 1])
    bank[LAST, 0], bank[LAST, 1] = wheels.x, wheels.y
    return 1.0 + PER_METRE * min(sqrt(dx * dx + dy * dy), 0.5)


@kernel
def _follow(located: Located, bank: Any, sight: ScanPoints, wheels: Pose, misfits: float, q: Any) -> Located:
    """Follow the hypotheses of a bank at a scan, and return the localizer.

    Args:
        located: The localizer; conditioned on the scan if its belief is a hypothesis.
        bank: The bank.
        sight: The scan and the map.
        wheels: The odometry at the present pose.
        misfits: Doubtful scans before this one, see `Located.misfits`.
        q: A `LocalizerTuning`.
    """
    guesses, values, count, gain = np.empty((MOST, 8)), np.empty(MOST), 0, gain_of(sight.number, q)
    mean, own = located.belief.mean, float(bank[MOST, LOG_WEIGHT])
    more = _evidence(bank, wheels)
    for k in range(MOST):
        if bank[k, LOG_WEIGHT] > NONE:
            there, age = place(bank, k, wheels), float(bank[k, AGE])
            near = locate(there, (POSITION * POSITION, POSITION * POSITION, TURN * TURN), q)
            start = Guess(there.x, there.y, there.theta, 0.0)
            end = descend(sight, near.belief, near.scale, start, (0.0, 0.0), q)
            at = end.at
            explained = agreement(sight, at, FINE)
            value = FADING * float(bank[k, LOG_WEIGHT]) + gain * explained
            dx, dy, theta = at.x - mean.x, at.y - mean.y, wrap(at.theta)
            is_own = dx * dx + dy * dy < APART * APART and abs(wrap(theta - mean.theta)) < TURNED
            if not (is_own and own > NONE):
                agrees = averaged(float(bank[k, AGREES]), age, agreeing(sight, at, q))
                fits = averaged(float(bank[k, FITS]), age, end.fits * sight.number / max(end.used, 1.0))
                guess = (at.x, at.y, theta, end.fits, explained, agrees, age + more, fits)
                count = keep(guesses, values, count, guess, value, APART, TURNED)
    if own > NONE:
        at = Guess(mean.x, mean.y, mean.theta, located.scale.mean)
        explained = agreement(sight, at, FINE, 0.0, float(bank[LAST, RIGHT]))
        own = FADING * own + gain * explained
        age = float(bank[MOST, AGE])
        bank[MOST, AGREES] = averaged(float(bank[MOST, AGREES]), age, agreeing(sight, at, q))
        bank[MOST, AGE] = age + more
        bank[MOST, 1] += 1.0 - explained
        bank[MOST, 2] += 1.0 - (float(guesses[0, 4]) if count > 0 else 0.0)
    other = float(values[0]) if count > 0 else NONE
    bank[LAST, OFF] += more if bank[LAST, OFF] > 0.0 else 0.0
    if own > NONE and count > 0 and bank[LAST, OFF] > AWAY:
        own = min(own, other - 2.0 * LEAD)
    top, total, xx, yy, tt = max(other, own), 0.0, 0.0, 0.0, 0.0
    best = Pose(float(guesses[0, 0]), float(guesses[0, 1]), float(guesses[0, 2]))
    for k in range(MOST):
        log_weight = float(values[k]) - top if k < count else NONE
        bank[k, LOG_WEIGHT] = NONE
        if log_weight > UNLIKELY:
            pose = Pose(float(guesses[k, 0]), float(guesses[k, 1]), float(guesses[k, 2]))
            weight, dx, dy, turn = exp(log_weight), pose.x - best.x, pose.y - best.y, wrap(pose.theta - best.theta)
            total, xx, yy, tt = total + weight, xx + weight * dx * dx, yy + weight * dy * dy, tt + weight * turn * turn
            put(bank, k, pose, wheels, log_weight, float(guesses[k, 5]), float(guesses[k, 6]))
            bank[k, FITS] = guesses[k, 7]
    own_weight = exp(max(own - top, UNLIKELY)) if own > NONE else 0.0
    total = total + own_weight
    bank[MOST, LOG_WEIGHT] = max(own - top, UNLIKELY) if own > NONE else NONE
    weight = exp(max(other - top, UNLIKELY)) / total if count > 0 else 0.0
    fits = float(guesses[0, 3]) if count > 0 else 0.0
    since, least = int(misfits - q.patience), float(bank[MOST, 0])
    decides = since >= CYCLE - 1
    if own > NONE:
        decides = since >= 3 * CYCLE - 1 and since % PATIENCE >= 2 * CYCLE - 1
        decides = decides or (since % PATIENCE >= CYCLE - 1 and bank[MOST, 2] < OBVIOUS * bank[MOST, 1])
    lead = other - max(own, float(values[1]) if count > 1 else top + UNLIKELY)
    is_complete = bank[LAST, 2] == 0.0
    is_clear = fits >= least and bank[MOST, 2] < max(UNEXPLAINED * bank[MOST, 1], LITTLE * (since % PATIENCE + 1.0))
    silent = located.silent
    needs = OUTSIDE if bank[LAST, OFF] > 0.0 else q.evidence
    needs = UNUSUAL_FIT if count > 0 and guesses[0, 7] < bank[TRIAL, 1] - WORSE else needs
    is_proven = count > 0 and guesses[0, 5] >= q.trust and guesses[0, 6] >= needs
    decides_other = decides and is_proven and is_complete and lead > q.lead
    outlasts = is_proven and _outlasts(float(guesses[0, 5]), float(guesses[0, 6]), lead, is_complete, q)
    takes_over = outlasts or (decides_other and own_weight < (1.0 - SURE) * total and is_clear)
    if own > NONE and not takes_over:
        decides = decides or (q.trust > 0.0 and since >= CYCLE - 1)
        is_sure = (decides and own_weight > SURE * total) or (since % PATIENCE == PATIENCE - 1 and own >= other)
        is_sure = is_sure and bank[MOST, AGREES] > max(ITSELF, q.trust)
        misfits, weight, silent = (-CALM, 1.0, 0.0) if is_sure else (misfits + 1.0, own_weight / total, silent)
        return located._replace(misfits=misfits, weight=weight, silent=silent)
    bank[MOST, LOG_WEIGHT] = NONE
    is_sure = outlasts or (decides_other and weight > SURE and fits >= least)
    if is_sure and q.trust > 0.0:
        bank[TRIAL, 0], bank[TRIAL, 1], bank[TRIAL, 2], bank[LAST, OFF] = PROBATION, guesses[0, 7], guesses[0, 7], 0.0
    share = 1.0 / total if total > 0.0 and not is_sure else 0.0
    around, turned = POSITION * POSITION, TURN * TURN + tt * share
    covariance = Covariance(around + xx * share, 0.0, 0.0, around + yy * share, 0.0, turned)
    belief = located.belief
    if count > 0:
        belief = Belief(State(best.x, best.y, best.theta, mean.v, mean.omega), covariance)
    fresh = Sixth(0.0, q.scale * q.scale, Pose(0.0, 0.0, 0.0))
    # A place that is only the likeliest is nothing to drive by: the robot is lost until it is sure.
    misfits, weight, silent = (-CALM, 1.0, 0.0) if is_sure else (misfits + 1.0, weight, max(silent, 2.0 * SILENT))
    agrees = agreeing(sight, Guess(best.x, best.y, best.theta, 0.0), q) if count > 0 else 0.0
    return located._replace(
        belief=belief,
        nis=0.0,
        scale=fresh,
        fits=fits,
        misfits=misfits,
        taken=0.0,
        slack=1.0,
        scans=located.scans + 1.0,
        weight=weight,
        agrees=agrees,
        silent=silent,
    )


@kernel
def _kept(located: Located, after: Located, bank: Any, sight: ScanPoints, wheels: Pose, q: Any) -> Located:
    """Return a localizer after a scan, with its place from before if that was `RIGHT`, and no start explains the scan.

    It is lost if its place is on trial, and beams fit worse than they usually do.
    """
    belief, scale, misfits, weight, agrees, silent = (
        after.belief,
        after.scale,
        after.misfits,
        after.weight,
        after.agrees,
        after.silent,
    )
    was_right, usual = bank[LAST, RIGHT] > 0.0 and located.nis != 0.0, float(bank[TRIAL, 1])  # 0 for a new belief
    is_right, fit, against, unknown = agrees >= q.trust, after.fits, 0.0, 0.0
    if not is_right or bank[TRIAL, 0] > 0.0:
        fit, against, unknown = verdict(sight, Guess(belief.mean.x, belief.mean.y, belief.mean.theta, scale.mean), q)
    bank[LAST, OFF] = 0.0 if is_right else bank[LAST, OFF]
    if was_right and not is_right and against <= max(AGAINST, fit):
        is_right, bank[LAST, OFF] = True, max(bank[LAST, OFF], 1.0 if unknown > SILENT_BEAMS else 0.0)
    if is_right and agrees < 0.7 * q.doubt:
        belief, scale = located.belief, located.scale
    bank[LAST, RIGHT] = 1.0 if is_right else 0.0
    if bank[TRIAL, 0] > 0.0 and located.misfits < q.patience:
        bank[TRIAL, 0] -= _evidence(bank, wheels)
        bank[TRIAL, 2] = averaged(float(bank[TRIAL, 2]), MEMORY, fit / max(1.0 - unknown, 1e-9))
        if bank[TRIAL, 2] < usual - WORSE:
            misfits, weight, agrees, silent = 1.0 * q.patience, 0.0, 0.0, 2.0 * SILENT
            bank[TRIAL, 0], bank[LAST, RIGHT] = 0.0, 0.0
    elif misfits <= 0.0 and agrees >= q.trust:
        bank[TRIAL, 1] = usual + (fit - usual) / min(after.scans, HABIT)
    return after._replace(belief=belief, scale=scale, misfits=misfits, weight=weight, agrees=agrees, silent=silent)


@kernel
def look(
    located: Located, bank: Any, sight: ScanPoints, wheels: Pose, q: Any, unseen: tuple[float, float] = (0.0, 0.0)
) -> Located:
    """Condition the belief on a scan; if the place is in doubt, also search the whole map, and follow the places found.

    Args:
        located: The localizer.
        bank: Hypotheses, shape (`ROWS`, 4), written and read while the place is in doubt.
        sight: The scan, as seen from the present pose, and the map.
        wheels: The odometry at the present pose.
        q: A `LocalizerTuning`.
        unseen: Number of moves since the scan and during it, see `points.swept`.
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
        _search(located, is_hypothesis, bank, sight, wheels, since, q)
    return _follow(after, bank, sight, wheels, located.misfits, q)


@kernel
def correct_by_scan(
    located: Located, ranges: Any, beams: Any, timing: Timing, trail: Any, bank: Any, field: Any, frame: Any, q: Any
) -> Located:
    """Condition the belief on a scan as it was measured: on at most `beams` of its beams, with those of the next between them.

    Args:
        located: The localizer.
        ranges: Shape (B,), m; see `points.to_points`.
        beams: Directions in the robot's frame, shape (2 or more, B): cosine and sine.
        timing: When and where they were measured.
        trail: The odometry, see `points.remember`.
        bank: Hypotheses, see `look`.
        field: Distances, see `rooms.field`.
        frame: Their frame.
        q: A `LocalizerTuning`.
    """
    points = np.empty((5, int(q.beams)))
    number = to_points(ranges, beams, int(located.scans), timing, trail, points)
    sight, mean = ScanPoints(field, frame, points, number), located.belief.mean
    fetch_ends(sight, Guess(mean.x, mean.y, mean.theta, located.scale.mean))
    wheels = Pose(float(trail[0, 1]), float(trail[0, 2]), float(trail[0, 3]))
    return look(located, bank, sight, wheels, q, swept(timing, len(ranges), trail))


@kernel
def nowhere(q: Any) -> Located:
    """Return a localizer that does not know where it starts: the whole map is searched at the first scan."""
    lost = locate(Pose(0.0, 0.0, 0.0), (FAR, FAR, FAR), q)
    return lost._replace(fits=0.0, misfits=1.0 * q.patience, weight=0.0, agrees=0.0)
