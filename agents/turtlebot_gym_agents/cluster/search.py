"""A search for hyper-parameters in generations: the trials of a generation are drawn together and run in parallel.

A generation's draws and its pruned trials depend on earlier generations only. So a search depends on the size of a generation,
but not on the number of workers, the order in which they finish, or an interruption.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import optuna
import torch
from optuna.distributions import BaseDistribution
from optuna.trial import FrozenTrial, TrialState, create_trial

from turtlebot_gym.validation import choose
from turtlebot_gym_agents.cluster.attachments import Attachments, attach, unpacked
from turtlebot_gym_agents.cluster.store import Result, Store
from turtlebot_gym_agents.cluster.units import Training, compile_training, located
from turtlebot_gym_agents.cluster.work import Workers, complete, in_turn
from turtlebot_gym_agents.provenance import plain
from turtlebot_gym_agents.training import hyperparameters
from turtlebot_gym_agents.training.config import TrainingConfig
from turtlebot_gym_agents.training.tuning import (
    SPACES,
    Sampler,
    finished_trials,
    open_study,
    pruner,
    run_trial,
    save_best,
    starting_point,
    suggest,
    with_parameters,
)


@dataclass(frozen=True, kw_only=True)
class Trial:
    """A trial of a search: a unit of work, see `units`."""

    config: TrainingConfig
    """Configuration of the training."""
    hyper: Mapping[str, Any]
    """Hyper-parameters of the training."""
    earlier: tuple[Mapping[str, Any], ...] = ()
    """Trials with which it is compared: state, value and intermediate values."""
    files: Attachments = field(default_factory=dict)
    """Files that the configuration names."""
    memory = Training.memory
    size = 1

    def about(self) -> dict[str, Any]:
        """Return everything that the result depends on."""
        training = Training(config=self.config, hyper=self.hyper, files=self.files).about()
        return {"trial": training, "earlier": plain(self.earlier)}

    def run(self) -> Result:
        """Train until the end, or until the trial is pruned."""
        optuna.logging.set_verbosity(optuna.logging.WARNING)
        study = optuna.create_study(direction="maximize", pruner=pruner())
        study.add_trials([_restored(one) for one in self.earlier])
        torch.set_num_threads(self.config.threads)
        with unpacked(self.files) as places:
            config = located(self.config, places)
            compile_training(config, self.hyper)
            trial = study.ask()
            value, state = run_trial(trial, config, dict(self.hyper))
        on_the_way = study.trials[-1].intermediate_values
        facts = {"state": state.name, "value": value, "on_the_way": [on_the_way[step] for step in sorted(on_the_way)]}
        return Result(facts | {"history": trial.user_attrs["history"]}, {}, {}, {})


def search(
    config: TrainingConfig,
    folder: Path,
    *,
    trials: int = 50,
    generation: int = 8,
    storage: str | None = None,
    workers: Workers = in_turn,
    store: Store | None = None,
    progress: Callable[[int], None] = lambda ended: None,
) -> optuna.Study:
    """Search for hyper-parameters as `training.tuning.tune` does, but in generations.

    Args:
        config: Configuration of the training; its ``steps`` are those of each trial.
        folder: Study folder; an existing study is resumed.
        trials: Total number of finished trials, earlier ones included.
        generation: Number of trials drawn together; it belongs to the study.
        storage: Storage of the study, see `training.tuning.open_study`.
        workers: Workers for the trials, see `work.complete`.
        store: Store of the results until their generation is complete.
        progress: Called with the number of finished trials.

    Returns:
        The study; the folder holds the best hyper-parameters.

    Raises:
        ValueError: As `training.tuning.tune`, and if a number is out of its range.
    """
    space = choose("algo", config.algo, SPACES)
    for name, number in (("trials", trials), ("generation", generation)):
        if not number > 0:
            raise ValueError(f"{name} must be positive, got {number!r}.")
    base = hyperparameters.load(config.algo, config.env, config.config)
    about = {"config": asdict(config), "hyperparameters": base, "generation": generation}
    study = open_study(folder, storage, plain(about))
    files = attach(config.robot, config.noise, config.fix, config.world)
    while (finished := len(finished_trials(study))) < trials:
        number, done = divmod(finished, generation)
        before = sorted(finished_trials(study), key=lambda trial: trial.number)[: number * generation]
        sampler = Sampler([config.seed, number], {} if number else starting_point(space, base))
        drawn = _drawn(before, space, sampler, generation)
        earlier = tuple(map(_told, before))
        units = [
            Trial(config=config, hyper=with_parameters(base, parameters), earlier=earlier, files=files)
            for parameters in drawn[done : done + trials - finished]
        ]
        results = complete(
            units, workers=workers, store=store, progress=lambda ended, finished=finished: progress(finished + ended)
        )
        for parameters, result in zip(drawn[done:], results, strict=False):
            study.add_trial(_restored(result.facts, parameters=parameters, space=space))
        save_best(study, folder, config, base)
    progress(finished)
    return study


def _drawn(
    before: Sequence[FrozenTrial], space: Mapping[str, BaseDistribution], sampler: Sampler, generation: int
) -> list[dict[str, Any]]:
    """Return the parameters of the next generation."""
    study = optuna.create_study(direction="maximize", sampler=sampler)
    study.add_trials(before)
    drawn = []
    for _ in range(generation):
        drawn.append(suggest(study.ask(), space))
        sampler.given = {}  # for the first trial only
    return drawn


def _told(trial: FrozenTrial) -> dict[str, Any]:
    """Return a trial in the form with which later trials are compared."""
    values = [trial.intermediate_values[step] for step in sorted(trial.intermediate_values)]
    return {"state": trial.state.name, "value": trial.value, "on_the_way": values}


def _restored(
    told: Mapping[str, Any],
    *,
    parameters: Mapping[str, Any] | None = None,
    space: Mapping[str, BaseDistribution] | None = None,
) -> FrozenTrial:
    """Return a trial as an Optuna object."""
    return create_trial(
        state=TrialState[told["state"]],
        value=told["value"],
        params=dict(parameters or {}),
        distributions=dict(space or {}),
        intermediate_values=dict(enumerate(told["on_the_way"], start=1)),
        user_attrs={"history": told["history"]} if "history" in told else {},
    )
