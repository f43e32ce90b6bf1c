"""The gyro and the filter that reads it: against matrices, in any order with fixes, and the same everywhere."""

from __future__ import annotations

import math

import gymnasium as gym
import numpy as np
import pytest

from turtlebot_gym import Episode, Noise, OdometryNoise, Options, make_parameters
from turtlebot_gym.compiled.batch import Batch
from turtlebot_gym.estimation import ekf
from turtlebot_gym.estimation.filters import filter_of, jacobian, matrix
from turtlebot_gym.models.random import FIX, ROOM, SCAN, SENSOR
from turtlebot_gym.presets import make_filter
from turtlebot_gym.systems import imu, system_of
from turtlebot_gym.systems.fixes import fix_sensor
from turtlebot_gym.systems.imu import IMU, Imu, ImuNoise
from turtlebot_gym.tasks import SQUARE_WAYPOINTS
from turtlebot_gym.values import STOP, Command, Odometry, Pose, senses_of

DT = 0.1
NOISE = Noise(odometry=OdometryNoise(R=(0.03**2, 0.02**2, 0.05**2), dropout_probability=0.1))
GYRO = ImuNoise(variance=1e-4, bias_deviation=0.05, bias_walk=0.01)
SENSES = senses_of(("odometry", "imu"))


def wrap(angle):
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


def test_the_gyro_shares_its_random_numbers_with_nothing_else_in_an_episode():
    assert imu._USE not in (ROOM, SCAN, FIX, SENSOR)


def test_the_filter_is_the_textbooks_with_six_states():
    tuning, rng = make_filter("gyro", NOISE, imu=GYRO), np.random.default_rng(4)
    filter = filter_of(tuning)
    z = Pose(0.5, -0.3, 3.1)
    before = SENSES(Odometry(z, STOP, True), Imu(0.0, 0.0))
    estimate = filter.start(before, tuning)
    x, P = np.array([*z, 0.0, 0.0, 0.0]), np.diag([*tuning.R, 0.0, 0.0, 0.05**2])
    for k in range(60):
        command = Command(0.2, 0.8 * math.sin(0.1 * k))
        z = Pose(*(x[:3] + rng.normal(0.0, 0.05, 3)))
        senses = SENSES(Odometry(z, command, k % 5 != 2), Imu(command.omega + 0.04 + rng.normal(0.0, 0.01), math.nan))
        estimate = filter.step(estimate, before, senses, tuning, DT, 0.0)
        F = np.eye(6)
        F[:5, :5] = jacobian(ekf.State(*x[:5]), dt=DT)
        x = np.array([
            x[0] + DT * x[3] * math.cos(x[2]), x[1] + DT * x[3] * math.sin(x[2]), x[2] + DT * x[4], *command, x[5]
        ])  # fmt: skip
        P = F @ P @ F.T + np.diag([0.0, 0.0, 0.0, 0.005**2, 0.01**2, 0.01**2 * DT])
        measurements = [(np.array([[0.0, 0.0, 0.0, 0.0, 1.0, 1.0]]), np.array([senses.imu.omega]), np.array([[1e-4]]))]
        measurements += [(np.eye(3, 6), np.array(z), np.diag(tuning.R))] if senses.odometry.measured else []
        for H, measured, R in measurements:
            nu = measured - H @ x
            if len(nu) == 3:
                nu[2] = wrap(nu[2])
            K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
            x, P = x + K @ nu, P - K @ H @ P
        before = senses
        off = np.array([*estimate.belief.mean, estimate.bias.mean]) - x
        off[2] = wrap(off[2])
        np.testing.assert_allclose(off, 0.0, atol=1e-9)
        np.testing.assert_allclose(matrix(estimate.belief.covariance), P[:5, :5], atol=1e-12)
        np.testing.assert_allclose([*estimate.bias.column, estimate.bias.variance], P[5], atol=1e-12)
    assert estimate.bias.mean == pytest.approx(0.04, abs=4.0 * math.sqrt(estimate.bias.variance))


def test_a_fix_corrects_pose_and_bias():
    tuning = make_filter("gyro", NOISE, imu=GYRO)
    filter = filter_of(tuning)
    senses = SENSES(Odometry(Pose(0.0, 0.0, 0.0), Command(0.2, 0.3), False), Imu(0.35, 0.0))
    estimate = filter.start(senses, tuning)
    for _ in range(20):
        estimate = filter.step(estimate, senses, senses, tuning, DT, 0.0)
    fixed = filter.fix(estimate, Pose(*estimate.belief.mean[:2], estimate.belief.mean.theta - 0.1), (1.0, 1.0, 1e-6), tuning)
    assert fixed.belief.mean.theta == pytest.approx(estimate.belief.mean.theta - 0.1, abs=1e-3)
    assert fixed.bias.mean > estimate.bias.mean  # it turned less than measured
    assert fixed.nis == estimate.nis


def readings(noise, seeds=400, steps=50):
    """Return turning rates measured at rest, shape (seeds, steps + 1)."""
    p = make_parameters(imu=noise)
    rows = []
    for seed in range(seeds):
        episode = Episode(p, seed=seed)
        rows.append([episode.world.senses.imu.omega])
        for _ in range(steps):
            episode.step(STOP)
            rows[-1].append(episode.world.senses.imu.omega)
    return np.array(rows)


def test_readings_have_the_stated_noise_bias_and_drift():
    """Standard errors are 3.5 % for 400 seeds: 18 % is more than five of them, a false alarm in a million."""
    white = readings(ImuNoise(variance=0.04), seeds=40)
    assert white.std() == pytest.approx(0.2, rel=0.09)
    bias = readings(ImuNoise(bias_deviation=0.3), steps=3)
    assert np.ptp(bias, axis=1).max() == 0.0
    assert bias[:, 0].std() == pytest.approx(0.3, rel=0.18)
    walk = readings(ImuNoise(bias_walk=0.5), steps=40)
    assert (walk[:, 0] == 0.0).all()
    assert walk[:, 40].std() == pytest.approx(0.5 * math.sqrt(4.0), rel=0.18)
    assert walk[:, 10].std() == pytest.approx(0.5, rel=0.18)


def test_with_wheel_odometry_the_gyro_keeps_the_heading():
    """The wheels' heading drifts by slip of the turning rate, which the gyro measures; its bias was taken off before."""
    errors = {}
    for name, options in {
        "wheels": {},
        "gyro": {"filter": "gyro", "imu": ImuNoise(variance=1e-6, bias_deviation=1e-4)},
    }.items():
        p = make_parameters("square", noise="wheel", **options)
        off = []
        for seed in range(10):
            episode = Episode(p, SQUARE_WAYPOINTS, seed=seed)
            for k in range(200):
                episode.act((0.9, 0.4 * math.sin(0.05 * k)))
            off.append(wrap(episode.world.estimate.belief.mean.theta - episode.world.body.true_state.theta))
        errors[name] = np.sqrt(np.mean(np.square(off)))
    assert errors["gyro"] < 0.35 * errors["wheels"]


SETTINGS = {
    "alone": {"filter": "gyro", "imu": "calibrated"},
    "under fixes": {"filter": "gyro", "imu": "mpu9250", "fix": "late"},
    "beside a filter that does not read it": {"imu": "mpu9250", "fix": "beacons", "filter": "mixture"},
}


@pytest.mark.parametrize("name", SETTINGS)
def test_gyro_and_fixes_are_the_same_compiled_and_in_plain_python(name, in_step):
    parameters, waypoints, *_ = Options.of({"task": "square", "noise": "rough", **SETTINGS[name]}).setup()
    batch = Batch(35, parameters, waypoints)
    plain = {i: Episode(parameters, waypoints, seed=i) for i in (0, 33)}
    assert len(list(in_step(batch, plain, [0.2, -0.2], [1.2, 0.2], 40))) == 40


def test_the_order_in_which_sensors_are_added_changes_nothing():
    p = make_parameters(noise="rough", filter="gyro", imu="mpu9250", fix="localization")
    plain = system_of(p._replace(fix=(), imu=(), tuning=make_filter("matched", p.noise)))
    sensors = (IMU, fix_sensor(2))
    systems = [system_of(p)._replace(sensors=plain.sensors) for _ in range(2)]
    rows = []
    for system, order in zip(systems, (sensors, sensors[::-1]), strict=True):
        for sensor in order:
            system = system.with_sensor(sensor)
        episode = Episode(p, seed=2, system=system)
        for _ in range(60):
            episode.act((0.8, 0.3))
        rows.append((episode.world.estimate, dict(sorted(episode.world.senses._asdict().items()))))
    assert rows[0] == rows[1]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"imu": "mpu"}, r"imu must be one of 'mpu9250', 'calibrated', got 'mpu'"),
        ({"imu": {"variance": -1.0}}, r"ImuNoise\.variance must be"),
        ({"filter": "gyro"}, "filter 'gyro' reads the sensor 'imu': choose one with imu="),
        ({"filter": make_filter("gyro", NOISE, imu=GYRO)}, "The filter reads the sensor 'imu': choose one with imu="),
    ],
)
def test_an_unknown_gyro_is_refused(options, message):
    with pytest.raises(ValueError, match=message):
        gym.make("turtlebot_gym/TurtleBotNav-v0", **options)
