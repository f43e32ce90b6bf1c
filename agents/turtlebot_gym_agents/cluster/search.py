"""Search for hyper-parameters with Optuna: resumable, with pruning of poor trials, one by one or in generations.

A study's folder holds ``study.db`` (Optuna's sqlite storage, unless another is named; a study can be interrupted and resumed at
any time, and several processes can share it) and ``best.yaml``, the best hyper-parameters so far in the form that training
reads.

The trials of a generation are drawn together and run in parallel. Its draws and its pruned trials depend on earlier generations
only. So such a search depends on the size of a generation, but not on the number of workers, the order in which they finish, or
an interruption.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from copy import deepcopy
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import optuna
from optuna.distributions import BaseDistribution, CategoricalDistribution, FloatDistribution
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend
from optuna.trial import FrozenTrial, TrialState, create_trial
from sqlalchemy.exc import SQLAlchemyError

from turtlebot_gym.validation import choose, whole
from turtlebot_gym_agents.cluster.attachments import unpacked
from turtlebot_gym_agents.cluster.trainings import Training
from turtlebot_gym_agents.cluster.units import Result, Runner, complete
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
_PRUNER = optuna.pruners.MedianPruner(n_startup_trials=5, n_warmup_steps=1)
_FINISHED = (TrialState.COMPLETE, TrialState.PRUNED)


def tune(
    config: TrainingConfig,
    folder: Path,
    *,
    trials: int = 50,
    generation: int | None = None,
    storage: str | None = None,
    runner: Runner = complete,
    progress: Callable[[int], None] = lambda ended: None,
) -> optuna.Study:
    """Search for the hyper-parameters with which the last evaluation's mean return is highest.

    All trials have the same seed and budget. The first one has the initial hyper-parameters as far as they are in the search
    space. All others keep their initial values.

    Args:
        config: Configuration of the training; its ``steps`` are those of each trial.
        folder: Study folder; an existing study is resumed.
        trials: Total number of finished trials, including earlier ones and those of other processes.
        generation: Number of trials drawn together, which belongs to the study; None to draw and run them one by one.
        storage: URL of a database for SQLAlchemy, or a file (Optuna's journal), which may be on a network file system; None for
            ``study.db`` in the folder.
        runner: Runs the trials of a generation; its store keeps their results until the generation is complete.
        progress: Called with the number of finished trials.

    Returns:
        The study; the folder holds the best hyper-parameters.

    Raises:
        ValueError: If there is no search space for the algorithm, a number is out of its range, the folder holds a study of
            another configuration, or the storage cannot be used.
    """
    space = choose("algo", config.algo, SPACES)
    for name, number in (("trials", trials), ("generation", 1 if generation is None else generation)):
        whole(name, number, 1, 1_000_000)
    study = _open_study(folder, storage, config, {} if generation is None else {"generation": generation})
    while (finished := len(study.get_trials(states=_FINISHED))) < trials:
        progress(finished)
        if generation is None:
            _try_next(study, config, space)
        else:
            _try_generation(study, config, space, generation, trials, runner, progress)
        if study.get_trials(deepcopy=False, states=(TrialState.COMPLETE,)):
            hyperparameters.save(folder / "best.yaml", config.env, _with_parameters(config, study.best_params).hyper)
    progress(finished)
    return study


def _try_next(study: optuna.Study, config: TrainingConfig, space: Mapping[str, BaseDistribution]) -> None:
    trial = study.ask()
    # One seed per trial, so that processes that share a study draw different hyper-parameters.
    study.sampler = _Sampler([config.seed, trial.number], _starting_point(space, config.hyper))
    for name, distribution in space.items():
        if isinstance(distribution, CategoricalDistribution):
            trial.suggest_categorical(name, distribution.choices)
        elif isinstance(distribution, FloatDistribution):
            trial.suggest_float(name, distribution.low, distribution.high, log=distribution.log)
    study.tell(trial, *_run_trial(trial, _with_parameters(config, trial.params)))


def _try_generation(
    study: optuna.Study,
    config: TrainingConfig,
    space: Mapping[str, BaseDistribution],
    size: int,
    trials: int,
    runner: Runner,
    progress: Callable[[int], None],
) -> None:
    """Run the missing trials of a generation, up to a total number of trials."""
    finished = study.get_trials(states=_FINISHED)
    number, done = divmod(len(finished), size)
    before = sorted(finished, key=lambda trial: trial.number)[: number * size]
    # An interrupted generation is drawn again from the same seed, and its finished trials are skipped.
    sampler = _Sampler([config.seed, number], _starting_point(space, config.hyper))
    again = optuna.create_study(direction="maximize", sampler=sampler)
    again.add_trials(before)
    drawn = [again.ask(dict(space)).params for _ in range(size)][done : done + trials - len(finished)]
    earlier = tuple({"state": trial.state.name, "value": trial.value, "on_the_way": _on_the_way(trial)} for trial in before)
    files = Training.of(config).files
    trainings = [Training(config=_with_parameters(config, parameters), files=files) for parameters in drawn]
    units = [Trial(training=training, earlier=earlier) for training in trainings]
    results = runner(units, lambda ended: progress(len(finished) + ended))
    for parameters, result in zip(drawn, results, strict=True):
        study.add_trial(_restored(result.facts, params=parameters, distributions=space))


@dataclass(frozen=True, kw_only=True)
class Trial:
    """A trial of a search: a unit of work, see `units`."""

    training: Training
    """The training with the trial's hyper-parameters."""
    earlier: tuple[Mapping[str, Any], ...] = ()
    """Trials with which it is compared: state, value and intermediate values."""
    memory = Training.memory
    size = 1

    def about(self) -> dict[str, Any]:
        return {"trial": self.training.about(), "earlier": self.earlier}

    def run(self) -> Result:
        """Train until the end, or until the trial is pruned."""
        optuna.logging.set_verbosity(optuna.logging.WARNING)
        study = optuna.create_study(direction="maximize", pruner=_PRUNER)
        study.add_trials([_restored(trial) for trial in self.earlier])
        trial = study.ask()
        with unpacked(self.training.files) as places:
            value, state = _run_trial(trial, self.training.located(places))
        facts = {"state": state.name, "value": value, "on_the_way": _on_the_way(study.trials[-1])}
        return Result(facts | {"history": trial.user_attrs["history"]}, {}, {}, {})


def _open_study(folder: Path, storage: str | None, config: TrainingConfig, more: Mapping[str, Any]) -> optuna.Study:
    """Return a study, new if there is none; ``more`` holds further settings on which it depends."""
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
            pruner=_PRUNER,
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


class _Sampler(optuna.samplers.TPESampler):
    """Optuna's tree-structured Parzen estimator, with some parameters of a study's first trial given."""

    def __init__(self, seed: Sequence[int], given: Mapping[str, Any]) -> None:
        super().__init__(seed=int(np.random.SeedSequence(seed).generate_state(1)[0]), multivariate=False)
        self._given = given

    def sample_independent(
        self, study: optuna.Study, trial: FrozenTrial, param_name: str, param_distribution: BaseDistribution
    ) -> Any:
        # Always drawn, so that later draws do not depend on what is given.
        drawn = super().sample_independent(study, trial, param_name, param_distribution)
        return drawn if trial.number else self._given.get(param_name, drawn)


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

    with closing(config.make_training()) as envs, closing(config.make(config.episodes)) as judges:
        judge = EvaluationCallback(judges, every=config.between_evaluations, go_on=go_on)
        learn(config, envs, [judge])
    trial.set_user_attr("history", judge.history)
    if judge.stopped:
        return None, TrialState.PRUNED
    return judge.history[-1]["return"], TrialState.COMPLETE


def _on_the_way(trial: FrozenTrial) -> list[float]:
    return [trial.intermediate_values[step] for step in sorted(trial.intermediate_values)]


def _restored(facts: Mapping[str, Any], **drawn: Any) -> FrozenTrial:
    return create_trial(
        state=TrialState[facts["state"]],
        value=facts["value"],
        intermediate_values=dict(enumerate(facts["on_the_way"], start=1)),
        user_attrs={"history": facts["history"]} if "history" in facts else {},
        **drawn,
    )
