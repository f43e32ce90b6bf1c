"""Search for hyper-parameters with Optuna: resumable, with trials that fall behind cut short.

A study's folder holds ``study.db`` (Optuna's own sqlite storage: stop whenever you like and go on later, or have several
processes work on it at once) and ``best.yaml``, the best hyper-parameters so far in the form that training reads.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from copy import deepcopy
from dataclasses import asdict
from pathlib import Path
from typing import Any

import optuna
import torch
from optuna.distributions import BaseDistribution, CategoricalDistribution, FloatDistribution
from optuna.trial import TrialState

from turtlebot_gym.validation import choose
from turtlebot_gym_agents.provenance import plain, provenance
from turtlebot_gym_agents.training import hyperparameters
from turtlebot_gym_agents.training.callbacks import EvaluationCallback
from turtlebot_gym_agents.training.train import TrainingConfig, learn, make_model

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
"""What is searched for each algorithm: the hyper-parameter's name, with a dot where it is nested, and its range."""


def tune(
    config: TrainingConfig,
    folder: Path,
    *,
    trials: int = 50,
    progress: Callable[[int], None] = lambda ended: None,
) -> optuna.Study:
    """Search for the hyper-parameters with which the last evaluation's mean return is highest.

    All trials have the same seed and budget. The first one has the hyper-parameters that the search starts from, as far as
    they are in the space. What is not searched stays as it is there.

    Args:
        config: What to train; its ``steps`` are each trial's.
        folder: The study's; one that holds a study is gone on with.
        trials: How many finished trials the study is to have, earlier ones included.
        progress: Called with the number of finished trials.

    Returns:
        The study; the folder holds the best hyper-parameters.

    Raises:
        ValueError: If there is no search space for the algorithm, or the folder holds a study of another configuration.
    """
    space = choose("algo", config.algo, SPACES)
    if not trials > 0:
        raise ValueError(f"trials must be positive, got {trials!r}.")
    base = hyperparameters.load(config.algo, config.env, config.config)
    folder.mkdir(parents=True, exist_ok=True)
    torch.set_num_threads(config.threads)
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    study = optuna.create_study(
        study_name="turtlebot-gym",
        storage=f"sqlite:///{folder / 'study.db'}",
        load_if_exists=True,
        direction="maximize",
        sampler=optuna.samplers.TPESampler(seed=config.seed, multivariate=False),
        pruner=optuna.pruners.MedianPruner(n_startup_trials=5, n_warmup_steps=1),
    )
    about = plain({"config": asdict(config), "hyperparameters": base})
    del about["config"]["device"]  # a study goes on on any
    if study.user_attrs.get("about", about) != about:
        raise ValueError(f"{folder} holds a study of another configuration: choose another folder.")
    if not study.trials:
        study.set_user_attr("about", about)
        study.set_user_attr("provenance", provenance())
        study.enqueue_trial(starting_point(space, base))
    while (finished := len(study.get_trials(states=(TrialState.COMPLETE, TrialState.PRUNED)))) < trials:
        progress(finished)
        trial = study.ask(space)
        study.tell(trial, *_run(trial, config, with_parameters(base, trial.params)))
        if study.get_trials(states=(TrialState.COMPLETE,)):
            hyperparameters.save(folder / "best.yaml", config.env, with_parameters(base, study.best_params))
    progress(finished)
    return study


def with_parameters(base: Mapping[str, Any], parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Return hyper-parameters with those of a trial in their places."""
    hyper = deepcopy(dict(base))
    for name, value in parameters.items():
        *path, key = name.split(".")
        place = hyper
        for part in path:
            place = place.setdefault(part, {})
        if key == "net_arch":
            value = json.loads(value)
        elif key == "learning_rate" and str(base.get(key, "")).startswith("lin_"):
            value = f"lin_{value:.6g}"
        place[key] = value
    return hyper


def starting_point(space: Mapping[str, BaseDistribution], base: Mapping[str, Any]) -> dict[str, Any]:
    """Return those of the hyper-parameters that lie in the space, as a trial has them."""
    found: dict[str, Any] = {}
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
            found[name] = value
    return found


def _run(trial: optuna.Trial, config: TrainingConfig, hyper: dict[str, Any]) -> tuple[float | None, TrialState]:
    """Return a trial's value, and whether it was cut short."""
    total = config.steps or hyper["n_timesteps"]

    def go_on(figures: dict[str, float]) -> bool:
        # Evaluations are numbered: rollouts of other lengths do not end at the same steps.
        trial.report(figures["return"], len(judge.history))
        return not trial.should_prune()

    envs, judges = config.make(hyper["n_envs"], randomize=config.randomize), config.make(config.episodes)
    judge = EvaluationCallback(judges, every=max(1, total // config.evaluations), go_on=go_on)
    try:
        learn(make_model(config, hyper, envs, tensorboard=None), total, [judge], threads=config.threads)
    finally:
        envs.close()
        judges.close()
    trial.set_user_attr("history", judge.history)
    if judge.stopped:
        return None, TrialState.PRUNED
    return judge.history[-1]["return"], TrialState.COMPLETE
