"""Filters and systems of one's own, by object or "module:name": in every environment, and refused with their place."""

from __future__ import annotations

import math
import pickle

import gymnasium as gym
import numpy as np
import pytest

from turtlebot_gym import Episode, make_filter, make_noise, make_parameters
from turtlebot_gym.estimation import ekf
from turtlebot_gym.estimation.filters import jacobian, matrix
from turtlebot_gym.values import State

NAV = "turtlebot_gym/TurtleBotNav-v0"
OWN = """
import math
import pickle
import numpy as np
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

def wrap(angle):
    return (angle + math.pi) % (2.0 * math.pi) - math.pi

def move(x, dt):
    return np.array([x[0] + dt * x[3] * math.cos(x[2]), x[1] + dt * x[3] * math.sin(x[2]), x[2] + dt * x[4], 0.0, 0.0])

class Unscented:
    def __init__(self, tuning):
        points = MerweScaledSigmaPoints(5, alpha=0.5, beta=2.0, kappa=0.0)
        self.kf = UnscentedKalmanFilter(5, 3, 0.1, hx=lambda x: x[:3], fx=move, points=points)
        self.kf.Q = np.diag([1e-9, 1e-9, 1e-9, *tuning.Q[3:]])
        self.x, self.P = np.zeros(5), np.diag([*tuning.R, 1e-6, 1e-6])

    def predict(self, twist, dt):
        self.kf.x, self.kf.P = self.x, self.P
        self.kf.predict(dt)
        self.x, self.P = self.kf.x + [0.0, 0.0, 0.0, *twist], self.kf.P

    def update(self, z, R):
        seen = 3 if np.isfinite(R[2]) else 2
        P, nu = self.P, (z - self.x[:3])[:seen]
        nu[2:] = [wrap(a) for a in nu[2:]]
        K = P[:, :seen] @ np.linalg.inv(P[:seen, :seen] + np.diag(R[:seen]))
        self.x, self.P = self.x + K @ nu, P - K @ P[:seen]

def broken(noise):
    raise KeyError("nothing")

class Small:
    def __init__(self, tuning):
        self.x, self.P = [0.0], [[1.0]]
    def predict(self, twist, dt): pass
    def update(self, z, R): pass

class Late(Unscented):
    def update(self, z, R):
        return z[7]

nothing = 3
"""


@pytest.fixture
def own(tmp_path, monkeypatch):
    (tmp_path / "own_filters.py").write_text(OWN)
    monkeypatch.syspath_prepend(tmp_path)
    return "own_filters"


class Extended:
    """The package's filter, written with matrices, and a state more that nothing touches."""

    def __init__(self, tuning):
        self.Q, self.x, self.P = tuning.Q, np.array([0.0, 0.0, 0.0, 0.0, 0.0, 7.0]), np.diag([*tuning.R, 0.0, 0.0, 0.5])

    def predict(self, twist, dt):
        F = np.eye(6)
        F[:5, :5] = jacobian(State(*self.x[:5]), dt=dt)
        x, y, theta, v, omega, more = self.x
        self.x = np.array([x + dt * v * math.cos(theta), y + dt * v * math.sin(theta), theta + dt * omega, *twist, more])
        self.P = F @ self.P @ F.T + np.diag([*np.array(self.Q) * dt / 0.1, 0.0])

    def update(self, z, R):
        keep = np.isfinite(R)
        H, nu = np.eye(3, 6)[keep], z - self.x[:3]
        nu[2] = (nu[2] + math.pi) % (2.0 * math.pi) - math.pi
        K = self.P @ H.T @ np.linalg.inv(H @ self.P @ H.T + np.diag(R[keep]))
        self.x, self.P = self.x + K @ nu[keep], self.P - K @ H @ self.P


@pytest.mark.parametrize("options", [{}, {"fix": "late"}, {"noise": "wheel", "fix": "localization"}], ids=str)
def test_the_same_equations_as_a_class_give_the_same_estimates(options):
    mine = make_filter("matched", make_noise(options.get("noise", "tutorial")))
    episodes = [Episode(make_parameters(**options, filter=filter), seed=3) for filter in (Extended, mine)]
    for k in range(80):
        for episode in episodes:
            episode.act((0.8, 0.6 * math.sin(0.1 * k)))
        one, other = (episode.world.estimate.belief for episode in episodes)
        if options.get("noise") != "wheel":  # where dead reckoning follows the increments of the odometry
            np.testing.assert_allclose(one.mean, other.mean, atol=1e-9)
            np.testing.assert_allclose(matrix(one.covariance), matrix(other.covariance), atol=1e-10)
    assert math.dist(one.mean[:2], episodes[0].world.body.true_state[:2]) < 0.5


def test_a_class_runs_in_scalar_and_vector_environments_alike(own):
    env = gym.make(NAV, filter=f"{own}:Unscented")
    envs = gym.make_vec(NAV, num_envs=2, info="full", filter=f"{own}:Unscented")
    observation, info = env.reset(seed=5)
    observations, infos = envs.reset(seed=5)
    error = 0.0
    for _ in range(40):
        np.testing.assert_array_equal(observation, observations[0])
        np.testing.assert_array_equal(info["estimate"], infos["estimate"][0])
        observation, *_, info = env.step(np.array([0.9, 0.1], np.float32))
        observations, *_, infos = envs.step(np.array([[0.9, 0.1], [0.1, 0.9]], np.float32))
        error = max(error, math.dist(info["estimate"][:2], info["true_state"][:2]))
    assert 0.0 < error < 0.6
    env.close()
    envs.close()


def test_a_function_of_the_noise_may_return_any_tuning():
    noise = make_noise("rough")
    assert make_filter(lambda noise: make_filter("slip", noise), noise) == make_filter("slip", noise)
    assert isinstance(Episode(make_parameters(filter=lambda noise: make_filter("gated", noise))).world.estimate, ekf.Estimate)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("{}:Missing", "module 'own_filters' has no attribute 'Missing'"),
        ("no_such_module:Filter", "No module named 'no_such_module'"),
        ("{}:nothing", "filter must be a tuning, or what makes one, got 3"),
        ("{}:broken", r"own_filters:broken: KeyError: 'nothing' \(.*own_filters.py, line \d+\)"),
        ("{}:Small", r"own_filters:Small: x must hold 5 numbers or more, .* got \(1,\) and \(1, 1\)"),
        ("{}:Late", r"own_filters:Late: IndexError: .* \(.*own_filters.py, line \d+\)"),
    ],
)
def test_what_is_no_filter_is_refused_on_one_line(own, name, message):
    with pytest.raises(ValueError, match=message):
        gym.make(NAV, filter=name.format(own))


SYSTEM = """
from turtlebot_gym.kernel import kernel
from turtlebot_gym.systems import Body, system_of
from turtlebot_gym.values import State

@kernel
def slide(body, command, key, at, p):
    s = body.true_state
    truth = State(s.x + command.v * p.dt, s.y + command.omega * p.dt, s.theta, command.v, command.omega)
    return Body(truth, command, body.asked, body.wheels, False)

def sledge(p):
    return system_of(p)._replace(move=slide)

def broken(p):
    raise KeyError("nothing")

nothing = 3
"""


@pytest.fixture
def own_systems(tmp_path, monkeypatch):
    (tmp_path / "own_systems.py").write_text(SYSTEM)
    monkeypatch.syspath_prepend(tmp_path)
    return "own_systems"


def test_environments_take_a_system_by_name_and_pickle_with_it(own_systems):
    env = gym.make(NAV, system=f"{own_systems}:sledge", noise="clean")
    env.reset(seed=1)
    env = pickle.loads(pickle.dumps(env))
    start = env.unwrapped._batch.world(0).body.true_state
    *_, info = env.step(np.array([0.0, 1.0], np.float32))
    assert info["true_state"][:2] == pytest.approx((start.x, start.y + 0.1 * 2.635))
    p = make_parameters(noise="clean")
    episode = Episode(p, seed=1, system=f"{own_systems}:sledge")
    episode.act((0.0, 1.0))
    np.testing.assert_array_equal(info["true_state"], episode.world.body.true_state)
    env.close()


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("{}:missing", "has no attribute 'missing'"),
        ("{}:nothing", "system must be a System, a function of the parameters that returns one, .* got 3"),
        ("{}:broken", r"own_systems:broken: KeyError: 'nothing' \(.*own_systems.py, line \d+\)"),
    ],
)
def test_what_is_no_system_is_refused_on_one_line(own_systems, name, message):
    with pytest.raises(ValueError, match=message):
        gym.make(NAV, system=name.format(own_systems))
