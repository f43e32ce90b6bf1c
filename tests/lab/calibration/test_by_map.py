"""Wheels calibrated by a map: the truth is that of single scans, and not of the localizer, which moves with the wheels."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason="needs the extra [agents]")

from turtlebot_gym.kernel import HAS_LLVM
from turtlebot_gym.localization.tuning import matched
from turtlebot_gym.parameters import ProcessNoise
from turtlebot_gym.rooms.lidar import LIDARS
from turtlebot_gym_lab.calibration import calibrate
from turtlebot_gym_lab.evaluation.by_map import by_map, calibrate_by_map, corrected, nearest
from turtlebot_gym_lab.evaluation.localize import KnownPlace
from turtlebot_gym_lab.evaluation.tours import simulated_tour

pytestmark = pytest.mark.skipif(not HAS_LLVM, reason="takes minutes in plain Python")


@pytest.fixture(scope="module")
def tour():
    """A drive through an office with scans, its place in the map, and its wheels, which the localizer does not know."""
    random = np.random.default_rng([2, 1])
    alphas = {f"alpha{k}": float(np.exp(random.uniform(np.log(0.002), np.log(0.012)))) for k in range(1, 5)}
    scale, turn_scale, veer = random.uniform((0.95, 0.8, -0.1), (1.05, 1.2, 0.1)).tolist()
    wheels = ProcessNoise(**alphas, scale=scale, turn_scale=turn_scale, veer=veer)
    driven = simulated_tour("office", seed=2, wheels=wheels, generator=random)
    drive = replace(driven.drive, true_state=None)
    return drive, KnownPlace(driven.field, driven.frame, matched(LIDARS["lds01"]), driven.start), wheels


@pytest.mark.nightly
def test_intervals_hold_the_wheels_that_the_localizer_does_not_know(tour):
    drive, place, wheels = tour
    calibration = calibrate_by_map(drive, place)
    estimates = {name: calibration.estimates[name] for name in ("alpha2", "alpha4", "scale", "turn_scale", "veer", "marker_x")}
    for name, estimate in estimates.items():
        assert estimate.is_determined, name
        centre, half = 0.5 * (estimate.low + estimate.high), 0.5 * (estimate.high - estimate.low)
        assert abs(getattr(wheels, name, 0.0) - centre) < 2.0 * half, name  # 4 deviations: one drive in 3000 fails
    assert calibration.verdict.is_good
    assert estimates["veer"].high < 0.0  # it is the wheels that are found, not the usual ones
    assert estimates["scale"].high < 1.0


@pytest.mark.nightly
def test_the_localizers_belief_as_truth_follows_the_wheels_instead_of_judging_them(tour):
    drive, place, wheels = tour
    mapped = by_map(drive, place)
    belief = replace(drive, true_state=mapped.course.poses)
    naive = calibrate(belief, kind="wheel", delay=0.0, integrator="euler").estimates
    assert naive["veer"].low > 0.5 * wheels.veer
    assert naive["alpha2"].value < 0.6 * wheels.alpha2


def test_measured_poses_are_not_calibrated_by_a_map(tour):
    drive, place, _ = tour
    with pytest.raises(ValueError, match="only wheel odometry"):
        calibrate_by_map(drive, place, kind="pose")


def test_odometry_is_corrected_by_the_wheels_parameters():
    theta = np.linspace(0.0, 2.0, 41)
    circle = np.column_stack([np.sin(theta), 1.0 - np.cos(theta), theta])
    wheels = ProcessNoise(scale=1.1, turn_scale=0.5, veer=0.2)
    way, turn = 1.1 * 2.0, 1.1 * (0.5 * 2.0 + 0.2 * 2.0)
    end, radius = corrected(circle, wheels)[-1], way / turn
    np.testing.assert_allclose(end, [radius * np.sin(turn), radius * (1.0 - np.cos(turn)), turn], atol=0.03)
    np.testing.assert_allclose(corrected(circle, ProcessNoise()), circle, atol=1e-12)


def test_the_nearest_time():
    assert nearest(np.array([0.0, 1.0, 2.0]), np.array([-1.0, 0.4, 0.6, 1.9, 9.0])).tolist() == [0, 0, 1, 2, 2]
