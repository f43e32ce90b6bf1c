"""Filters that know of outliers, slip and scale: what they make of spikes, lost measurements and certainty.

Their algebra is in `test_textbook_filter`.
"""

import math
from dataclasses import replace

import numpy as np
import pytest

from turtlebot_gym import make_filter
from turtlebot_gym.estimation.filters import filter_of
from turtlebot_gym.estimation.mixture import exp_minus
from turtlebot_gym.parameters import Noise, OdometryNoise, ProcessNoise
from turtlebot_gym.values import STOP, Command, Odometry, Pose, Senses

NOISE = Noise(
    process=ProcessNoise(alpha1=0.02, alpha2=0.002, alpha3=0.05, alpha4=0.02, slip=0.4, slip_start=0.05, slip_end=0.2),
    odometry=OdometryNoise(R=(0.03**2, 0.02**2, 0.05**2), spike_probability=0.1, spike=0.4, dropout_probability=0.1),
)


def estimates(tuning, poses, *, twist=STOP, measured=True):
    """Return a filter's estimates at the first pose, and after a step to each of the others."""
    start, step, *_ = filter_of(tuning)
    log = [start(Senses(Odometry(poses[0], STOP, True)), tuning)]
    for pose in poses[1:]:
        senses = Senses(Odometry(pose, twist, measured))
        log.append(step(log[-1], senses, senses, tuning, 0.1, 0.0))
    return log


@pytest.mark.parametrize("kind", ["mixture", "slip"])
@pytest.mark.parametrize("spike", [0.4, -0.4])
@pytest.mark.parametrize("deviation", [0.05, 0.004])
def test_a_spike_in_the_first_measurement_is_found_out(kind, spike, deviation):
    """A filter that took the first heading for the true one would take all that follow for spikes.

    With the better sensor the wrong explanations are less likely than any number can say. The fifth measurement is another
    spike, which the right explanation alone can explain.
    """
    tuning = replace(make_filter(kind, NOISE), R=(0.03**2, 0.02**2, deviation**2))
    headings = [1.0 + spike, *[1.0] * 4, 1.0 - spike, *[1.0] * 5]
    first, *_, last = (one.belief for one in estimates(tuning, [Pose(0.0, 0.0, theta) for theta in headings]))
    assert first.mean.theta == pytest.approx(1.0 + spike)
    assert first.covariance.tt == pytest.approx(deviation**2 + 0.1 * 0.4**2)
    assert last.mean.theta == pytest.approx(1.0, abs=0.01)
    assert last.covariance.tt < 0.03**2


@pytest.mark.parametrize("kind", ["gated", "mixture", "slip", "scale"])
def test_what_is_lost_only_moves_the_belief(kind):
    poses = [Pose(0.0, 0.0, 0.0), *[Pose(5.0, 5.0, -1.0)] * 2]
    before, _, after = estimates(make_filter(kind, NOISE), poses, twist=Command(0.2, 0.1), measured=False)
    assert abs(after.belief.mean.x) < 0.03
    assert after.nis == 0.0
    assert after.belief.covariance.xx > before.belief.covariance.xx


@pytest.mark.parametrize("kind", ["mixture", "slip"])
def test_what_is_certain_stays_certain(kind):
    """Neither the measurement nor the motion has any noise: then nothing can be weighed, and nothing may break."""
    tuning = replace(make_filter(kind, NOISE), R=(0.0, 0.0, 0.0), Q=(0.0,) * 5, process=ProcessNoise())
    tuning = replace(tuning, kind=replace(tuning.kind, spike=0.0))
    belief = estimates(tuning, [Pose(0.1, 0.2, 0.3)] * 21)[-1].belief
    assert belief.mean == (0.1, 0.2, 0.3, 0.0, 0.0)
    assert max(map(abs, belief.covariance)) == 0.0


def test_exponentials_are_those_of_the_library():
    for q in np.concatenate([[0.0], np.geomspace(1e-300, 60.0, 4000)]).tolist():
        assert exp_minus(q) == pytest.approx(math.exp(-q), rel=3e-12, abs=0.0)
    assert exp_minus(1e9) == exp_minus(60.0)
