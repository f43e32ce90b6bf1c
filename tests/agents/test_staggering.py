"""Staggered environments begin at different times of an episode, and are otherwise the same."""

import gymnasium as gym
import numpy as np
import pytest

from turtlebot_gym_agents.training.sb3_vec_env import GROUPS, Staggered

ROWS = 2 * GROUPS


class Clocks(gym.vector.VectorEnv):
    """Observations are the number of steps since the row's reset."""

    def __init__(self, rows):
        self.num_envs = rows
        self.single_observation_space = gym.spaces.Box(0.0, np.inf, (1,), np.float32)
        self.single_action_space = gym.spaces.Box(-1.0, 1.0, (1,), np.float32)
        self.clocks = np.zeros((rows, 1), np.float32)

    def reset(self, *, seed=None, options=None):
        self.clocks[(options or {}).get("reset_mask", np.ones(self.num_envs, np.bool_))] = 0.0
        return self.clocks.copy(), {}

    def step(self, actions):
        self.clocks += 1.0
        return self.clocks.copy(), np.zeros(len(actions)), *np.zeros((2, len(actions)), np.bool_), {}


def stand(observations):
    return np.zeros((len(observations), 1), np.float32)


@pytest.mark.parametrize(("rows", "times"), [(2 * GROUPS, 2 * [*range(GROUPS)]), (3, range(3)), (1, [0])])
def test_rows_begin_at_times_spread_over_the_steps_and_again_after_a_reset_of_all(rows, times):
    envs = Staggered(Clocks(rows), stand, 10 * min(GROUPS, rows))
    for _ in range(2):
        observations, _ = envs.reset(seed=0)
        assert sorted(observations.ravel()) == [10.0 * time for time in sorted(times)]
    np.testing.assert_array_equal(envs.step(stand(observations))[0], observations + 1.0)


def test_chosen_rows_begin_at_once():
    envs = Staggered(Clocks(ROWS), stand, 10 * GROUPS)
    before, _ = envs.reset(seed=0)
    chosen = np.arange(ROWS) < 5
    after, _ = envs.reset(options={"reset_mask": chosen})
    np.testing.assert_array_equal(after, np.where(chosen[:, None], 0.0, before))
