"""The gate of a filter: it refuses a measured pose that the belief cannot explain, but never for ever.

A refused pose leaves the belief as it was predicted. A spike, a leap or a flip does not last; after refusals for as long as
`parameters.Kalman.lockout` the belief is the one that is wrong, and the filter starts anew from the measured pose. A belief
that rests on a single measurement has no better claim than the next one, so there the first refusal is enough.

References:
    Bar-Shalom, Li, Kirubarajan, *Estimation with Applications to Tracking and Navigation* (2001), section 5.4: the normalized
    innovation squared and its chi-square test.
"""

from __future__ import annotations

from typing import NamedTuple

from turtlebot_gym.kernel import kernel
from turtlebot_gym.parameters import FilterTuning
from turtlebot_gym.values import Belief, Covariance, Pose

ONE_MEASUREMENT = -1.0
"""Number of refusals that stands for a belief which rests on one measurement."""


class Verdict(NamedTuple):
    """What becomes of a measured pose."""

    refused: bool
    """Whether it is refused."""
    lost: bool
    """Whether the filter starts anew from it; never without `refused`."""
    rejections: float
    """Number of measurements refused in a row, or `ONE_MEASUREMENT`."""


@kernel
def judge(rejections: float, measured: bool, is_outlier: bool, tuning: FilterTuning, dt: float) -> Verdict:
    """Return the verdict on a measurement.

    Args:
        rejections: Number of measurements refused in a row before it, or `ONE_MEASUREMENT`.
        measured: Whether there is a measurement; if not, nothing changes.
        is_outlier: Whether its normalized innovation squared exceeds the gate.
        tuning: Tuning of a kind with the numbers of `parameters.Kalman`.
        dt: Interval since the last step, s.
    """
    rules, count = tuning.kind, max(rejections, 0.0) + 1.0
    refused = measured & is_outlier
    enough = max(1.0 * rules.max_rejections, rules.lockout / dt - 1e-9)
    lost = refused & ((rejections < 0.0) | (count >= enough))
    after = count if refused else (0.0 if measured else rejections)
    return Verdict(refused, lost, ONE_MEASUREMENT if lost else after)


@kernel
def restart(prior: Belief, z: Pose, tuning: FilterTuning) -> Belief:
    """Replace the believed pose by the measured one; the twist stays as executed."""
    R, P = tuning.R, prior.covariance
    return Belief(prior.mean._replace(x=z.x, y=z.y, theta=z.theta), Covariance(R[0], 0.0, 0.0, R[1], 0.0, R[2], P.vv, P.ww))


@kernel
def choose(verdict: Verdict, measured: bool, prior: Belief, posterior: Belief, restarted: Belief) -> Belief:
    """Return the belief after a step: predicted, corrected, or anew."""
    refused = restarted if verdict.lost else prior
    return refused if verdict.refused else (posterior if measured else prior)
