"""Staggered environments begin at different times of an episode, and are otherwise the same."""

import gymnasium as gym
import numpy as np

from turtlebot_gym_agents.training.config import TrainingConfig
from turtlebot_gym_agents.training.model import make_model
from turtlebot_gym_agents.training.staggering import GROUPS, Staggered

ROWS = 2 * GROUPS


class Clocks(gym.vector.VectorEnv):
    """Observations are the number of steps since the row's reset."""

    def __init__(self):
        self.num_envs = ROWS
        self.single_observation_space = gym.spaces.Box(0.0, np.inf, (1,), np.float32)
        self.single_action_space = gym.spaces.Box(-1.0, 1.0, (1,), np.float32)
        self.clocks = np.zeros((ROWS, 1), np.float32)

    def reset(self, *, seed=None, options=None):
        self.clocks[(options or {}).get("reset_mask", np.ones(ROWS, np.bool_))] = 0.0
        return self.clocks.copy(), {}

    def step(self, actions):
        self.clocks += 1.0
        return self.clocks.copy(), np.zeros(ROWS), np.zeros(ROWS, np.bool_), np.zeros(ROWS, np.bool_), {}


def stand(observations):
    return np.zeros((ROWS, 1), np.float32)


def test_rows_begin_at_times_spread_over_the_steps_and_again_after_a_reset_of_all():
    envs = Staggered(Clocks(), stand, 10 * GROUPS + 3)
    for _ in range(2):
        observations, _ = envs.reset(seed=0)
        assert sorted(observations.ravel()) == sorted([10.0 * number for number in range(GROUPS)] * 2)
    np.testing.assert_array_equal(envs.step(stand(observations))[0], observations + 1.0)


def test_chosen_rows_begin_at_once():
    envs = Staggered(Clocks(), stand, 10 * GROUPS)
    before, _ = envs.reset(seed=0)
    chosen = np.arange(ROWS) < 5
    after, _ = envs.reset(options={"reset_mask": chosen})
    np.testing.assert_array_equal(after, np.where(chosen[:, None], 0.0, before))


def test_a_training_begins_all_along_the_square():
    config = TrainingConfig(env="square", config={"n_envs": 64, "n_timesteps": 64, "n_steps": 8, "batch_size": 64})
    envs = config.make_training()
    together, apart = envs.reset(seed=0)[0], make_model(config, envs).env.reset()
    assert apart[:, 0].std() > 2.0 * together[:, 0].std()  # the distance to the next corner
