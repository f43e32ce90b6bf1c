"""The search for hyper-parameters: trials one by one, and in generations, whose results depend only on their size."""

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import optuna
import pytest
import yaml
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend
from optuna.trial import TrialState

pytest.importorskip("stable_baselines3", reason="needs the extra [agents]")

from turtlebot_gym_agents.cluster import search as module
from turtlebot_gym_agents.cluster.search import SPACES, _run_alone, _starting_point, _with_parameters, tune
from turtlebot_gym_agents.commands.cli import main
from turtlebot_gym_agents.training import hyperparameters
from turtlebot_gym_agents.training.config import TrainingConfig

ROOT = Path(__file__).parents[3]
# Drawn batches may be larger than these small rollouts.
pytestmark = [
    pytest.mark.filterwarnings("ignore:You have specified a mini-batch size"),
    pytest.mark.touched("agents/turtlebot_gym_agents/cluster", "tests/agents/cluster"),
]
TINY = {
    "n_envs": 32,
    "n_timesteps": 512,
    "policy": "MlpPolicy",
    "n_steps": 16,
    "batch_size": 512,
    "learning_rate": 0.001,
    "policy_kwargs": {"net_arch": [32, 32]},
}


config = TrainingConfig(steps=512, evaluations=1, episodes=8, config=TINY)


def test_a_hyper_parameter_that_is_given_is_not_searched(tmp_path, monkeypatch):
    given = replace(config, overrides={"learning_rate": 0.005, "policy_kwargs.net_arch": [8]})
    study = tune(given, tmp_path / "study", trials=1)
    assert not {"learning_rate", "policy_kwargs.net_arch"} & set(study.trials[0].params)
    best = hyperparameters.load("ppo", config.env, tmp_path / "study" / "best.yaml")
    assert (best["learning_rate"], best["policy_kwargs"]["net_arch"]) == (0.005, [8])
    monkeypatch.setitem(module.SPACES, "ppo", {"gamma": SPACES["ppo"]["gamma"]})
    with pytest.raises(ValueError, match="overrides leave nothing to search"):
        tune(replace(config, overrides={"gamma": 0.9}), tmp_path / "other")


def test_trials_do_not_end_early(tmp_path):
    with pytest.raises(ValueError, match="until ends a training"):
        tune(replace(config, until="success=1.0"), tmp_path / "study")


@pytest.mark.nightly
def test_a_search_continues_with_a_third_trial(tmp_path):
    falling, counts = replace(config, config=TINY | {"learning_rate": "lin_0.001"}), []
    study = tune(falling, tmp_path / "study", trials=2, progress=counts.append)
    assert counts == [0, 1, 2]
    first, second = study.trials
    # The first trial is what the search starts from; what the file does not give is drawn.
    assert first.params["learning_rate"] == 0.001
    assert first.params["policy_kwargs.net_arch"] == "[32, 32]"
    assert first.params != second.params
    assert len(first.intermediate_values) == len(first.user_attrs["history"]) == 1

    again = tune(falling, tmp_path / "study", trials=3)
    assert [trial.params for trial in again.trials[:2]] == [first.params, second.params]
    assert len(again.trials) == 3
    assert len(tune(falling, tmp_path / "study", trials=3).trials) == 3

    content = yaml.safe_load((tmp_path / "study" / "best.yaml").read_text())
    best = hyperparameters.load("ppo", config.env, tmp_path / "study" / "best.yaml")
    assert set(content) == {config.env}
    assert best == _with_parameters(falling, again.best_params).hyper
    assert best["learning_rate"] == f"lin_{again.best_params['learning_rate']:.6g}"
    with pytest.raises(ValueError, match="holds a study with another noise, 'tutorial', here it is 'rough'"):
        tune(replace(falling, noise="rough"), tmp_path / "study", trials=3)


def test_trials_that_fall_behind_are_pruned(tmp_path, monkeypatch):
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


class Imagined:
    """Runs trials without training: their value follows from their learning rate."""

    def __init__(self, *, backwards=False, limit=99):
        self.done, self._backwards, self._limit = 0, backwards, limit

    def __call__(self, jobs):
        for name, job in sorted(jobs.items(), reverse=self._backwards):
            if self.done == self._limit:
                raise KeyboardInterrupt
            self.done += 1
            rate = job.args[0].hyper["learning_rate"]
            value = -abs(rate - 0.003)
            pruned = rate > 0.009
            yield name, (None if pruned else value, TrialState.PRUNED if pruned else TrialState.COMPLETE, [{"return": value}])


def trials_of(study):
    finished = study.get_trials(states=module._FINISHED)
    return [(trial.number, trial.state.name, trial.value, trial.params) for trial in finished]


@pytest.mark.nightly
def test_a_search_depends_neither_on_the_order_of_results_nor_on_an_interruption(tmp_path):
    common = {"trials": 14, "generation": 4}
    expected = trials_of(tune(config, tmp_path / "one", **common, run=Imagined()))
    assert [number for number, *_ in expected] == list(range(14))
    assert expected[0][3]["learning_rate"] == 0.001  # where the search starts
    assert len({str(params) for *_, params in expected}) == 14
    assert trials_of(tune(config, tmp_path / "two", **common, run=Imagined(backwards=True))) == expected

    with pytest.raises(KeyboardInterrupt):
        tune(config, tmp_path / "three", **common, run=Imagined(limit=6))
    later = Imagined()
    tune(config, tmp_path / "three", trials=9, generation=4, run=later)
    study = tune(config, tmp_path / "three", **common, run=later)
    assert trials_of(study) == expected
    assert later.done == 14 - 6
    content = hyperparameters.load("ppo", config.env, tmp_path / "three" / "best.yaml")
    assert content["learning_rate"] == study.best_params["learning_rate"]


def test_an_interruption_while_trials_are_drawn_changes_nothing(tmp_path, monkeypatch):
    expected = trials_of(tune(config, tmp_path / "one", trials=4, generation=4, run=Imagined()))
    draw = module._draw

    def interrupted(study, *arguments):
        if len(study.trials) == 2:
            raise KeyboardInterrupt
        return draw(study, *arguments)

    monkeypatch.setattr(module, "_draw", interrupted)
    with pytest.raises(KeyboardInterrupt):
        tune(config, tmp_path / "two", trials=4, generation=4, run=Imagined())
    monkeypatch.setattr(module, "_draw", draw)
    assert trials_of(tune(config, tmp_path / "two", trials=4, generation=4, run=Imagined())) == expected


def test_generation_and_code_belong_to_the_study(tmp_path, monkeypatch):
    tune(config, tmp_path, trials=2, generation=2, run=Imagined())
    with pytest.raises(ValueError, match="holds a study with another generation, 2, here it is 4"):
        tune(config, tmp_path, trials=4, generation=4, run=Imagined())
    monkeypatch.setattr(module, "origin", lambda: {"code": "0"})
    with pytest.raises(ValueError, match=r"holds a study with another code, '.*', here it is '0'"):
        tune(config, tmp_path, trials=4, generation=2, run=Imagined())


def test_invalid_searches_are_refused(tmp_path):
    hyper = {name: TINY[name] for name in ("n_envs", "n_timesteps", "policy")}
    with pytest.raises(ValueError, match="algo must be one of 'ppo', 'sac', 'td3'"):
        tune(TrainingConfig(algo="ddpg", config=hyper), tmp_path / "study")
    for name in ("trials", "generation"):
        with pytest.raises(ValueError, match=f"{name} must be a whole number from 1"):
            tune(config, tmp_path / "study", **{name: 0})
    with pytest.raises(ValueError, match="storage must be a file or the URL of a database"):
        tune(config, tmp_path / "one", trials=1, storage="nothing://at/all")


def test_a_trial_of_a_generation_is_pruned_if_earlier_ones_were_better():
    longer = replace(config, evaluations=2, steps=1024)
    alone = _run_alone(longer, [])
    value, state, history = alone
    assert state == TrialState.COMPLETE
    assert value == history[-1]["return"]
    assert len(history) == 2
    better = optuna.trial.create_trial(value=99.0, intermediate_values={1: 99.0, 2: 99.0, 3: 99.0})
    assert _run_alone(longer, [better] * 5)[:2] == (None, TrialState.PRUNED)
    assert _run_alone(longer, [better] * 4) == alone  # too few to compare with


def test_processes_that_share_a_journal_draw_other_parameters(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "_run_trial", lambda trial, config: (config.hyper["learning_rate"], TrialState.COMPLETE))
    journal = str(tmp_path / "deep" / "study.journal")
    first = trials_of(tune(config, tmp_path / "one", trials=3, storage=journal))
    both = trials_of(tune(config, tmp_path / "two", trials=6, storage=journal))
    assert both[:3] == first
    assert len({str(params) for *_, params in both}) == 6
    assert (tmp_path / "two" / "best.yaml").is_file()
    assert trials_of(tune(config, tmp_path / "three", trials=6, storage=f"sqlite:///{tmp_path / 'other.db'}")) == both


def test_the_command_records_the_size_of_a_generation(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("turtlebot_gym_agents.cluster.workers.results", lambda jobs, **place: Imagined()(jobs))
    hyperparameters.save(tmp_path / "tiny.yaml", "default", TINY)
    arguments = ["--config", str(tmp_path / "tiny.yaml"), "--trials", "2", "--out", str(tmp_path)]
    arguments += ["--json", str(tmp_path / "out.json"), "--force"]
    assert main(["tune", *arguments, "--generation", "2"]) == 0
    content = json.loads((tmp_path / "out.json").read_text())
    assert content["config"]["generation"] == 2
    assert not {"json", "out.json", "cluster", "workers", "storage"} & set(content["config"])
    assert [trial["number"] for trial in content["trials"]] == [0, 1]
    assert main(["tune", *arguments, "--workers", "2"]) == 2
    assert "choose --cluster local" in capsys.readouterr().err


@pytest.mark.slow
def test_two_jobs_of_the_script_share_a_journal(tmp_path):
    """The job script, with the array's number faked: each job takes trials until the study has four of them."""
    path = f"{tmp_path}:{os.environ['PATH']}"
    command = tmp_path / "turtlebot-gym"
    command.write_text(f'#!/bin/sh\nexec {sys.executable} -m turtlebot_gym_agents "$@"\n')
    command.chmod(0o755)
    variables = {**os.environ, "PATH": path, "SHARED": str(tmp_path / "shared"), "TRIALS": "4", "STEPS": "512"}
    variables["TURTLEBOT_GYM_CACHE_DIR"] = os.environ.get("TURTLEBOT_GYM_CACHE_DIR", "")  # the package's own
    hyperparameters.save(tmp_path / "tiny.yaml", "default", TINY)
    script = ["bash", str(ROOT / "agents" / "configs" / "slurm.sh"), "--config", str(tmp_path / "tiny.yaml")]
    jobs = [subprocess.Popen(script, env={**variables, "SLURM_ARRAY_TASK_ID": str(job)}, cwd=tmp_path) for job in range(2)]
    assert [job.wait() for job in jobs] == [0, 0]
    storage = JournalStorage(JournalFileBackend(str(tmp_path / "shared" / "study.journal")))
    study = optuna.load_study(study_name="turtlebot-gym", storage=storage)
    finished = study.get_trials(states=module._FINISHED)
    assert 4 <= len(finished) <= 5  # both may have been at their last one
    assert len({str(trial.params) for trial in finished}) == len(finished)
    assert [(tmp_path / "shared" / f"job-{job}" / "best.yaml").is_file() for job in range(2)].count(True) >= 1
