"""A search for hyper-parameters in generations: the trials of a generation are drawn together and run in parallel.

A generation's draws and its pruned trials depend on earlier generations only. So a search depends on the size of a generation,
but not on the number of workers, the order in which they finish, or an interruption.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import optuna
from optuna.distributions import BaseDistribution
from optuna.trial import FrozenTrial, TrialState, create_trial

from turtlebot_gym.validation import choose, whole
from turtlebot_gym_agents.cluster.attachments import unpacked
from turtlebot_gym_agents.cluster.store import Result, Store
from turtlebot_gym_agents.cluster.trainings import Training
from turtlebot_gym_agents.cluster.units import Workers, complete, in_turn
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
        study = optuna.create_study(direction="maximize", pruner=pruner())
        study.add_trials([_restored(trial) for trial in self.earlier])
        trial = study.ask()
        with unpacked(self.training.files) as places:
            value, state = run_trial(trial, self.training.located(places))
        facts = {"state": state.name, "value": value, "on_the_way": _on_the_way(study.trials[-1])}
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
        workers: Workers for the trials, see `units.complete`.
        store: Store of the results until their generation is complete.
        progress: Called with the number of finished trials.

    Returns:
        The study; the folder holds the best hyper-parameters.

    Raises:
        ValueError: As `training.tuning.tune`, and if a number is out of its range.
    """
    space = choose("algo", config.algo, SPACES)
    for name, number in (("trials", trials), ("generation", generation)):
        whole(name, number, 1, 1_000_000)
    study = open_study(folder, storage, config, generation=generation)
    files = Training.of(config).files
    while (finished := len(finished_trials(study))) < trials:
        number, done = divmod(finished, generation)
        before = sorted(finished_trials(study), key=lambda trial: trial.number)[: number * generation]
        given = {} if number else starting_point(space, config.hyper)
        drawn = _drawn(before, space, Sampler([config.seed, number], given), generation)[done : done + trials - finished]
        earlier = tuple({"state": trial.state.name, "value": trial.value, "on_the_way": _on_the_way(trial)} for trial in before)
        units = [
            Trial(training=Training(config=with_parameters(config, parameters), files=files), earlier=earlier)
            for parameters in drawn
        ]
        results = complete(
            units, workers=workers, store=store, progress=lambda ended, finished=finished: progress(finished + ended)
        )
        for parameters, result in zip(drawn, results, strict=True):
            study.add_trial(_restored(result.facts, params=parameters, distributions=space))
        save_best(study, folder, config)
    progress(finished)
    return study


def _drawn(
    before: list[FrozenTrial], space: Mapping[str, BaseDistribution], sampler: Sampler, generation: int
) -> list[dict[str, Any]]:
    study = optuna.create_study(direction="maximize", sampler=sampler)
    study.add_trials(before)
    drawn = []
    for _ in range(generation):
        drawn.append(suggest(study.ask(), space))
        sampler.given = {}  # for the first trial only
    return drawn


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
