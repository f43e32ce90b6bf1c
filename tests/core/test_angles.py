"""Wrapping, and a sine and cosine of our own, over the whole range that occurs."""

import math

import numpy as np
import pytest

from turtlebot_gym.models import angles
from turtlebot_gym.models.angles import sincos, wrap

EDGES = [k * math.pi / 4.0 for k in range(-16, 17)]
NEAR = [math.nextafter(edge, side) for edge in EDGES for side in (-math.inf, math.inf)]
RANDOM = np.random.default_rng(0).uniform(-50.0, 50.0, 20_000).tolist()


@pytest.mark.parametrize("angles", [EDGES, NEAR, RANDOM], ids=["edges", "beside the edges", "random"])
def test_wrap_stays_in_its_interval_and_on_the_circle(angles):
    for angle in angles:
        wrapped = wrap(angle)
        assert -math.pi <= wrapped < math.pi
        assert math.remainder(wrap(wrapped) - wrapped, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-15)
        turns = (angle - wrapped) / (2.0 * math.pi)
        assert turns == pytest.approx(round(turns), abs=1e-14)


@pytest.mark.parametrize("reach", [math.pi / 4.0, math.pi, 50.0, 1e4, 99_999.0])
def test_sincos_is_accurate_and_at_the_edges_of_its_quadrants_within_1(reach):
    angles = [*np.random.default_rng(1).uniform(-reach, reach, 20_000).tolist(), *EDGES, *NEAR, 0.0, 5e-324, 1e-9]
    ours = np.array([sincos(angle) for angle in angles])
    np.testing.assert_allclose(ours, np.stack([np.sin(angles), np.cos(angles)], axis=1), rtol=0.0, atol=3e-16)
    assert np.abs(ours).max() <= 1.0


def test_sincos_is_odd_and_even():
    for angle in RANDOM[:2000]:
        if abs(abs(angle) * 2.0 / math.pi % 1.0 - 0.5) > 1e-9:  # on the border of two quadrants rounding may choose either
            assert sincos(-angle) == (-sincos(angle)[0], sincos(angle)[1])


def test_a_turn_is_360_degrees():
    assert (angles.PI, angles.TWO_PI) == (3.141592653589793, 6.283185307179586)
