"""The study of transfer: its measures on drives that were made up, and a page that says what its file says."""

import json
import math

import numpy as np
import pytest

from turtlebot_gym.values import Command, Odometry, Pose, Senses

pytest.importorskip("stable_baselines3", reason="needs the extra [agents]")
text = pytest.importorskip("transfer_text")
transfer = pytest.importorskip("transfer_filters")


def test_the_page_says_what_the_file_says():
    page = text.PAGE.read_text(encoding="utf-8")
    assert text.written(page, json.loads(text.RESULTS.read_text(encoding="utf-8"))) == page


def test_drift_is_the_error_after_each_metre():
    """A straight drive of 4.05 m of which wheels that are 2 % too large tell 2 % more, turned by 0.01 rad a metre."""
    truth = np.array([[0.05 * k, 1.0, 0.0, 0.5, 0.0] for k in range(82)])
    senses = [Senses(Odometry(Pose(0.05 * k * 1.02, 1.0, 0.01 * 0.05 * k), Command(0.5, 0.0), True)) for k in range(82)]
    drift = transfer.drift("made up", [transfer.Drive(truth, senses)] * 2)
    assert drift["metres"] == 8
    # Seen from a start at which odometry is turned by a = 0, 0.01, 0.02, 0.03 rad: (1.02 cos a - 1, -1.02 sin a).
    squares = [(1.02 * math.cos(a) - 1.0) ** 2 + (1.02 * math.sin(a)) ** 2 for a in (0.0, 0.01, 0.02, 0.03)]
    assert drift["position"].value == pytest.approx(math.sqrt(sum(squares) / 4.0), rel=1e-6)
    assert drift["heading"].value == pytest.approx(0.01, rel=1e-6)


def test_a_ratio_of_errors_is_of_the_same_drives():
    rng = np.random.default_rng(1)
    errors = rng.uniform(0.5, 1.5, 40)
    value, low, high = transfer.ratio(0.25 * errors, errors)
    assert (value, low, high) == pytest.approx((0.5, 0.5, 0.5))
    value, low, high = transfer.ratio(rng.uniform(0.5, 1.5, 40), errors)
    assert low < 1.0 < high


def test_a_filter_that_measures_the_truth_has_no_error():
    """A straight drive at 0.1 m/s, told without noise; an error of NEES 0 would mean a belief of no width."""
    truth = np.array([[0.01 * k, 1.0, 0.0, 0.1, 0.0] for k in range(40)])
    senses = [Senses(Odometry(Pose(0.01 * k, 1.0, 0.0), Command(0.1, 0.0), True)) for k in range(40)]
    for name, tuning in transfer.tunings("tutorial").items():
        errors, consistency = transfer.filtered([transfer.Drive(truth, senses)] * 2, tuning)
        assert errors.shape == (2, 40, 3), name
        assert consistency.shape == (2, 40), name
        assert np.abs(errors[:, -1]).max() < 0.01, name
        assert consistency[:, 1:].max() < 3.0, name
