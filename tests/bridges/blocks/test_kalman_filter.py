"""The estimator is the environment's filter, run by the odometry, drop-outs included."""

import pytest

from turtlebot_gym.estimation.ekf import initialize
from turtlebot_gym.presets import NOISES, make_filter
from turtlebot_gym.systems import Episode, make_parameters
from turtlebot_gym.tasks import NAV
from turtlebot_gym.values import STOP, Command, Pose, State
from turtlebot_gym_ros.blocks import KalmanFilter, TurtlebotSimulator

COMMAND = Command(0.15, 0.4)


def estimator(**parameters):
    return KalmanFilter(KalmanFilter.Params(**parameters))


def seen(odometry):
    return State(*odometry, 0.0, 0.0)


@pytest.mark.parametrize("noise", NOISES)
@pytest.mark.parametrize("filter", ["matched", "tutorial"])
def test_its_estimates_are_the_environments(noise, filter):
    """To the bit, also over drop-outs, where the node hears nothing and the environment predicts step by step."""
    plant = TurtlebotSimulator(TurtlebotSimulator.Params(noise=noise, seed=3, random_start=True))
    episode, node = Episode(make_parameters(NAV, noise=noise, filter=filter), seed=3), estimator(noise=noise, filter=filter)
    assert node.step(0.0, plant.step(0.1, None)["odometry"], None)["estimate"] == episode.world.estimate
    silent = 0
    for _ in range(300):
        episode.step(COMMAND)
        out = plant.step(0.1, COMMAND)
        silent += 1
        if "odometry" in out:
            assert node.step(round(silent * 0.1, 9), out["odometry"], COMMAND)["estimate"] == episode.world.estimate
            silent = 0


def test_it_needs_no_command_to_begin():
    node = estimator()
    first = node.step(0.0, State(1.0, 2.0, 3.0, 0.0, 0.0), None)["estimate"]
    assert first == initialize(Pose(1.0, 2.0, 3.0), make_filter("matched", NOISES["tutorial"]))
    second = node.step(0.1, State(1.0, 2.0, 3.0, 0.0, 0.0), None)["estimate"]
    assert second.belief.mean[:3] == pytest.approx((1.0, 2.0, 3.0))
    assert second.belief.mean[3:] == pytest.approx(STOP, abs=1e-12)


def test_a_reset_forgets_everything():
    node = estimator()
    node.step(0.0, State(1.0, 2.0, 3.0, 0.0, 0.0), None)
    node.step(0.1, State(1.0, 2.0, 3.0, 0.0, 0.0), COMMAND)
    node.reset()
    elsewhere = State(-1.0, 0.0, 0.5, 0.0, 0.0)
    assert node.step(0.0, elsewhere, COMMAND) == estimator().step(0.0, elsewhere, COMMAND)


def test_jitter_is_predicted_as_it_is():
    """A robot that drives straight is found where it is, whenever its odometry comes."""
    node = estimator(noise="clean")
    x, dt = 0.0, 0.0
    for dt in (0.0, 0.05, 0.048, 0.053, 0.05, 0.14, 0.26, 0.05):
        x += 0.15 * dt
        estimate = node.step(dt, State(x, 0.0, 0.0, 0.15, 0.0), Command(0.15, 0.0))["estimate"]
    assert estimate.belief.mean.x == pytest.approx(x, abs=2e-3)


def test_a_command_beyond_the_limits_is_believed_as_the_robot_executes_it():
    node = estimator(noise="clean")
    node.step(0.0, seen((0.0, 0.0, 0.0)), None)
    mean = node.step(0.1, seen((0.0, 0.0, 0.0)), Command(5.0, 0.0))["estimate"].belief.mean
    assert mean.v == pytest.approx(0.2097)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"filter": "kalman"}, "filter must be one of"),
        ({"noise": "none"}, "noise must be one of"),
        ({"robot": "turtle"}, "robot must be one of"),
        ({"period": 0.0}, "period and max_gap"),
        ({"max_gap": 0.05}, "period and max_gap"),
        ({"max_gap": float("nan")}, "period and max_gap"),
    ],
)
def test_wrong_parameters_are_refused(wrong, said):
    with pytest.raises(ValueError, match=said):
        estimator(**wrong)
