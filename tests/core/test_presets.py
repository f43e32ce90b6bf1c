"""The numbers of presets and defaults, and the tuning that is matched to a noise: every entry worked out by hand."""

from __future__ import annotations

import math
from dataclasses import asdict

import numpy as np
import pytest

from turtlebot_gym.parameters import (
    DeadReckoning,
    FilterTuning,
    Gated,
    Kalman,
    Noise,
    OdometryNoise,
    ProcessNoise,
    Reward,
    RoomReward,
    Scale,
)
from turtlebot_gym.presets import FIXES, NOISES, TUTORIAL_FILTER, make_filter, make_noise, make_robot, matched
from turtlebot_gym.robots import ROBOTS
from turtlebot_gym.systems import make_parameters

STILL = {
    "alpha1": 0.0,
    "alpha2": 0.0,
    "alpha3": 0.0,
    "alpha4": 0.0,
    "slip": 0.0,
    "slip_start": 0.0,
    "slip_end": 1.0,
    "scale": 1.0,
}
EXACT = {
    "R": (0.0, 0.0, 0.0),
    "bias": (0.0, 0.0, 0.0),
    "spike_probability": 0.0,
    "spike": 0.0,
    "dropout_probability": 0.0,
    "quantization": (0.0, 0.0),
    "wheel": False,
}
MODELS = {
    "clean": (STILL, EXACT),
    "tutorial": (STILL, EXACT | {"R": (0.05, 0.05, 0.1), "spike_probability": 0.02, "spike": 0.3}),
    # 5 cm, 5 cm and 0.1 rad, squared; 2 cm of bias
    "documented": (
        STILL,
        EXACT | {"R": (0.0025, 0.0025, 0.01), "bias": (0.02, 0.0, 0.0), "spike_probability": 0.02, "spike": 0.3},
    ),
    "wheel": (STILL | {"alpha1": 0.0029, "alpha2": 0.0064, "alpha3": 0.0062, "alpha4": 0.0049}, EXACT | {"wheel": True}),
    # 2 cm, 2 cm and 0.02 rad, squared
    "rough": (
        STILL | {"slip": 0.5, "slip_start": 0.01, "slip_end": 0.2},
        EXACT | {"R": (0.0004, 0.0004, 0.0004), "spike_probability": 0.02, "spike": 0.3, "dropout_probability": 0.05},
    ),
}


def test_each_noise_has_its_numbers():
    assert list(NOISES) == list(MODELS)
    for name, (process, odometry) in MODELS.items():
        for given, expected in ((NOISES[name].process, process), (NOISES[name].odometry, odometry)):
            assert set(asdict(given)) == set(expected)
            for field, number in asdict(given).items():
                assert number == pytest.approx(expected[field], rel=1e-12), (name, field)


def test_each_fix_has_its_numbers():
    # Period and delay, s; share that is lost.
    assert {name: (fix.period, fix.delay, fix.dropout_probability) for name, fix in FIXES.items()} == {
        "beacons": (0.5, 0.0, 0.0), "late": (0.5, 0.3, 0.3), "localization": (0.5, 0.2, 0.0), "markers": (0.2, 0.1, 0.5),
        "motion-capture": (0.1, 0.0, 0.0),
    }  # fmt: skip
    for name, R in {
        "beacons": (0.01, 0.01, math.inf), "late": (0.01, 0.01, math.inf), "localization": (0.0025,) * 3,
        "markers": (0.0009,) * 3, "motion-capture": (4e-6, 4e-6, 2.5e-5),
    }.items():  # fmt: skip
        assert pytest.approx(R, rel=1e-12) == FIXES[name].R, name


def test_the_defaults_are_no_noise():
    assert (asdict(ProcessNoise()), asdict(OdometryNoise())) == (STILL, EXACT)
    assert Noise() == Noise(process=ProcessNoise(), odometry=OdometryNoise())


def test_the_tutorials_filter_has_its_numbers():
    assert asdict(TUTORIAL_FILTER) | {"process": None} == {
        "Q": (0.01, 0.01, 0.02, 0.1, 0.1),
        "R": (0.05, 0.05, 0.1),
        "from_origin": True,
        "P0": (0.1, 0.1, 0.1, 1.0, 1.0),
        "process": None,
        "kind": {"remember_velocity": True, "wrap_innovation": False, "gate": math.inf, "max_rejections": 10},
    }
    assert asdict(TUTORIAL_FILTER.process) == STILL


# The matched filter. Floors: 5 mm/s and 0.01 rad/s for the twist, (1 mm)^2 and (1 mrad)^2 for the measurement.
# A spike of 0.3 rad in 2 % of the measurements adds 0.02 * 0.3^2 = 0.0018 rad^2.
# rough slips: of the time 0.01 / (0.01 + 0.2) = 1/21 is slip; from step to step the chain's correlation is 1 - 0.21 = 0.79. So
# 0.5^2 * 1/21 * 20/21 * 1.79 / 0.21 = 0.0966418 of the squared speed.
MATCHED_R = {
    "clean": (1e-6, 1e-6, 1e-6),
    "tutorial": (0.05, 0.05, 0.1018),
    "documented": (0.0025, 0.0025, 0.0118),
    "wheel": (1e-6, 1e-6, 1e-6),
    "rough": (0.0004, 0.0004, 0.0022),
}
MATCHED_ALPHAS = {
    "clean": (0.0, 0.0, 0.0, 0.0),
    "tutorial": (0.0, 0.0, 0.0, 0.0),
    "documented": (0.0, 0.0, 0.0, 0.0),
    "wheel": (0.0029, 0.0064, 0.0062, 0.0049),
    "rough": (0.09664183, 0.0, 0.0, 0.09664183),
}


def alphas(process):
    return process.alpha1, process.alpha2, process.alpha3, process.alpha4


@pytest.mark.parametrize("name", MODELS)
def test_the_matched_filter_has_its_numbers(name):
    tuning = matched(NOISES[name])
    assert list(tuning.Q) == pytest.approx([0.0, 0.0, 0.0, 2.5e-5, 1e-4], rel=1e-12)
    assert list(tuning.R) == pytest.approx(MATCHED_R[name], rel=1e-12)
    assert alphas(tuning.process) == pytest.approx(MATCHED_ALPHAS[name], rel=1e-7)
    assert tuning.process.slip == 0.0  # it is in the alphas: counted once
    assert tuning.kind == (DeadReckoning() if name == "wheel" else Kalman())
    assert not tuning.from_origin


def test_the_matched_filter_knows_nothing_of_a_speed_error():
    assert matched(Noise(process=ProcessNoise(scale=0.98))).process.scale == 1.0


def test_the_matched_filter_counts_quantization_as_a_uniform_error():
    # A step of 0.12 m: 0.12^2 / 12 = 0.0012 m^2. A step of 0.06 rad: 0.06^2 / 12 = 0.0003 rad^2. Spikes: 0.1 * 0.2^2 = 0.004.
    odometry = OdometryNoise(R=(0.01, 0.02, 0.03), quantization=(0.12, 0.06), spike_probability=0.1, spike=0.2)
    assert list(matched(Noise(odometry=odometry)).R) == pytest.approx([0.0112, 0.0212, 0.0343], rel=1e-12)
    # The oracle: what rounding does to numbers that are spread evenly.
    values = np.random.default_rng(0).uniform(-1.2, 1.2, 200_000)
    assert np.mean((np.round(values / 0.12) * 0.12 - values) ** 2) == pytest.approx(0.0012, rel=0.02)


def test_the_floor_holds_for_each_measurement_alone():
    noise = Noise(odometry=OdometryNoise(R=(0.04, 0.0, 2e-6)))
    assert list(matched(noise).R) == pytest.approx([0.04, 1e-6, 2e-6], rel=1e-12)


@pytest.mark.parametrize(
    ("slip", "start", "end", "expected"),
    [
        (0.5, 0.01, 0.2, 0.09664183),
        (0.2, 0.1, 0.3, 0.03),  # 0.04 * 1/4 * 3/4 * 1.6 / 0.4
        (1.0, 0.5, 0.5, 0.25),  # no memory: the variance of a coin
        (0.5, 0.3, 0.0, 0.0),  # it slips for ever: no variance
        (0.5, 0.0, 0.3, 0.0),  # it never slips
        (0.5, 0.0, 0.0, 0.0),  # it stays as it starts
    ],
)
def test_the_matched_filter_counts_slip_by_its_long_run_variance(slip, start, end, expected):
    process = ProcessNoise(alpha1=0.001, alpha2=0.002, alpha3=0.003, alpha4=0.004, slip=slip, slip_start=start, slip_end=end)
    assert alphas(matched(Noise(process=process)).process) == pytest.approx(
        (0.001 + expected, 0.002, 0.003, 0.004 + expected), rel=1e-6
    )
    if start > 0.0 and end > 0.0:
        # The oracle: all autocovariances of the two-state chain, added up.
        steps = np.array([[1.0 - start, start], [end, 1.0 - end]])
        stationary = np.array([end, start]) / (start + end)
        lost = np.array([0.0, slip])
        lags = [stationary * lost @ np.linalg.matrix_power(steps, k) @ lost - (stationary @ lost) ** 2 for k in range(400)]
        assert lags[0] + 2.0 * sum(lags[1:]) == pytest.approx(expected, rel=1e-6)


def test_names_and_values_make_the_same():
    assert make_robot("waffle") is make_robot(ROBOTS["waffle"]) is ROBOTS["waffle"]
    assert make_noise("rough") is make_noise(NOISES["rough"]) is NOISES["rough"]
    assert list(make_filter("matched", NOISES["documented"]).R) == pytest.approx([0.0025, 0.0025, 0.0118])
    assert make_filter("tutorial", NOISES["documented"]) is TUTORIAL_FILTER
    own = FilterTuning(Q=(0.1,) * 5, R=(0.2,) * 3)
    assert make_filter(own, NOISES["clean"]) is own
    p = make_parameters(robot=ROBOTS["waffle"], noise=NOISES["rough"], filter=own, dt=1)
    assert (p.robot, p.noise, p.tuning, p.dt) == (ROBOTS["waffle"], NOISES["rough"], own, 1.0)


def test_the_defaults_of_a_filter_and_of_the_reward():
    tuning = asdict(FilterTuning(Q=(0.1, 0.2, 0.3, 0.4, 0.5), R=(0.6, 0.7, 0.8)))
    assert tuning.pop("process") == asdict(ProcessNoise())
    assert tuning == {
        "Q": (0.1, 0.2, 0.3, 0.4, 0.5),
        "R": (0.6, 0.7, 0.8),
        "from_origin": False,
        "P0": (0.1, 0.1, 0.1, 1.0, 1.0),
        "kind": {"remember_velocity": False, "wrap_innovation": True, "gate": math.inf, "max_rejections": 10},
    }
    assert (Gated(heading_gate=6.0).max_rejections, Scale().scale_deviation) == (10, 0.05)
    weights = {"progress": 1.0, "time": 0.1, "effort": 0.01, "success": 10.0}
    assert asdict(Reward()) == weights
    assert asdict(RoomReward()) == weights | {"collision": 50.0, "nearness": 0.5, "near": 0.15}


def test_weights_for_rooms_are_refused_on_open_ground_and_completed_in_rooms():
    assert make_parameters("room", reward=Reward(time=0.3)).reward == RoomReward(time=0.3)
    assert make_parameters("room", reward={"collision": 9.0}).reward == RoomReward(collision=9.0)
    with pytest.raises(ValueError, match="reward must be a Reward on open ground"):
        make_parameters(reward=RoomReward())
    with pytest.raises(ValueError, match="reward: Reward has no collision"):
        make_parameters(reward={"collision": 9.0})
