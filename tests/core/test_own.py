"""Filters, rewards, terms and systems of one's own, by object or "module:name"; shares of rewards add up."""

import math

import gymnasium as gym
import numpy as np
import own_parts
import pytest

from turtlebot_gym import Episode, ObservationTerm, make_filter, make_noise, make_parameters
from turtlebot_gym.estimation.filters import matrix
from turtlebot_gym.kernel import kernel
from turtlebot_gym.rewards import IN_ROOMS, ON_GROUND, ON_MISSIONS
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
        ({"reward": {"nearness": 1.0}}, "reward on open ground .* must be one of .* got 'nearness'"),
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


# Rewards.

TASKS = {"Nav": ON_GROUND, "Square": ON_GROUND, "Rooms": IN_ROOMS, "Missions": ON_MISSIONS}


def rewards(task, **options):
    """Return rewards and their shares by name in a drive, which equal those of the first row of a vector environment."""
    id, rows = f"turtlebot_gym/TurtleBot{task}-v0", []
    env, envs = gym.make(id, **options), gym.make_vec(id, num_envs=3, info="full", **options)
    names = env.unwrapped.reward_terms
    assert envs.unwrapped.reward_terms == names
    for made in (env, envs):
        made.reset(seed=3)
    for action in np.random.default_rng(4).uniform(-1.0, 1.0, (40, 2)).astype(np.float32):
        _, reward, _, _, info = env.step(action)
        _, many, _, _, infos = envs.step(np.tile(action, (3, 1)))
        shares = np.array(info["reward_shares"]).tolist()
        assert (many[0], infos["reward_shares"][0].tolist()) == (reward, shares)
        rows.append((reward, dict(zip(names, shares, strict=True))))
    return rows


@pytest.mark.parametrize("task", TASKS)
def test_the_shares_add_up_to_the_reward_in_the_order_of_the_terms(task):
    for reward, shares in rewards(task):
        assert list(shares) == [term.name for term in TASKS[task]]
        total = 0.0
        for share in shares.values():
            total += share
        assert reward == total


@pytest.mark.parametrize("task", ["Nav", "Rooms"])
def test_a_term_of_ones_own_adds_its_share_and_nothing_else(task):
    spun = 0.0
    for (plain, _), (reward, shares) in zip(rewards(task), rewards(task, reward={SPIN: 100.0}), strict=True):
        assert reward == plain + shares["spin"]
        spun += shares["spin"]
    assert spun < -1.0


def test_a_system_of_ones_own_brings_its_terms():
    options = {"system": own_parts.system_with_spin, "reward": {"spin": 7.0}}
    setup = Options(**options).setup()
    assert setup.parameters.reward._asdict() == {"progress": 1.0, "time": 0.1, "effort": 0.01, "success": 10.0, "spin": 7.0}
    assert rewards("Nav", **options) == rewards("Nav", reward={"own_parts:SPIN": 7.0})
