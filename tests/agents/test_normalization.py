"""Scaling of observations, and domain randomization."""

import numpy as np
import pytest
import torch
from gymnasium import spaces

from turtlebot_gym import NOISES
from turtlebot_gym.systems import make_parameters
from turtlebot_gym_agents.training import randomization
from turtlebot_gym_agents.training.normalization import NormalizedObservation, _spread_ranges, measure
from turtlebot_gym_agents.training.randomization import randomized


class Still:
    """Environments whose observations are the number of the step."""

    num_envs = 500

    def __init__(self, size):
        self.size, self.actions = size, []

    def reset(self, *, seed):
        assert seed == 7
        return self._show(0.0), {}

    def step(self, actions):
        self.actions.append(actions)
        return self._show(float(len(self.actions))), None, None, None, {}

    def _show(self, number):
        return np.full((self.num_envs, self.size), number, np.float32)


def steady(observations):
    return np.full((len(observations), 2), 0.25, np.float32)


@pytest.mark.parametrize(("steps", "std"), [(4, np.std([1.0, 2.0, 3.0, 4.0])), (2, 0.5), (1, 1.0)])
def test_statistics_are_those_of_the_observations_after_each_step(steps, std):
    """What is constant keeps its scale."""
    assert measure(Still(13), steady, (0, 0), seed=7, steps=steps) == (
        pytest.approx([0.5 * (steps + 1)] * 13),
        pytest.approx([std] * 13),
    )


def test_ranges_are_spread_and_nothing_else():
    rows = torch.arange(50, dtype=torch.float32)[None] / 50.0
    spread = _spread_ranges(rows, (13, 49))
    assert torch.equal(spread[:, :13], rows[:, :13])
    assert torch.equal(spread[:, 49:], rows[:, 49:])
    np.testing.assert_allclose(spread[:, 13:49], np.log(rows[:, 13:49].numpy() + 0.03), rtol=1e-6)
    open_ground = torch.ones((2, 13))
    assert _spread_ranges(open_ground, (0, 0)) is open_ground
    space = spaces.Box(0.0, 1.0, (50,), np.float32)
    network = NormalizedObservation(space, mean=[0.5] * 50, std=[0.1] * 50, ranges=(13, 49))
    np.testing.assert_allclose(network(rows), np.clip((spread.numpy() - 0.5) / 0.1, -10.0, 10.0), rtol=0, atol=1e-5)


def test_environments_differ_by_the_stated_ranges(monkeypatch):
    base = make_parameters(noise="tutorial")
    assert {drawn.noise.odometry.R != base.noise.odometry.R for drawn in randomized(base, 40, seed=3)} == {True}
    monkeypatch.setattr(randomization, "PRESETS", ("tutorial",))
    drawn = randomized(base, 600, seed=3)
    size = np.array([np.array(p.noise.odometry.R) / NOISES["tutorial"].odometry.R for p in drawn])
    assert (size == size[:, :1]).all()  # one factor for all
    root = np.sqrt(size[:, 0])
    assert (root.min(), root.max()) == pytest.approx((0.5, 1.5), abs=0.02)
    assert root.mean() == pytest.approx(1.0, abs=0.05)
    scale = np.array([p.noise.process.scale for p in drawn])
    assert (scale.min(), scale.max()) == pytest.approx((0.98, 1.02), abs=0.001)
    assert scale.mean() == pytest.approx(1.0, abs=0.002)
    assert {(p.noise.process.turn_scale, p.noise.process.veer) for p in drawn} == {(1.0, 0.0)}
    wheels = [p.noise.process for p in randomized(base, 600, seed=3, turn_error=0.1, veer=0.05)]
    for name, middle, error in (("scale", 1.0, 0.02), ("turn_scale", 1.0, 0.1), ("veer", 0.0, 0.05)):
        values = [getattr(process, name) for process in wheels]
        assert (min(values), max(values)) == pytest.approx((middle - error, middle + error), abs=0.05 * error)
    assert {p.delay for p in drawn} == {0.0, 1.0}
    assert np.mean([p.delay for p in drawn]) == pytest.approx(0.5, abs=0.1)
    assert len({p.tuning for p in drawn}) > 590  # each filter is matched to its own noise
