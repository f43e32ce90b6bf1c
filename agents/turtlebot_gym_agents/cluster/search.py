"""Search for hyper-parameters with Optuna: resumable, with pruning of poor trials, one by one or in generations.

A study's folder holds ``study.db`` (Optuna's sqlite storage, unless another is named) and ``best.yaml``, the best
hyper-parameters so far in the form that training reads.

The trials of a generation are drawn together and run in parallel. Its draws and its pruned trials depend on earlier generations
only. So such a search depends on the size of a generation, but not on the number of workers, the order in which they finish, or
an interruption. One by one, several processes can share a study, and a trial depends on what is finished when it begins.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from copy import deepcopy
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import optuna
from optuna.distributions import BaseDistribution, CategoricalDistribution, FloatDistribution
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend
from optuna.trial import FrozenTrial, TrialState
from sqlalchemy.exc import SQLAlchemyError

from turtlebot_gym.config import as_int, choose
from turtlebot_gym_agents.cluster.ledger import difference, origin
from turtlebot_gym_agents.cluster.trainings import settings_of
from turtlebot_gym_agents.cluster.workers import Run, results
from turtlebot_gym_agents.provenance import plain
from turtlebot_gym_agents.training import hyperparameters
from turtlebot_gym_agents.training.callbacks import EvaluationCallback
from turtlebot_gym_agents.training.config import TrainingConfig
from turtlebot_gym_agents.training.train import learn

_NETWORK: dict[str, BaseDistribution] = {
    "policy_kwargs.net_arch": CategoricalDistribution(("[32, 32]", "[64, 64]", "[128, 128]")),
    "policy_kwargs.activation_fn": CategoricalDistribution(("ReLU", "Tanh")),
}
_COMMON: dict[str, BaseDistribution] = {
    "learning_rate": FloatDistribution(1e-4, 3e-2, log=True),
    "gamma": CategoricalDistribution((0.95, 0.97, 0.98, 0.99, 0.995)),
}
_OFF_POLICY: dict[str, BaseDistribution] = {
    "batch_size": CategoricalDistribution((128, 256, 512)),
    "gradient_steps": CategoricalDistribution((2, 4, 8, 16)),
    "tau": FloatDistribution(1e-3, 5e-2, log=True),
}
SPACES: dict[str, dict[str, BaseDistribution]] = {
    "ppo": {
        **_COMMON,
        **_NETWORK,
        "n_steps": CategoricalDistribution((8, 16, 32, 64, 128)),
        "batch_size": CategoricalDistribution((1024, 2048, 4096)),
        "n_epochs": CategoricalDistribution((1, 2, 4, 8)),
        "gae_lambda": CategoricalDistribution((0.9, 0.95, 0.98)),
        "ent_coef": FloatDistribution(0.0, 0.01),
        "policy_kwargs.log_std_init": FloatDistribution(-2.0, 0.0),
    },
    "sac": {**_COMMON, **_NETWORK, **_OFF_POLICY},
    "td3": {**_COMMON, **_NETWORK, **_OFF_POLICY, "noise_std": FloatDistribution(0.05, 0.5)},
}
"""Search space of each algorithm: names of hyper-parameters, with a dot if nested, and their ranges."""
_PRUNER = optuna.pruners.MedianPruner(n_startup_trials=5, n_warmup_steps=1)
_FINISHED = (TrialState.COMPLETE, TrialState.PRUNED)


def tune(
    config: TrainingConfig,
    folder: Path,
    *,
    trials: int = 50,
    generation: int | None = None,
    storage: str | None = None,
    run: Run = results,
    progress: Callable[[int], None] = lambda ended: None,
) -> optuna.Study:
    """Search for the hyper-parameters with which the last evaluation's mean return is highest.

    All trials have the same seed and budget. The first one has the initial hyper-parameters as far as they are in the search
    space. All others keep their initial values, and so do those that the configuration overrides.

    Args:
        config: Configuration of the training; its ``steps`` are those of each trial.
        folder: Study folder; an existing study is resumed.
        trials: Total number of finished trials, including earlier ones and those of other processes.
        generation: Number of trials drawn together, which belongs to the study; None to draw and run them one by one.
        storage: URL of a database for SQLAlchemy, or a file (Optuna's journal), which may be on a network file system; None for
            ``study.db`` in the folder.
        run: Runs the trials of a generation.
        progress: Called with the number of finished trials.

    Returns:
        The study; the folder holds the best hyper-parameters.

    Raises:
        ValueError: If there is no search space for the algorithm, a number is out of its range, the folder holds a study of
            another configuration or other code, or the storage cannot be used.
    """
    space = {name: values for name, values in choose("algo", config.algo, SPACES).items() if name not in config.overrides}
    if not space:
        raise ValueError("overrides leave nothing to search: leave out one of them.")
    if config.until is not None:
        raise ValueError("until ends a training, and trials are compared after equal steps: leave it out.")
    for name, number in (("trials", trials), ("generation", 1 if generation is None else generation)):
        as_int(name, number, 1, 1_000_000)
    study = _open_study(folder, storage, config, space, generation)
    while (finished := len(study.get_trials(states=_FINISHED))) < trials:
        progress(finished)
        if generation is None:
            trial = _draw(study, config, space)
            study.tell(trial, *_run_trial(trial, _with_parameters(config, trial.params)))
        else:
            drawn = _draw_generation(study, config, space, generation)
            before = [trial for trial in study.trials if trial.number < drawn[0].number // generation * generation]
            jobs = {
                f"trial {trial.number}": partial(_run_alone, _with_parameters(config, trial.params), before)
                for trial in drawn
                if trial.number < trials
            }
            for name, (value, state, history) in run(jobs):
                trial = next(trial for trial in drawn if name == f"trial {trial.number}")
                _report(trial, history)
                study.tell(trial, value, state)
                progress(finished := finished + 1)
        if study.get_trials(deepcopy=False, states=(TrialState.COMPLETE,)):
            hyperparameters.save(folder / "best.yaml", config.env, _with_parameters(config, study.best_params).hyper)
    progress(finished)
    return study


def _draw(study: optuna.Study, config: TrainingConfig, space: Mapping[str, BaseDistribution]) -> optuna.Trial:
    """Draw the next trial of a study; the draw depends on its number and the trials in the study."""
    trial = study.ask()
    # One seed per trial, so that a resumed search goes on as it would have, and processes that share a study differ.
    seed = int(np.random.SeedSequence([config.seed, trial.number]).generate_state(1)[0])
    study.sampler = optuna.samplers.TPESampler(seed=seed, multivariate=False)
    for name, distribution in space.items():
        if isinstance(distribution, CategoricalDistribution):
            trial.suggest_categorical(name, distribution.choices)
        elif isinstance(distribution, FloatDistribution):
            trial.suggest_float(name, distribution.low, distribution.high, log=distribution.log)
    return trial


def _draw_generation(
    study: optuna.Study, config: TrainingConfig, space: Mapping[str, BaseDistribution], size: int
) -> list[optuna.Trial]:
    """Return the trials of the current generation that are not finished; all are drawn before the first one runs."""
    waiting = study.get_trials(states=(TrialState.RUNNING,))
    drawn = [optuna.Trial(study, trial._trial_id) for trial in waiting]
    begun = len(study.get_trials(states=(*_FINISHED, TrialState.RUNNING)))
    missing = -begun % size if drawn else size  # not 0 if the drawing was interrupted
    return [*drawn, *(_draw(study, config, space) for _ in range(missing))]


def _run_alone(
    config: TrainingConfig, before: Sequence[FrozenTrial]
) -> tuple[float | None, TrialState, list[dict[str, float]]]:
    """Run a trial, compared with earlier ones only; return value, state and history."""
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    study = optuna.create_study(direction="maximize", pruner=_PRUNER)
    study.add_trials(before)
    trial = study.ask()
    value, state = _run_trial(trial, config)
    return value, state, trial.user_attrs["history"]


def _report(trial: optuna.Trial, history: Sequence[Mapping[str, float]]) -> None:
    for number, figures in enumerate(history, 1):
        trial.report(figures["return"], number)
    trial.set_user_attr("history", list(history))


def _open_study(
    folder: Path, storage: str | None, config: TrainingConfig, space: Mapping[str, BaseDistribution], generation: int | None
) -> optuna.Study:
    """Return a study, which begins with the initial hyper-parameters if it is new."""
    about = plain({**settings_of(config), "generation": generation, **origin()})
    folder.mkdir(parents=True, exist_ok=True)
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    try:
        study = optuna.create_study(
            study_name="turtlebot-gym",
            storage=_storage(storage or f"sqlite:///{folder / 'study.db'}"),
            load_if_exists=True,
            direction="maximize",
            pruner=_PRUNER,
        )
    except (OSError, ImportError, SQLAlchemyError, optuna.exceptions.OptunaError) as error:
        raise ValueError(f"storage must be a file or the URL of a database, got {storage!r}: {error}") from error
    if "about" not in study.user_attrs:
        study.set_user_attr("about", about)
        study.enqueue_trial(_starting_point(space, config.hyper), skip_if_exists=True)
    elif other := difference(study.user_attrs["about"], about):
        raise ValueError(f"{storage or folder} holds a study with {other}: choose another folder.")
    return study


def _storage(name: str) -> optuna.storages.BaseStorage | str:
    """Return a storage by its URL, or by the file of a journal."""
    if "://" in name:
        return name
    Path(name).parent.mkdir(parents=True, exist_ok=True)
    return JournalStorage(JournalFileBackend(name))


def _with_parameters(config: TrainingConfig, parameters: Mapping[str, Any]) -> TrainingConfig:
    """Return a configuration with a trial's parameters inserted into its hyper-parameters."""
    hyper = deepcopy(dict(config.hyper))
    for name, value in parameters.items():
        *path, key = name.split(".")
        place = hyper
        for part in path:
            place = place.setdefault(part, {})
        if key == "net_arch":
            value = json.loads(value)
        elif key == "learning_rate" and str(hyper.get(key, "")).startswith("lin_"):
            value = f"lin_{value:.6g}"
        place[key] = value
    if "n_steps" in parameters:  # a rollout that is smaller than a batch is one batch
        hyper["batch_size"] = min(hyper["batch_size"], hyper["n_steps"] * hyper["n_envs"])
    return replace(config, config=hyper)


def _starting_point(space: Mapping[str, BaseDistribution], base: Mapping[str, Any]) -> dict[str, Any]:
    """Return the hyper-parameters that are in the search space, in the form of a trial."""
    start: dict[str, Any] = {}
    for name, distribution in space.items():
        value: Any = base
        for key in name.split("."):
            value = value.get(key) if isinstance(value, Mapping) else None
        if isinstance(distribution, CategoricalDistribution):
            value = str(value) if isinstance(value, list) else value
            inside = value in distribution.choices
        else:
            assert isinstance(distribution, FloatDistribution)
            try:
                value = float(str(value).removeprefix("lin_"))
            except ValueError:
                continue
            inside = distribution.low <= value <= distribution.high
        if inside:
            start[name] = value
    return start


def _run_trial(trial: optuna.Trial, config: TrainingConfig) -> tuple[float | None, TrialState]:
    """Train, and return a trial's value, and whether it was pruned."""

    def go_on(figures: dict[str, float]) -> bool:
        # Evaluations are numbered, since rollouts of different lengths end at different steps.
        trial.report(figures["return"], len(judge.history))
        return not trial.should_prune()

    with closing(config.make_training()) as envs, closing(config.make_judging()) as judges:
        judge = EvaluationCallback(judges, every=config.between_evaluations, episodes=config.episodes, go_on=go_on)
        learn(config, envs, [judge])
    trial.set_user_attr("history", judge.history)
    if judge.stopped:
        return None, TrialState.PRUNED
    return judge.history[-1]["return"], TrialState.COMPLETE
