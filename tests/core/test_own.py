"""Filters, terms and systems of one's own, by object or "module:name": in every environment, and refused with their place."""

import math

import gymnasium as gym
import numpy as np
import own_parts
import pytest

from turtlebot_gym import Episode, ObservationTerm, make_filter, make_noise, make_parameters
from turtlebot_gym.estimation.filters import matrix
from turtlebot_gym.kernel import kernel
from turtlebot_gym.systems import Options

NAV = "turtlebot_gym/TurtleBotNav-v0"


@pytest.mark.parametrize("options", [{}, {"fix": "late"}, {"noise": "wheel", "fix": "localization"}], ids=str)
def test_the_same_equations_as_a_class_give_the_same_estimates(options):
    mine = make_filter("matched", make_noise(options.get("noise", "tutorial")))
    episodes = [Episode(make_parameters(**options, filter=filter), seed=3) for filter in ("own_parts:Extended", mine)]
    for k in range(80):
        for episode in episodes:
            episode.act((0.8, 0.6 * math.sin(0.1 * k)))
        first, second = (episode.world.estimate.belief for episode in episodes)
        if options.get("noise") != "wheel":  # where dead reckoning follows the increments of the odometry
            np.testing.assert_allclose(first.mean, second.mean, atol=1e-9)
            np.testing.assert_allclose(matrix(first.covariance), matrix(second.covariance), atol=1e-10)
    assert math.dist(first.mean[:2], episodes[0].world.body.true_state[:2]) < 0.5


def test_environments_take_a_system_by_name():
    env = gym.make(NAV, system="own_parts:sledge", noise="clean")
    env.reset(seed=1)
    start = env.unwrapped.snapshot().body.true_state
    *_, info = env.step(np.array([0.0, 1.0], np.float32))
    assert info["true_state"][:2] == pytest.approx((start.x, start.y + 0.1 * 2.635))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"filter": "own_parts:Missing"}, "module 'own_parts' has no attribute 'Missing'"),
        ({"filter": "no_such_module:Filter"}, "No module named 'no_such_module'"),
        ({"filter": "own_parts:NUMBER"}, "filter must be a tuning, or what makes one, got 3"),
        ({"filter": "own_parts:Small"}, "own_parts:Small: x must hold 5 finite numbers"),
        ({"filter": "gyro"}, "filter 'gyro' reads the sensor 'imu'"),
        ({"dt": 1e-4, "fix": "late"}, "fix must come at most 25 steps late"),
        ({"waypoints": [(1.0, 0.0, 0.0)]}, "waypoints"),
        ({"reward": {"tim": 1.0}}, "reward .*'tim'.* Did you mean 'time'"),
        ({"system": "own_parts:NUMBER"}, "system must be a System, a function of the parameters that returns one, .* got 3"),
        (
            {"observation": ("ekf", ObservationTerm("hidden", kernel(lambda world, p: 0.0), -1.0, 1.0))},
            "the term 'hidden' must be at the top level of its module",
        ),
        ({"reward": {own_parts.SPIN: 1.0, own_parts.SPIN._replace(weight=3.0): 1.0}}, "a term 'spin' already"),
    ],
    ids=lambda value: next(iter(value)) if isinstance(value, dict) else value[:30],
)
def test_what_cannot_be_or_does_not_go_together_is_refused(options, message):
    with pytest.raises(ValueError, match=message):
        gym.make(NAV, **options)


SPEEDOMETER, SPIN = own_parts.SPEEDOMETER, own_parts.SPIN


def told(**options):
    """Return what an episode with some options tells in a few steps."""
    setup = Options(**options).setup()
    episode = Episode(setup.parameters, setup.waypoints, seed=3, system=setup.system)
    return [(episode.act((0.5, turn)).reward, *episode.observe()) for turn in (0.2, -0.5, 1.0)]


@pytest.mark.parametrize(
    ("given", "names"),
    [
        ({"observation": ("ekf", SPEEDOMETER)}, {"observation": "ekf,own_parts:SPEEDOMETER"}),
        ({"observation": ["goal", SPEEDOMETER.over(2)]}, {"observation": "goal,own_parts:SPEEDOMETER*2"}),
        ({"observation": SPEEDOMETER}, {"observation": "own_parts:SPEEDOMETER"}),
        ({"reward": {SPIN: 7.0, "effort": 0.2}}, {"reward": {"own_parts:SPIN": 7.0, "effort": 0.2}}),
    ],
)
def test_an_object_is_what_its_name_is(given, names):
    assert told(**given) == told(**names)
    assert told(**given) != told()
