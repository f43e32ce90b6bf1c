"""Intervals, wrong models and kinds of odometry, by a simulator that shares no code: `benchmarks/calibration_intervals.py`."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from calibration_intervals import CERTAIN, RADIUS, SETTINGS, TRACK, simulated
from turtlebot_gym_lab.calibration import calibrate, detect_kind
from turtlebot_gym_lab.calibration.coordinates import value_of

pytestmark = pytest.mark.slow

ALPHAS = {"alpha1": 0.004, "alpha2": 0.003, "alpha3": 0.006, "alpha4": 0.005}
USUAL = {"left": RADIUS, "right": RADIUS, "track": TRACK, "drift": 0.0, **ALPHAS}
USUAL |= dict.fromkeys(("marker_x", "marker_y", "marker_theta"), 0.0)


@pytest.fixture(scope="module")
def fits():
    """Errors in half widths of their intervals, of a drive in each setting."""
    shares = []
    for at, (integrator, kind, truth) in enumerate(SETTINGS):
        drive, values = simulated(at % 4, integrator, kind, truth)
        fitted = calibrate(drive)
        assert (fitted.kind, fitted.verdict.is_good) == (kind, True)
        for name, estimate in fitted.estimates.items():
            off = values[name] - estimate.value
            if name != "dropout_probability" and abs(off) > CERTAIN:
                shares.append(off / ((estimate.high if off > 0.0 else estimate.low) - estimate.value))
    return np.array(shares)


@pytest.mark.parametrize(("factor", "holds"), [(1.0, True), (0.5, False)])
def test_intervals_hold_the_truth_in_95_of_100_cases_and_others_do_not(fits, factor, holds):
    # A correct interval fails this for one set of drives in 10^4; the seeds are fixed. Intervals half as wide fail it.
    low, high = stats.binom.interval(1.0 - 1e-4, len(fits), 0.95)
    assert (low <= (fits < factor).sum() <= high) == holds


@pytest.mark.parametrize("integrator", ["euler", "midpoint"])
def test_the_kind_is_found_with_either_integrator(integrator):
    for seed in range(12):
        for kind in ("pose", "wheel"):
            assert detect_kind(simulated(seed, integrator, kind, "noisy")[0]) == kind


def drawn(truth="noisy", seed=2, **given):
    return simulated(seed, "midpoint", "wheel", truth, rate=20, **USUAL | given)[0]


@pytest.mark.parametrize("truth", ["exact", "noisy"])
@pytest.mark.parametrize(
    ("given", "name", "value", "tolerance"),
    [
        ({"track": 1.1 * TRACK}, "turn_scale", 1.0 / 1.1, 0.02),
        ({"track": TRACK / 0.62}, "turn_scale", 0.62, 0.02),
        ({"drift": 0.02}, "drift", 0.02, 0.2),
        ({"marker_x": 0.05}, "marker_x", 0.05, 0.05),
    ],
    ids=["track", "turn", "drift", "marker"],
)
def test_a_robot_that_is_not_as_assumed_is_estimated_and_spoils_no_alpha(truth, given, name, value, tolerance):
    fitted = calibrate(drawn(truth, **given))
    assert fitted.estimates[name].value == pytest.approx(value, rel=tolerance)
    assert fitted.verdict.is_good
    are_not_spoiled(fitted)
    remarks = " ".join(fitted.remarks)
    assert ("gyro" in remarks) == (name == "drift")
    assert ("ahead" in remarks) == (name == "marker_x")


def are_not_spoiled(fitted):
    """Assert that each alpha is right to a factor of two, or undetermined, and then written no smaller than that."""
    determined = [alpha for alpha in ALPHAS if fitted.estimates[alpha].is_determined]
    assert len(determined) >= 3
    for alpha, true in ALPHAS.items():
        assert 0.5 * true < value_of(fitted.noise, alpha)
        assert value_of(fitted.noise, alpha) < 2.0 * true or alpha not in determined


@pytest.mark.parametrize("truth", ["exact", "noisy"])
def test_jumps_of_the_truth_are_left_out_and_reported(truth):
    drive, random = drawn(truth), np.random.default_rng(1)
    state, rows = drive.true_state.copy(), [130, 400, 401, 777, 1100]
    for row in rows:
        state[row:, :2] += random.normal(size=2)
    fitted = calibrate(replace(drive, true_state=state))
    assert "jumps 5 times" in " ".join(fitted.remarks)
    assert fitted.verdict.is_good
    are_not_spoiled(fitted)
