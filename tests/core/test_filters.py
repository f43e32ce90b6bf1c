"""The filter as an object: the same steps as the functions', and everything there to look at."""

from __future__ import annotations

import builtins
import math
from dataclasses import replace

import numpy as np
import pytest

from turtlebot_gym.estimation.filters import KalmanFilter, entries, filter_of, matrix, reference_filter
from turtlebot_gym.models.unicycle import INTEGRATORS
from turtlebot_gym.parameters import DeadReckoning, Kalman
from turtlebot_gym.presets import DOCUMENTED, ROUGH, TUTORIAL_FILTER, make_filter, matched
from turtlebot_gym.values import STOP, Command, Covariance, Odometry, Pose, Senses

TUNING = matched(DOCUMENTED)
GATED = replace(TUNING, kind=Kalman(gate=9.0, max_rejections=2))


KINDS = [make_filter(kind, ROUGH) for kind in ("gated", "mixture", "slip", "scale")]


def drive(seed, steps=300):
    """Draw commands and odometry; None for what drops out."""
    rng = np.random.default_rng(seed)
    for _ in range(steps):
        command = Command(*rng.uniform([-0.2, -1.0], [0.2, 1.0]).tolist())
        odometry = Pose(*rng.normal(0.0, [0.3, 0.3, 1.0]).tolist())
        yield command, odometry if rng.random() > 0.2 else None


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("tuning", [TUNING, GATED, TUTORIAL_FILTER, replace(TUNING, kind=DeadReckoning()), *KINDS])
def test_steps_are_those_of_the_function(tuning, integrator):
    kf = KalmanFilter(tuning, integrator=integrator, dt=0.05)
    before = Pose(0.3, 0.2, 0.1)
    kf.start(before)
    estimate = filter_of(tuning).start(Senses(Odometry(before, STOP, True)), tuning)
    for command, odometry in drive(0):
        kf.step(command, odometry)
        z = odometry or before
        senses = Senses(Odometry(before, command, True)), Senses(Odometry(z, command, odometry is not None))
        estimate = filter_of(tuning).step(estimate, *senses, tuning, 0.05, INTEGRATORS[integrator])
        before = z
        assert kf.belief == estimate.belief
        assert (kf.nis, kf.rejections) == (estimate.nis, getattr(estimate, "rejections", 0))
        assert kf.state.tolist() == list(estimate.belief.mean)
        np.testing.assert_array_equal(kf.covariance, matrix(estimate.belief.covariance))


def test_predict_and_update_make_a_step():
    halves, whole = (KalmanFilter(TUNING, state=(1.0, 2.0, 0.5, 0.1, 0.2)) for _ in range(2))
    assert np.isnan(halves.innovation).all()
    assert np.isnan(halves.innovation_covariance).all()
    for command, odometry in ((Command(0.1, 0.2), None), *drive(1)):  # the first is lost before anything was measured
        halves.predict(command)
        if odometry is not None:
            halves.update(odometry)
        whole.step(command, odometry)
        assert (halves.belief, halves.nis) == (whole.belief, whole.nis)
        np.testing.assert_array_equal(halves.innovation, whole.innovation)
        np.testing.assert_array_equal(halves.innovation_covariance, whole.innovation_covariance)


def test_refused_measurements_can_be_looked_at():
    kf = KalmanFilter(GATED, covariance=np.diag([1e-4] * 5))
    kf.step(Command(0.0, 0.0), Pose(3.0, 0.0, 0.0))
    assert kf.rejections == 1
    assert kf.nis > GATED.kind.gate
    assert kf.innovation.tolist() == [3.0, 0.0, 0.0]
    prior = KalmanFilter(GATED, covariance=np.diag([1e-4] * 5))
    prior.predict(Command(0.0, 0.0))
    assert kf.belief == prior.belief


def test_what_it_shows_is_a_copy():
    kf = KalmanFilter(TUNING)
    kf.step(Command(0.1, 0.1), Pose(0.1, 0.1, 0.1))
    for name in ("state", "covariance", "innovation", "innovation_covariance"):
        before = getattr(kf, name)
        getattr(kf, name)[...] = 99.0
        np.testing.assert_array_equal(getattr(kf, name), before)


def test_any_positive_semidefinite_covariance_will_do():
    rng = np.random.default_rng(4)
    for rank in range(6):
        root = rng.normal(size=(5, rank)) * 10.0 ** rng.uniform(-3.0, 1.0)
        P = root @ root.T
        kf = KalmanFilter(TUNING, covariance=P)
        np.testing.assert_allclose(kf.covariance, P)
        kf.step(Command(0.1, 0.5), Pose(0.1, 0.0, 0.0))
        assert np.isfinite(kf.covariance).all()


@pytest.mark.parametrize(
    ("covariance", "rule"),
    [
        (np.diag([1.0, 1.0, 1.0, 1.0, -1e-3]), "positive semidefinite"),
        (np.eye(5) + np.eye(5, k=1), "symmetric"),
        (np.eye(5) + 2.0 * (np.eye(5, k=1) + np.eye(5, k=-1)), "positive semidefinite"),
        (np.diag([1.0, math.nan, 1.0, 1.0, 1.0]), "finite"),
        (np.diag([1.0, math.inf, 1.0, 1.0, 1.0]), "finite"),
        (np.eye(4), "5 x 5"),
        (np.ones(5), "5 x 5"),
    ],
)
def test_other_covariances_are_refused(covariance, rule):
    with pytest.raises(ValueError, match=f"covariance must be .*{rule}"):
        KalmanFilter(TUNING, covariance=covariance)
    with pytest.raises(ValueError, match="P0 must be"):
        entries(covariance, name="P0")


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("dt", 0.0), ("dt", -0.1), ("dt", math.nan), ("dt", math.inf), ("integrator", "rk4"),
        ("state", (0.0, 0.0, math.nan, 0.0, 0.0)), ("state", (0.0, 0.0, 0.0)),
    ],
)  # fmt: skip
def test_bad_arguments_are_named(name, value):
    with pytest.raises(ValueError, match=name):
        KalmanFilter(TUNING, **{name: value})
    if name != "state":
        with pytest.raises(ValueError, match=name):
            reference_filter(TUNING, **{name: value})


def test_the_reference_says_what_to_install(monkeypatch):
    real = builtins.__import__

    def blocked(name, *args, **kwargs):
        if name.startswith("filterpy"):
            raise ImportError(name)
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", blocked)
    with pytest.raises(ImportError, match="pip install filterpy"):
        reference_filter(TUNING)


def test_a_covariance_lies_row_by_row():
    P = Covariance(*range(1, 16))
    full = [[1, 2, 3, 4, 5], [2, 6, 7, 8, 9], [3, 7, 10, 11, 12], [4, 8, 11, 13, 14], [5, 9, 12, 14, 15]]
    assert matrix(P).tolist() == full
    diagonal = np.diag([100.0] * 5) + np.array(full)
    assert entries(diagonal) == entries(diagonal.tolist()) == (101, 2, 3, 4, 5, 106, 7, 8, 9, 110, 11, 12, 113, 14, 115)
    assert Covariance._fields == (
        "xx", "xy", "xt", "xv", "xw", "yy", "yt", "yv", "yw", "tt", "tv", "tw", "vv", "vw", "ww",
    )  # fmt: skip


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_rounding_is_forgiven_and_no_more(scale):
    P = scale * np.eye(5)
    P[0, 1] = 5e-13 * scale
    entries(P)
    P[0, 1] = 2e-12 * scale
    with pytest.raises(ValueError, match="symmetric"):
        entries(P)
    singular = scale * np.ones((5, 5))
    singular[0, 1] = singular[1, 0] = (1.0 + 3e-13) * scale
    entries(singular)
    singular[0, 1] = singular[1, 0] = (1.0 + 3e-12) * scale
    with pytest.raises(ValueError, match="positive semidefinite, got one with the eigenvalue -"):
        entries(singular)
    for least in (-1e-300, -1e-13 * scale):
        with pytest.raises(ValueError, match="positive semidefinite"):
            entries(np.diag([scale, scale, scale, scale, least]))
