"""Filters and systems of one's own, by object or "module:name": in every environment, and refused with their place."""

import math
import pickle

import gymnasium as gym
import numpy as np
import pytest

from turtlebot_gym import Episode, make_filter, make_noise, make_parameters
from turtlebot_gym.estimation import ekf
from turtlebot_gym.estimation.filters import matrix

NAV = "turtlebot_gym/TurtleBotNav-v0"
OWN = """
import numpy as np
from textbook import Textbook
from turtlebot_gym.kernel import kernel
from turtlebot_gym.systems import Body, system_of
from turtlebot_gym.values import State

class Extended(Textbook):
    '''The package's filter, written with matrices, and a state more that nothing touches.'''

    def __init__(self, tuning):
        super().__init__([0.0, 0.0, 0.0, 0.0, 0.0, 7.0], np.diag([*tuning.R, 0.0, 0.0, 0.5]), tuning)

    def predict(self, twist, dt):
        self.dt = dt
        super().predict(twist)

class Small(Extended):
    def __init__(self, tuning):
        self.x, self.P = [0.0], [[1.0]]

class Late(Extended):
    def update(self, z, R):
        return z[7]

@kernel
def slide(body, command, key, at, p):
    s = body.true_state
    truth = State(s.x + command.v * p.dt, s.y + command.omega * p.dt, s.theta, command.v, command.omega)
    return Body(truth, command, body.asked, body.wheels, False)

def sledge(p):
    return system_of(p)._replace(move=slide)

def broken(given):
    raise KeyError("nothing")

nothing = 3
"""


@pytest.fixture(autouse=True)
def module(tmp_path, monkeypatch):
    (tmp_path / "own.py").write_text(OWN)
    monkeypatch.syspath_prepend(tmp_path)


@pytest.mark.parametrize("options", [{}, {"fix": "late"}, {"noise": "wheel", "fix": "localization"}], ids=str)
def test_the_same_equations_as_a_class_give_the_same_estimates(options):
    mine = make_filter("matched", make_noise(options.get("noise", "tutorial")))
    episodes = [Episode(make_parameters(**options, filter=filter), seed=3) for filter in ("own:Extended", mine)]
    for k in range(80):
        for episode in episodes:
            episode.act((0.8, 0.6 * math.sin(0.1 * k)))
        one, other = (episode.world.estimate.belief for episode in episodes)
        if options.get("noise") != "wheel":  # where dead reckoning follows the increments of the odometry
            np.testing.assert_allclose(one.mean, other.mean, atol=1e-9)
            np.testing.assert_allclose(matrix(one.covariance), matrix(other.covariance), atol=1e-10)
    assert math.dist(one.mean[:2], episodes[0].world.body.true_state[:2]) < 0.5


def test_a_class_runs_in_scalar_and_vector_environments_alike():
    env, envs = gym.make(NAV, filter="own:Extended"), gym.make_vec(NAV, num_envs=2, info="full", filter="own:Extended")
    (observation, info), (observations, infos) = env.reset(seed=5), envs.reset(seed=5)
    error = 0.0
    for _ in range(40):
        np.testing.assert_array_equal(observation, observations[0])
        np.testing.assert_array_equal(info["estimate"], infos["estimate"][0])
        observation, *_, info = env.step(np.array([0.9, 0.1], np.float32))
        observations, *_, infos = envs.step(np.array([[0.9, 0.1], [0.1, 0.9]], np.float32))
        error = max(error, math.dist(info["estimate"][:2], info["true_state"][:2]))
    assert 0.0 < error < 0.6


def test_a_function_of_the_noise_may_return_any_tuning():
    noise = make_noise("rough")
    assert make_filter(lambda noise: make_filter("slip", noise), noise) == make_filter("slip", noise)
    assert isinstance(Episode(make_parameters(filter=lambda noise: make_filter("gated", noise))).world.estimate, ekf.Estimate)


def test_environments_take_a_system_by_name_and_pickle_with_it():
    env = gym.make(NAV, system="own:sledge", noise="clean")
    env.reset(seed=1)
    env = pickle.loads(pickle.dumps(env))
    start = env.unwrapped._batch.world(0).body.true_state
    *_, info = env.step(np.array([0.0, 1.0], np.float32))
    assert info["true_state"][:2] == pytest.approx((start.x, start.y + 0.1 * 2.635))
    episode = Episode(make_parameters(noise="clean"), seed=1, system="own:sledge")
    episode.act((0.0, 1.0))
    np.testing.assert_array_equal(info["true_state"], episode.world.body.true_state)


PLACE = r"own:broken: KeyError: 'nothing' \(.*own.py, line \d+\)"


@pytest.mark.parametrize(
    ("option", "name", "message"),
    [
        ("filter", "own:Missing", "module 'own' has no attribute 'Missing'"),
        ("filter", "no_such_module:Filter", "No module named 'no_such_module'"),
        ("filter", "own:nothing", "filter must be a tuning, or what makes one, got 3"),
        ("filter", "own:broken", PLACE),
        ("filter", "own:Small", r"own:Small: x must hold 5 numbers or more, .* got \(1,\) and \(1, 1\)"),
        ("filter", "own:Late", r"own:Late: IndexError: .* \(.*own.py, line \d+\)"),
        ("system", "own:missing", "has no attribute 'missing'"),
        ("system", "own:nothing", "system must be a System, a function of the parameters that returns one, .* got 3"),
        ("system", "own:broken", PLACE),
    ],
)
def test_what_is_no_filter_or_system_is_refused_on_one_line(option, name, message):
    with pytest.raises(ValueError, match=message):
        gym.make(NAV, **{option: name})
