"""The episodes of an evaluation do not depend on how many rows drive them, and the last evaluation decides on all of them."""

from functools import partial

import numpy as np
import pytest
from stable_baselines3.common.logger import configure

from turtlebot_gym_agents.evaluation.driving import Judged, judge
from turtlebot_gym_agents.policies import make_policy
from turtlebot_gym_agents.training import callbacks
from turtlebot_gym_agents.training.callbacks import INTERIM, EvaluationCallback
from turtlebot_gym_agents.training.config import TrainingConfig
from turtlebot_gym_agents.training.model import make_model


@pytest.mark.parametrize(("env", "policy", "rows"), [("nav", "bearing", 7), ("rooms", "bearing", 5), ("nav", "bearing", 40)])
def test_few_rows_drive_the_episodes_that_a_row_for_each_drives(env, policy, rows):
    config, drive = TrainingConfig(env=env), partial(judge, policy=make_policy(policy), seed=11, episodes=23)
    alone, in_turn = drive(config.make(23)), drive(config.make(rows))
    for column, other in zip(alone, in_turn, strict=True):
        np.testing.assert_array_equal(column, other)
    assert len(set(alone.steps)) > 1


@pytest.mark.parametrize(("last", "kept"), [([1.0, 0.0], 1), ([3.0, 0.0], 2), ([1.0, 9.0], 2)])
def test_the_best_model_so_far_drives_all_episodes_at_the_end_if_the_last_one_is_not_better(tmp_path, monkeypatch, last, kept):
    """Mean returns of the first episodes and of all others: the first model has 2 and 0."""
    returns = {1: [2.0, 0.0], 2: last}
    config = TrainingConfig(config={"n_envs": 8, "n_steps": 8, "batch_size": 64, "n_timesteps": 64})
    model = make_model(config, config.make_training())
    model.set_logger(configure(format_strings=[]))

    def drive(envs, policy, *, seed, episodes):
        first, rest = returns[model.num_timesteps]
        values = np.where(np.arange(episodes) < INTERIM, first, rest)
        return Judged(values > 0.0, values, np.ones(episodes, np.int64))

    monkeypatch.setattr(callbacks, "judge", drive)
    evaluation = EvaluationCallback(config.make(8), every=1, episodes=2 * INTERIM, path=tmp_path / "best.zip")
    evaluation.init_callback(model)
    for steps, episodes in ((1, INTERIM), (2, 2 * INTERIM)):
        model.num_timesteps = steps
        evaluation._run(episodes)
    assert evaluation.best["steps"] == kept
    assert evaluation.best["return"] == pytest.approx(np.mean(returns[kept]))
