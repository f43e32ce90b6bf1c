"""The bound on how good a filter can be: the textbook's equation, and what spikes cost."""

import numpy as np
import pytest
from scipy import integrate, stats
from test_textbook_filter import TUNINGS
from textbook import Textbook

from turtlebot_gym.parameters import OdometryNoise
from turtlebot_gym.presets import DOCUMENTED, TUTORIAL
from turtlebot_gym_lab.evaluation.bound import cramer_rao_bound, heading_information


@pytest.mark.parametrize(
    ("noise", "share", "accuracy"),
    [
        *((OdometryNoise(R=(0.0, 0.0, variance)), 1.0, 1e-10) for variance in (1e-8, 0.01, 4.0)),
        (OdometryNoise(R=(0.0, 0.0, 0.01), spike=0.3), 1.0, 1e-10),  # of spikes that never come
        (OdometryNoise(R=(0.0, 0.0, 0.01**2), spike_probability=0.1, spike=3.0), 1.0, 1e-9),  # told apart for certain
        (TUTORIAL.odometry, 0.982, 5e-4),
        (DOCUMENTED.odometry, 0.908, 5e-4),
    ],
)
def test_heading_information_is_one_over_the_variance_less_what_spikes_cost(noise, share, accuracy):
    assert heading_information(noise) * noise.R[2] == pytest.approx(share, abs=accuracy)


def test_heading_information_equals_the_integral():
    s, a, e = 0.05, 0.2, 0.1

    def integrand(x):
        parts = [(1.0 - e, 0.0), (0.5 * e, a), (0.5 * e, -a)]
        p = sum(w * stats.norm.pdf(x, m, s) for w, m in parts)
        return sum(w * stats.norm.pdf(x, m, s) * (m - x) / s**2 for w, m in parts) ** 2 / p

    expected, _ = integrate.quad(integrand, -0.7, 0.7, points=[-a, 0.0, a], epsabs=0.0, epsrel=1e-10)
    noise = OdometryNoise(R=(0.0, 0.0, s**2), spike_probability=e, spike=a)
    assert heading_information(noise) == pytest.approx(expected, rel=1e-8)
    assert 1.0 / (s**2 + e * a**2) < heading_information(noise) < 1.0 / s**2
    with pytest.raises(ValueError, match=r"OdometryNoise\.R must have a positive heading variance for this, got 0\.0\."):
        heading_information(OdometryNoise(R=(1.0, 1.0, 0.0)))


@pytest.mark.parametrize("options", [{}, {"dt": 0.1, "integrator": "euler"}, {"dt": 0.25, "integrator": "midpoint"}], ids=str)
def test_the_bound_is_the_textbooks_riccati_equation_along_the_truth(options):
    rng = np.random.default_rng(7)
    runs, steps, tuning = 3, 6, TUNINGS["process"]
    states = rng.uniform(-2.0, 2.0, (runs, steps + 1, 5))
    commands = rng.uniform(-1.0, 1.0, (runs, steps, 2))
    expected = np.zeros((steps + 1, 5, 5))
    for states_of_run, commands_of_run in zip(states, commands, strict=True):
        book = Textbook(np.zeros(5), np.diag([*tuning.R, 0.0, 0.0]), tuning, **options)
        expected[0] += book.P / runs
        for k in range(steps):
            book.x = states_of_run[k]
            book.predict(commands_of_run[k])
            book.x = states_of_run[k + 1]
            book.update(states_of_run[k + 1, :3])
            expected[k + 1] += book.P / runs
    np.testing.assert_allclose(cramer_rao_bound(states, commands, tuning, **options), expected, rtol=1e-9, atol=1e-12)
    alone = cramer_rao_bound(states[1], commands[1], tuning, **options)
    np.testing.assert_array_equal(alone, cramer_rao_bound(states[1:2], commands[1:2], tuning, **options))
    with pytest.raises(ValueError, match="integrator must be one of 'euler', 'midpoint', got 'rk4'"):
        cramer_rao_bound(states, commands, tuning, integrator="rk4")
