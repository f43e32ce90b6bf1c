"""Search for hyper-parameters with Optuna: resumable, with pruning of poor trials.

A study's folder holds ``study.db`` (Optuna's sqlite storage, unless another is named; a study can be interrupted and resumed at
any time, and several processes can share it) and ``best.yaml``, the best hyper-parameters so far in the form that training
reads.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import optuna
from optuna.distributions import BaseDistribution, CategoricalDistribution, FloatDistribution
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend
from optuna.trial import TrialState
from sqlalchemy.exc import SQLAlchemyError

from turtlebot_gym.validation import choose, whole
from turtlebot_gym_agents.provenance import provenance
from turtlebot_gym_agents.training import hyperparameters
from turtlebot_gym_agents.training.callbacks import EvaluationCallback
from turtlebot_gym_agents.training.config import TrainingConfig
from turtlebot_gym_agents.training.train import learn

_NETWORK: dict[str, BaseDistribution] = {
    "policy_kwargs.net_arch": CategoricalDistribution(("[32, 32]", "[64, 64]", "[128, 128]")),
    "policy_kwargs.activation_fn": CategoricalDistribution(("ReLU", "Tanh")),
}
_COMMON: dict[str, BaseDistribution] = {
    "learning_rate": FloatDistribution(1e-4, 1e-2, log=True),
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
        "n_steps": CategoricalDistribution((16, 32, 64, 128)),
        "batch_size": CategoricalDistribution((1024, 2048, 4096)),
        "n_epochs": CategoricalDistribution((2, 4, 8)),
        "gae_lambda": CategoricalDistribution((0.9, 0.95, 0.98)),
        "ent_coef": FloatDistribution(0.0, 0.01),
        "policy_kwargs.log_std_init": FloatDistribution(-2.0, 0.0),
    },
    "sac": {**_COMMON, **_NETWORK, **_OFF_POLICY},
    "td3": {**_COMMON, **_NETWORK, **_OFF_POLICY, "noise_std": FloatDistribution(0.05, 0.5)},
}
"""Search space of each algorithm: names of hyper-parameters, with a dot if nested, and their ranges."""


def tune(
    config: TrainingConfig,
    folder: Path,
    *,
    trials: int = 50,
    storage: str | None = None,
    progress: Callable[[int], None] = lambda ended: None,
) -> optuna.Study:
    """Search for the hyper-parameters with which the last evaluation's mean return is highest.

    All trials have the same seed and budget. The first one has the initial hyper-parameters as far as they are in the search
    space. All others keep their initial values.

    Args:
        config: Configuration of the training; its ``steps`` are those of each trial.
        folder: Study folder; an existing study is resumed.
        trials: Total number of finished trials, including earlier ones and those of other processes.
        storage: Storage of the study, see `open_study`; None for ``study.db`` in the folder.
        progress: Called with the number of finished trials.

    Returns:
        The study; the folder holds the best hyper-parameters.

    Raises:
        ValueError: If there is no search space for the algorithm, or the folder holds a study of another configuration.
    """
    space = choose("algo", config.algo, SPACES)
    whole("trials", trials, 1, 1_000_000)
    study = open_study(folder, storage, config)
    while (finished := len(finished_trials(study))) < trials:
        progress(finished)
        trial = study.ask()
        # A seed for each trial, so that processes that share a study draw different hyper-parameters.
        study.sampler = Sampler([config.seed, trial.number], {} if trial.number else starting_point(space, config.hyper))
        suggest(trial, space)
        study.tell(trial, *run_trial(trial, with_parameters(config, trial.params)))
        save_best(study, folder, config)
    progress(finished)
    return study


def open_study(folder: Path, storage: str | None, config: TrainingConfig, **more: Any) -> optuna.Study:
    """Return a study, which is created if there is none.

    Args:
        folder: Study folder; created if missing.
        storage: URL of a database for SQLAlchemy, or a file (Optuna's journal), which may be on a network file system; None for
            ``study.db`` in the folder.
        config: Configuration of the trainings.
        **more: Further entries, in JSON's types, that the study depends on.

    Raises:
        ValueError: If an existing study has another configuration, or the storage cannot be used.
    """
    settings = {name: value for name, value in config.settings().items() if name != "device"}  # any device resumes it
    about = {"config": settings, "hyperparameters": dict(config.hyper), **more}
    folder.mkdir(parents=True, exist_ok=True)
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    try:
        study = optuna.create_study(
            study_name="turtlebot-gym",
            storage=_storage(storage or f"sqlite:///{folder / 'study.db'}"),
            load_if_exists=True,
            direction="maximize",
            pruner=pruner(),
        )
    except (OSError, ImportError, SQLAlchemyError, optuna.exceptions.OptunaError) as error:
        raise ValueError(f"storage must be a file or the URL of a database, got {storage!r}: {error}") from error
    if study.user_attrs.get("about", about) != about:
        raise ValueError(f"{storage or folder} holds a study of another configuration: choose another folder.")
    if "about" not in study.user_attrs:
        study.set_user_attr("about", about)
        study.set_user_attr("provenance", provenance())
    return study


def _storage(name: str) -> optuna.storages.BaseStorage | str:
    """Return a storage by its URL, or by the file of a journal."""
    if "://" in name:
        return name
    Path(name).parent.mkdir(parents=True, exist_ok=True)
    return JournalStorage(JournalFileBackend(name))


def pruner() -> optuna.pruners.BasePruner:
    """Return the pruner, which stops trials below the median of the earlier ones."""
    return optuna.pruners.MedianPruner(n_startup_trials=5, n_warmup_steps=1)


def finished_trials(study: optuna.Study) -> list[optuna.trial.FrozenTrial]:
    """Return the trials that ended regularly."""
    return study.get_trials(states=(TrialState.COMPLETE, TrialState.PRUNED))


def save_best(study: optuna.Study, folder: Path, config: TrainingConfig) -> None:
    """Write ``best.yaml`` as soon as there is a best trial."""
    if study.get_trials(deepcopy=False, states=(TrialState.COMPLETE,)):
        hyperparameters.save(folder / "best.yaml", config.env, with_parameters(config, study.best_params).hyper)


class Sampler(optuna.samplers.TPESampler):
    """Optuna's tree-structured Parzen estimator, with some parameters given.

    Args:
        seed: Seed of the draws.
        given: Fixed parameters.
    """

    def __init__(self, seed: Sequence[int], given: Mapping[str, Any]) -> None:
        super().__init__(seed=int(np.random.SeedSequence(seed).generate_state(1)[0]), multivariate=False)
        self.given = given
        """Fixed parameters, which are not drawn; they may be replaced between trials."""

    def sample_independent(
        self, study: optuna.Study, trial: optuna.trial.FrozenTrial, param_name: str, param_distribution: BaseDistribution
    ) -> Any:
        drawn = super().sample_independent(study, trial, param_name, param_distribution)
        return self.given.get(param_name, drawn)


def suggest(trial: optuna.Trial, space: Mapping[str, BaseDistribution]) -> dict[str, Any]:
    """Draw a trial's parameters with its study's sampler, and return them."""
    for name, distribution in space.items():
        if isinstance(distribution, CategoricalDistribution):
            trial.suggest_categorical(name, distribution.choices)
        elif isinstance(distribution, FloatDistribution):
            trial.suggest_float(name, distribution.low, distribution.high, log=distribution.log)
    return trial.params


def with_parameters(config: TrainingConfig, parameters: Mapping[str, Any]) -> TrainingConfig:
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
    return replace(config, config=hyper)


def starting_point(space: Mapping[str, BaseDistribution], base: Mapping[str, Any]) -> dict[str, Any]:
    """Return the hyper-parameters that are in the search space, in the form of a trial."""
    start: dict[str, Any] = {}
    for name, distribution in space.items():
        value: Any = base
        for key in name.split("."):
            value = value.get(key) if isinstance(value, Mapping) else None
        if isinstance(distribution, CategoricalDistribution):
            value = str(value) if isinstance(value, list) else value
            inside = value in distribution.choices
        elif isinstance(distribution, FloatDistribution):
            try:
                value = float(str(value).removeprefix("lin_"))
            except ValueError:
                continue
            inside = distribution.low <= value <= distribution.high
        else:
            raise TypeError(f"{name}: only categorical and float distributions are searched.")
        if inside:
            start[name] = value
    return start


def run_trial(trial: optuna.Trial, config: TrainingConfig) -> tuple[float | None, TrialState]:
    """Train, and return a trial's value, and whether it was pruned."""

    def go_on(figures: dict[str, float]) -> bool:
        # Evaluations are numbered, since rollouts of different lengths end at different steps.
        trial.report(figures["return"], len(judge.history))
        return not trial.should_prune()

    with closing(config.make_training()) as envs, closing(config.make(config.episodes)) as judges:
        judge = EvaluationCallback(judges, every=config.between_evaluations, go_on=go_on)
        learn(config, envs, [judge])
    trial.set_user_attr("history", judge.history)
    if judge.stopped:
        return None, TrialState.PRUNED
    return judge.history[-1]["return"], TrialState.COMPLETE
