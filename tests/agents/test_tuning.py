"""The search for hyper-parameters: two tiny trials, and going on with them."""

from dataclasses import replace

import optuna
import pytest
import yaml

from turtlebot_gym_agents.cluster.search import SPACES, _starting_point, _with_parameters, tune
from turtlebot_gym_agents.training import hyperparameters
from turtlebot_gym_agents.training.config import TrainingConfig

# Drawn batches may be larger than these small rollouts.
pytestmark = pytest.mark.filterwarnings("ignore:You have specified a mini-batch size")
TINY = {
    "n_envs": 32,
    "n_timesteps": 1024,
    "policy": "MlpPolicy",
    "n_steps": 16,
    "batch_size": 1024,
    "learning_rate": "lin_0.001",
    "policy_kwargs": {"net_arch": [32, 32], "log_std_init": -0.5},
}


config = TrainingConfig(steps=1024, evaluations=1, episodes=8, config=TINY)


def test_two_trials_and_a_third_later(tmp_path):
    counts = []
    study = tune(config, tmp_path / "study", trials=2, progress=counts.append)
    assert counts == [0, 1, 2]
    first, second = study.trials
    # The first trial is what the search starts from; what the file does not give is drawn.
    assert first.params["learning_rate"] == 0.001
    assert first.params["policy_kwargs.net_arch"] == "[32, 32]"
    assert first.params != second.params
    assert len(first.intermediate_values) == len(first.user_attrs["history"]) == 1

    again = tune(config, tmp_path / "study", trials=3)
    assert [trial.params for trial in again.trials[:2]] == [first.params, second.params]
    assert len(again.trials) == 3
    assert len(tune(config, tmp_path / "study", trials=3).trials) == 3

    content = yaml.safe_load((tmp_path / "study" / "best.yaml").read_text())
    best = hyperparameters.load("ppo", config.env, tmp_path / "study" / "best.yaml")
    assert set(content) == {config.env}
    assert best == _with_parameters(config, again.best_params).hyper
    assert best["learning_rate"] == f"lin_{again.best_params['learning_rate']:.6g}"
    with pytest.raises(ValueError, match="another configuration"):
        tune(replace(config, noise="rough"), tmp_path / "study", trials=3)


def test_trials_that_fall_behind_are_cut_short(tmp_path, monkeypatch):
    monkeypatch.setattr(optuna.Trial, "should_prune", lambda trial: trial.number == 1)
    study = tune(config, tmp_path / "study", trials=2)
    assert [trial.state.name for trial in study.trials] == ["COMPLETE", "PRUNED"]
    assert len(study.trials[1].user_attrs["history"]) == 1
    assert study.best_trial.number == 0


@pytest.mark.parametrize("algo", SPACES)
def test_the_shipped_hyperparameters_lie_in_the_search_space(algo):
    shipped = TrainingConfig(algo=algo)
    inside = _starting_point(SPACES[algo], shipped.hyper)
    assert {"learning_rate", "gamma", "batch_size", "policy_kwargs.net_arch"} <= set(inside)
    assert _with_parameters(shipped, inside).hyper == shipped.hyper


def test_refuses_what_it_cannot_search(tmp_path):
    hyper = {name: TINY[name] for name in ("n_envs", "n_timesteps", "policy")}
    with pytest.raises(ValueError, match="algo must be one of 'ppo', 'sac', 'td3'"):
        tune(TrainingConfig(algo="ddpg", config=hyper), tmp_path / "study")
    with pytest.raises(ValueError, match="trials must be a whole number from 1"):
        tune(config, tmp_path / "study", trials=0)
